"""A swarm as in Miller 2019: its noise and sensing range, one sweep per second.

Ranges have 3 cm, the R of his program, where his text says 18.6 (`range_sigma_m`); bearings
0.1 rad; each robot's odometry 1 mm and 0.02 rad in every thirtieth of a second (section II-B).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from host.geometry import Path, on_rays, to_frame, wrap
from host.messages import Displacement, FloatArray, Positions
from host.simulation.world.settings import bounded, one_of
from host.systems.swarm_ukf.joint_map import Neighbours, Reading
from host.systems.swarm_ukf.scoring import Event, laid, score_swarm
from host.systems.swarm_ukf.start import TimedReading, carried, direct_estimate
from host.systems.swarm_ukf.swarm import SwarmSettings, SwarmUkf

_STEP_S = 1.0 / 30.0
_SWEEP_STEPS = 30
_ODOMETRY_SIGMAS = (0.001, 0.02)  # m and rad a step
_BEARING_SIGMA_RAD = 0.1
# Noise of bearings draws positions nearer; this takes it back (Lerro & Bar-Shalom 1993).
_UNBIASED = math.exp(_BEARING_SIGMA_RAD**2 / 2.0)
_NEAREST_M = 0.15  # nearer, the receiver saturates
_SPEED_MPS, _ROTATION_RADPS = 0.03, 0.6
_COMMAND_STEPS = 90


@dataclass(frozen=True, slots=True)
class SwarmScenario:
    """robots in a disc of radius_m, each seeing others nearer than reach_m.

    formation: "wander", or where they stand in a "circle" or a "line" and drive as one.
    range_gain: of each range that is reported to the true one, the calibration error of his line.
    """

    robots: int = bounded(5, 2, 60)
    seconds: float = bounded(60.0, 3.0, 7200.0)
    seed: int = bounded(1, 0, 2**32 - 1)
    formation: str = one_of(("wander", "circle", "line"))
    radius_m: float = bounded(0.8, 0.1, 20.0)
    reach_m: float = bounded(1.8, 0.2, 20.0)
    range_sigma_m: float = bounded(0.03, 0.001, 1.0)
    range_gain: float = bounded(1.0, 0.5, 2.0)


class SimulatedSwarm:
    """events: what the robots report, in order of time. truth(time): poses (n, 3) then."""

    def __init__(self, scenario: SwarmScenario) -> None:
        self._scenario = scenario
        self._random = np.random.default_rng(scenario.seed)
        self._steps = round(scenario.seconds / _STEP_S)
        self._poses = self._drive()

    @property
    def robots(self) -> int:
        """How many there are."""
        return self._scenario.robots

    def truth(self, time: float) -> FloatArray:
        """Poses (n, 3) at `time`, s."""
        return np.array(self._poses[min(self._steps, round(time / _STEP_S))])

    def instants(self) -> list[float]:
        """When to score: every second from the second on."""
        return [float(second) for second in range(2, int(self._scenario.seconds))]

    def events(self) -> Iterator[Event]:
        """Odometry of every step, and after each second what every robot sees."""
        for step in range(1, self._steps + 1):
            for robot in range(self._scenario.robots):
                yield robot, self._displacement(robot, step)
            if step % _SWEEP_STEPS == 0:
                for robot in range(self._scenario.robots):
                    yield robot, self._sweep(robot, step)

    def direct_score(self) -> dict[str, float]:
        """Each sweep alone, as section III-A solves it: SLSQP from zero."""
        count, errors = self._scenario.robots, []
        still = {robot: Path() for robot in range(count)}
        for step in range(_SWEEP_STEPS, self._steps, _SWEEP_STEPS):
            time = step * _STEP_S
            sight = carried(
                [
                    TimedReading(time, Reading(robot, int(seen), position, covariance))
                    for robot in range(count)
                    for seen, position, covariance in _rows(self._sweep(robot, step))
                ],
                still,
                time,
            )
            fitted = laid(direct_estimate(sight), self._poses[step])
            errors.append(np.hypot(*(fitted - self._poses[step])[:, :2].T))
        return {"error_m": float(np.mean(errors))}

    def _drive(self) -> FloatArray:
        """(steps + 1, n, 3): wandering robots head back to the centre where they leave the disc."""
        count, radius = self._scenario.robots, self._scenario.radius_m
        poses = np.zeros((self._steps + 1, count, 3))
        poses[0] = self._places()
        rotations = np.zeros(count)
        together = self._scenario.formation != "wander"
        for step in range(self._steps):
            if step % _COMMAND_STEPS == 0:
                rotations = self._random.uniform(-_ROTATION_RADPS, _ROTATION_RADPS, count)
            now, after = poses[step], poses[step + 1]
            outside = np.hypot(now[:, 0], now[:, 1]) > radius
            inward = wrap(np.arctan2(-now[:, 1], -now[:, 0]) - now[:, 2])
            rate = np.where(outside & (not together), np.clip(inward, -0.6, 0.6), rotations)
            heading = np.zeros(count) if together else now[:, 2]
            along = _SPEED_MPS * _STEP_S
            after[:, 0] = now[:, 0] + along * np.cos(heading)
            after[:, 1] = now[:, 1] + along * np.sin(heading)
            after[:, 2] = now[:, 2] + (0.0 if together else 1.0) * rate * _STEP_S
        return poses

    def _places(self) -> FloatArray:
        count, radius = self._scenario.robots, self._scenario.radius_m
        share = np.arange(count) / count
        if self._scenario.formation == "circle":
            angle = 2.0 * math.pi * share
            return np.column_stack((radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle))
        if self._scenario.formation == "line":
            return np.column_stack((0.0 * share, 2.0 * radius * (share - 0.5), 0.0 * share))
        distance = radius * np.sqrt(self._random.uniform(size=count))
        angle, heading = self._random.uniform(-math.pi, math.pi, (2, count))
        return np.column_stack((distance * np.cos(angle), distance * np.sin(angle), heading))

    def _displacement(self, robot: int, step: int) -> Displacement:
        before, after = self._poses[step - 1, robot], self._poses[step, robot]
        dx, dy = to_frame(after[:2], before)
        move, rotate = _ODOMETRY_SIGMAS
        noise = self._random.normal(0.0, (move, move, rotate))
        return Displacement(
            time=step * _STEP_S,
            interval=_STEP_S,
            dx=float(dx + noise[0]),
            dy=float(dy + noise[1]),
            dpsi=float(after[2] - before[2] + noise[2]),
            translation_variance=move**2,
            heading_variance=rotate**2,
        )

    def _sweep(self, robot: int, step: int) -> Positions:
        scenario = self._scenario
        seen = to_frame(self._poses[step, :, :2], self._poses[step, robot])
        distances = np.hypot(seen[:, 0], seen[:, 1])
        near = np.flatnonzero((distances < scenario.reach_m) & (distances > _NEAREST_M))
        noise = self._random.normal(size=(2, len(near)))
        ranges = scenario.range_gain * distances[near] + scenario.range_sigma_m * noise[0]
        bearings = np.arctan2(seen[near, 1], seen[near, 0]) + _BEARING_SIGMA_RAD * noise[1]
        sideways = _BEARING_SIGMA_RAD**2 * (ranges**2 + scenario.range_sigma_m**2)
        along = np.full(len(near), scenario.range_sigma_m**2)
        positions, covariances = on_rays((0.0, 0.0), bearings, _UNBIASED * ranges, sideways, along)
        return Positions(step * _STEP_S, positions, covariances, identities=near.astype(np.int64))


def _rows(sweep: Positions) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    identities = np.zeros(0) if sweep.identities is None else sweep.identities
    return zip(identities, sweep.positions, sweep.covariances, strict=True)


def simulated_score(swarm: SimulatedSwarm, neighbours: Neighbours) -> dict[str, float]:
    """Figures of the filter on a simulated swarm."""
    settings = SwarmSettings(gain_sigmas=(0.0, 0.0), neighbours=neighbours)
    ukf = SwarmUkf(swarm.robots, settings)
    return score_swarm(ukf, swarm.events(), swarm.instants(), swarm.truth).figures()
