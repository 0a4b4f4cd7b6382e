"""An observer above robots on the floor, as Stegagno et al. 2013 simulated it (section II to V).

A camera that looks down from a body which hovers, sways and drifts finds points without names. Its
attitude and height are measured, so that a point in the picture is a place on the floor.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.errors import UserError
from host.geometry import to_frame, wrap
from host.messages import Displacement, FloatArray, Positions
from host.simulation.world.settings import bounded

STEP_S = 0.04  # the camera's 25 Hz
_SPEED_MPS, _MOST_RADPS = 0.2, 1.0
_COMMAND_STEPS = 50
_APART_M = 0.35  # robots turn away from each other, false things are that far from robots
_MOST_TRIES = 3_000  # of random places, before all have one
_SWAY_S = (3.1, 2.3)  # periods of roll and pitch
_DRIFT_MPS, _YAW_RADPS = 0.05, 0.1
_TILT_SIGMA_RAD, _HEIGHT_SIGMA_M = 0.005, 0.01
_FLOW_SIGMA_M, _YAW_SIGMA_RAD = 5e-4, 5e-4  # of the observer's own motion in a step
_GAIN_SIGMA = 0.01  # of each robot's odometry, distance and rotation
_ODOMETRY_M, _ODOMETRY_RAD = 5e-4, 2e-3  # its noise in a step


@dataclass(frozen=True, slots=True)
class OverheadScenario:
    """robots in a disc of radius_m, a camera that sees half_view_rad to each side from height_m.

    tilt_rad: how far the observer sways. point_sigma: of a point in the picture, focal lengths.
    detection: of a robot in view. false_things: what stands there and looks like a robot. clutter:
    other false points a frame. alike_s: until then robots 1 and 2 drive the same. standing: robots
    that never drive, the last ones.
    """

    robots: int = bounded(3, 1, 60)
    seconds: float = bounded(20.0, 1.0, 7200.0)
    seed: int = bounded(1, 0, 2**32 - 1)
    radius_m: float = bounded(1.3, 0.2, 20.0)
    height_m: float = bounded(2.5, 0.3, 20.0)
    half_view_rad: float = bounded(0.65, 0.2, 1.4)
    tilt_rad: float = bounded(0.1, 0.0, 0.15)
    point_sigma: float = bounded(0.006, 1e-4, 0.1)
    detection: float = bounded(0.9, 0.05, 0.99)
    false_things: int = bounded(1, 0, 20)
    clutter: float = bounded(0.05, 0.0, 20.0)
    alike_s: float = bounded(0.0, 0.0, 7200.0)
    standing: int = bounded(0, 0, 59)


class Overhead:
    """truth(step): poses (n, 3) of the robots in the frame below the observer."""

    def __init__(self, scenario: OverheadScenario) -> None:
        """Raises UserError where no robot drives, or where not all find a place."""
        if scenario.standing >= scenario.robots:
            raise UserError(
                f"standing={scenario.standing} of {scenario.robots} robots cannot be scored",
                "no robot drives, so that no odometry tells one from the others",
                "choose a smaller standing",
            )
        self.scenario = scenario
        self.steps = round(scenario.seconds / STEP_S)
        self._random = np.random.default_rng(scenario.seed)
        self._gains = 1.0 + self._random.normal(0.0, _GAIN_SIGMA, (scenario.robots, 2))
        places = self._places(scenario.robots + scenario.false_things)
        self._false = places[scenario.robots :]
        self._robots = self._drive(places[: scenario.robots])
        self._observer = self._hover()

    def truth(self, step: int) -> FloatArray:
        """x, y (m), heading (rad) of each robot, (n, 3)."""
        own, robots = self._observer[step], self._robots[step]
        return np.column_stack((to_frame(robots[:, :2], own), wrap(robots[:, 2] - own[2])))

    def odometry(self, robot: int, step: int) -> Displacement:
        """What robot `robot` sends of its step (eq. 18's dq_i)."""
        before, after = self._robots[step - 1, robot], self._robots[step, robot]
        dx, dy = self._gains[robot, 0] * to_frame(after[:2], before)
        turned = self._gains[robot, 1] * (after[2] - before[2])
        drives = bool(np.any(after != before))
        return self._noisy(step, (dx, dy, turned), drives * _ODOMETRY_M, drives * _ODOMETRY_RAD)

    def own_motion(self, step: int) -> Displacement:
        """The observer's own step by optical flow and compass (eq. 16, 17: dq_0)."""
        before, after = self._observer[step - 1], self._observer[step]
        dx, dy = to_frame(after[:2], before)
        return self._noisy(step, (dx, dy, after[2] - before[2]), _FLOW_SIGMA_M, _YAW_SIGMA_RAD)

    def readings(self, step: int) -> Positions:
        """One picture: what is found in it, on the floor, in any order."""
        scenario, random = self.scenario, self._random
        roll, pitch = self._tilt(step)
        rotation = attitude(roll, pitch)
        things = np.vstack((self._robots[step, :, :2], self._false))
        floor = to_frame(things, self._observer[step])
        points = projected(floor, rotation, scenario.height_m)
        points += random.normal(0.0, scenario.point_sigma, points.shape)
        found = random.uniform(size=len(points)) < scenario.detection
        most = math.tan(scenario.half_view_rad)
        nothing = random.uniform(-most, most, (random.poisson(scenario.clutter), 2))
        points = np.vstack((points[found & np.all(np.abs(points) < most, axis=1)], nothing))
        measured = (
            roll + random.normal(0.0, _TILT_SIGMA_RAD),
            pitch + random.normal(0.0, _TILT_SIGMA_RAD),
            scenario.height_m + random.normal(0.0, _HEIGHT_SIGMA_M),
        )
        points = random.permutation(points)
        return Positions(
            step * STEP_S,
            on_floor(points, *measured),
            floor_covariances(points, measured, scenario.point_sigma),
        )

    def _places(self, count: int) -> FloatArray:
        """(count, 2) m in the disc, none near another."""
        places: list[FloatArray] = []
        for _ in range(_MOST_TRIES):
            if len(places) == count:
                return self.scenario.radius_m * np.array(places)
            place = self._random.uniform(-1.0, 1.0, 2)
            apart = [np.hypot(*(place - other)) * self.scenario.radius_m for other in places]
            if np.hypot(*place) < 0.9 and all(distance > _APART_M for distance in apart):
                places.append(place)
        raise UserError(
            f"{count} robots and false things do not fit into a disc of {self.scenario.radius_m} m",
            f"they stand {_APART_M} m from each other",
            "choose fewer robots or false_things, or a larger radius_m",
        )

    def _drive(self, places: FloatArray) -> FloatArray:
        """(steps + 1, n, 3) on the floor: random arcs, away from others and from the rim."""
        count = len(places)
        poses = np.zeros((self.steps + 1, count, 3))
        poses[0] = np.column_stack((places, self._random.uniform(-math.pi, math.pi, count)))
        turns, speeds = np.zeros(count), np.zeros(count)
        for step in range(self.steps):
            if step % _COMMAND_STEPS == 0:
                turns = self._random.uniform(-_MOST_RADPS, _MOST_RADPS, count)
                speeds = self._random.uniform(0.4 * _SPEED_MPS, _SPEED_MPS, count)
            speed, turn = self._avoiding(poses[step], speeds.copy(), turns.copy())
            alike = step * STEP_S < self.scenario.alike_s
            if alike and count > 1:
                speed[1], turn[0], turn[1] = speeds[0], turns[0], turns[0]
                speed[0] = speeds[0]
            if self.scenario.standing:
                speed[-self.scenario.standing :] = turn[-self.scenario.standing :] = 0.0
            heading = poses[step, :, 2] + turn * STEP_S / 2.0
            poses[step + 1, :, 0] = poses[step, :, 0] + speed * STEP_S * np.cos(heading)
            poses[step + 1, :, 1] = poses[step, :, 1] + speed * STEP_S * np.sin(heading)
            poses[step + 1, :, 2] = poses[step, :, 2] + turn * STEP_S
        return poses

    def _avoiding(
        self, poses: FloatArray, speeds: FloatArray, turns: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        for robot, (x, y, heading) in enumerate(poses):
            others = np.vstack((np.delete(poses[:, :2], robot, axis=0), self._false))
            away = np.array([x, y]) - others
            distances = np.hypot(*away.T)
            flee = np.zeros(2)
            if len(others) and distances.min() < _APART_M:
                flee = away[np.argmin(distances)]
            elif math.hypot(x, y) > self.scenario.radius_m:
                flee = -np.array([x, y])
            if flee.any():
                off = float(wrap(math.atan2(flee[1], flee[0]) - heading))
                turns[robot] = math.copysign(2.0 * _MOST_RADPS, off)
                speeds[robot] *= 1.0 if abs(off) < 1.0 else 0.0
        return speeds, turns

    def _hover(self) -> FloatArray:
        """(steps + 1, 3): the observer's x, y, yaw over the floor, drifting around the middle."""
        times = STEP_S * np.arange(self.steps + 1)
        phases = self._random.uniform(0.0, 2.0 * math.pi, 3)
        x, y = 0.1 * np.sin(_DRIFT_MPS / 0.1 * times + phases[:2, None])
        return np.column_stack((x, y, phases[2] + _YAW_RADPS * times))

    def _tilt(self, step: int) -> tuple[float, float]:
        roll, pitch = (math.sin(2.0 * math.pi * step * STEP_S / period) for period in _SWAY_S)
        return self.scenario.tilt_rad * roll, self.scenario.tilt_rad * pitch

    def _noisy(
        self, step: int, motion: tuple[float, float, float], metres: float, radians: float
    ) -> Displacement:
        dx, dy, dpsi = np.array(motion) + self._random.normal(0.0, (metres, metres, radians))
        return Displacement(
            step * STEP_S, STEP_S, float(dx), float(dy), float(dpsi), metres**2, radians**2
        )


def attitude(roll: float, pitch: float) -> FloatArray:
    """Eq. 1: the camera's frame (z down its axis) in the level frame at its place (z up)."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return np.array([[cp, sr * sp, cr * sp], [0.0, -cr, sr], [sp, -sr * cp, -cr * cp]])


def projected(floor: FloatArray, rotation: FloatArray, height_m: float) -> FloatArray:
    """Points (n, 2) in the picture, focal lengths, of places (n, 2) m below the observer."""
    places = np.column_stack((floor, np.full(len(floor), -height_m)))
    seen = places @ rotation
    return np.asarray(seen[:, :2] / seen[:, 2:])


def on_floor(points: FloatArray, roll: float, pitch: float, height_m: float) -> FloatArray:
    """Eq. 2 with the depth of each ray, not of the optical axis alone: where it meets the floor.

    points (n, 2) in focal lengths (K is known); (n, 2) m in the level frame below the observer.
    """
    rays = np.column_stack((points, np.ones(len(points)))) @ attitude(roll, pitch).T
    return np.asarray(rays[:, :2] * (-height_m / rays[:, 2:]))


def floor_covariances(
    points: FloatArray, measured: tuple[float, float, float], point_sigma: float
) -> FloatArray:
    """(n, 2, 2) m² of `on_floor`, by central differences in points, attitude and height."""
    sigmas = (_TILT_SIGMA_RAD, _TILT_SIGMA_RAD, _HEIGHT_SIGMA_M)
    columns = [
        on_floor(points + shift, *measured) - on_floor(points - shift, *measured)
        for shift in point_sigma * np.eye(2)
    ]
    for shift in np.diag(sigmas):
        above, below = np.array(measured) + shift, np.array(measured) - shift
        columns.append(on_floor(points, *above) - on_floor(points, *below))
    spread = np.stack(columns, axis=-1) / 2.0
    return np.asarray(spread @ np.swapaxes(spread, 1, 2))
