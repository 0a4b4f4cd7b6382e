"""Robots in formation on their own estimates, beside the same controllers on the truth.

    python tools/formations.py [circle enclose line ...] [--seeds 1-3] [--disturb lost]

For each: shape error (m, rms of the robots from the nearest such shape, mean of the last 10 s),
when it had formed (s: from then on below 15 cm for 2 s), how near two robots came (m), contacts.
--disturb: for 5 s in the middle nobody knows the teammate nearest to it, or all see a ghost; a
robot is taken away for good; or labels are exchanged.
"""

import math
import multiprocessing
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import click
import numpy as np

from host.behaviour.catalogue import FORMATIONS
from host.behaviour.formations.circle import RADIUS_M
from host.behaviour.formations.line import Line, main_axis
from host.behaviour.interface import Behaviour, Command, Situation
from host.config import RobotConfig
from host.geometry import to_frame, to_parent
from host.messages import Estimate, FloatArray, IntArray
from host.sessions.offline.swarming import Swarm
from host.simulation.world.arena import ARENA_STEP_S, Arena
from host.simulation.world.scenarios import parse_scenario

FORMED_M, FORMED_S, LAST_S, EVERY_S = 0.15, 2.0, 10.0, 0.2
DISTURBANCES = ("nothing", "lost", "ghost", "removed", "swap")
DISTURBED_S = 5.0
TAKEN = 1  # which robot is carried away


def circle_error(robots: FloatArray, intruder: FloatArray | None) -> float:
    """To even places on the circle around the intruder, or the robots' centroid."""
    count = len(robots)
    around = robots - (robots.mean(axis=0) if intruder is None else intruder)
    angles = np.arctan2(around[:, 1], around[:, 0])
    order = np.argsort(angles)
    even = math.tau * np.arange(count) / count
    shift = float(np.angle(np.mean(np.exp(1j * (angles[order] - even)))))
    places = RADIUS_M * np.column_stack((np.cos(even + shift), np.sin(even + shift)))
    return rms(around[order] - places)


def line_error(robots: FloatArray, intruder: FloatArray | None) -> float:
    """To even places on a line, Line's spacing apart."""
    around = robots - robots.mean(axis=0)
    axis = main_axis(robots)
    along = np.sort(around @ axis)
    even = Line().spacing_m * (np.arange(len(robots)) - 0.5 * (len(robots) - 1))
    across = around @ (-axis[1], axis[0])
    return rms(np.column_stack((along - even, across)))


def spread(robots: FloatArray, intruder: FloatArray | None) -> float:
    """From the centroid; robots that do not touch end at .4 m or so."""
    return rms(robots - robots.mean(axis=0))


def rms(offsets: FloatArray) -> float:
    """Root of the mean squared length of offsets (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(offsets**2, axis=1))))


ERRORS: dict[str, Callable[[FloatArray, FloatArray | None], float]] = {
    "circle": circle_error,
    "enclose": circle_error,
    "gather": spread,
    "line": line_error,
    "platoon": circle_error,
}


class Under:
    """A behaviour on the truth, or with what it knows disturbed.

    truth: the arena and the robot's number in it; None: its own estimates.
    """

    def __init__(self, behaviour: Behaviour, disturbance: str, middle_s: float) -> None:
        self._behaviour, self._disturbance, self._middle_s = behaviour, disturbance, middle_s
        self.truth: tuple[Arena, int] | None = None
        self._place: FloatArray | None = None  # of what is lost or a ghost, in the odometry

    def command(self, now: Situation) -> Command | None:
        """What the behaviour says to it."""
        estimate = now.estimate if self.truth is None else _true(*self.truth, now.time)
        if estimate is not None and self._disturbance != "nothing":
            estimate = self._disturbed(estimate, now)
        return self._behaviour.command(replace(now, estimate=estimate))

    def _disturbed(self, estimate: Estimate, now: Situation) -> Estimate:
        if self._disturbance == "swap":  # once, while those that watch for an intruder watch
            return replace(estimate, labels=np.roll(estimate.labels, int(now.time > 2.0)))
        if not 0.0 <= now.time - self._middle_s < DISTURBED_S or not len(estimate.positions):
            return estimate
        pose = np.array(now.pose)
        if self._disturbance == "ghost":
            if self._place is None:
                self._place = to_parent(np.array([0.6, 0.2]), pose)
            return _with_ghost(estimate, to_frame(self._place, pose))
        if self._disturbance == "lost":
            near = np.zeros(2) if self._place is None else to_frame(self._place, pose)
            lost = int(np.argmin(np.hypot(*(estimate.positions - near).T)))
            self._place = to_parent(estimate.positions[lost], pose)
            return _rows(estimate, np.delete(np.arange(len(estimate.labels)), lost))
        return estimate


def _rows(estimate: Estimate, rows: IntArray) -> Estimate:
    return replace(
        estimate,
        positions=estimate.positions[rows],
        covariances=estimate.covariances[rows],
        weights=estimate.weights[rows],
        ages=estimate.ages[rows],
        labels=estimate.labels[rows],
    )


def _with_ghost(estimate: Estimate, place: FloatArray) -> Estimate:
    """One more teammate at a place (2,); the rest of it is the last one's."""
    count = len(estimate.labels)
    more = _rows(estimate, np.append(np.arange(count), count - 1))
    more.positions[-1], more.labels[-1] = place, -1
    return more


def _true(arena: Arena, robot: int, time: float) -> Estimate:
    (poses,) = arena.poses(np.array([arena.now]))
    others = to_frame(np.delete(poses, robot, axis=0)[:, :2], poses[robot])
    count = len(others)
    covariances = np.tile(1e-6 * np.eye(2), (count, 1, 1))
    return Estimate(time, others, covariances, np.ones(count), np.zeros(count), np.arange(count))


@dataclass(frozen=True, slots=True)
class Case:
    """One run: a formation, its settings of the scenario, and what is done to it."""

    formation: str
    seed: int
    seconds: float
    disturbance: str
    truth: bool


@dataclass(frozen=True, slots=True)
class Formed:
    """How a run went: error m, when formed s (inf: never), nearest m, contacts of ours.

    circle: mean radius m and largest angular gap deg of the last 10 s.
    """

    case: Case
    error: float
    formed: float
    nearest: float
    contacts: int
    circle: tuple[float, float]


def run(case: Case) -> Formed:
    """Let the robots of one case form."""
    base = "enclosure7" if case.formation == "enclose" else "formation6"
    scenario = parse_scenario(
        f"{base}:behaviour={case.formation},seconds={case.seconds},seed={case.seed}"
    )
    own = scenario.robots - scenario.intruders
    middle = 0.5 * case.seconds
    made = [Under(FORMATIONS[case.formation](), case.disturbance, middle) for _ in range(own)]
    swarm = Swarm(scenario, RobotConfig(), made.__getitem__)
    if case.truth:
        for robot, behaviour in enumerate(made):
            behaviour.truth = swarm.arena, robot
    poses = []
    for step in range(round(case.seconds / ARENA_STEP_S) + 1):
        if case.disturbance == "removed" and step == round(middle / ARENA_STEP_S):
            swarm.take_away(TAKEN)
        swarm.step(step)
        if step % round(EVERY_S / ARENA_STEP_S) == 0:
            poses.append(swarm.arena.poses(np.array([step * ARENA_STEP_S]))[0, :, :2])
    return judged(case, np.array(poses), list(swarm.stacks), len(swarm.contacts))


def judged(case: Case, poses: FloatArray, left: Sequence[int], contacts: int) -> Formed:
    """The figures of a run: places (k, n, 2) of all robots, the intruder last; left: in the end."""
    intruded = case.formation == "enclose"
    shapes = [ERRORS[case.formation](at[left], at[-1] if intruded else None) for at in poses]
    apart = np.hypot(*(poses[:, left, None] - poses[:, None, left]).transpose(3, 0, 1, 2))
    nearest = apart[:, *np.triu_indices(len(left), 1)].min()
    last = round(LAST_S / EVERY_S)
    centres = poses[:, -1] if intruded else poses[:, left].mean(axis=1)
    x, y = (poses[-last:, left] - centres[-last:, None]).transpose(2, 0, 1)
    bearings = np.sort(np.arctan2(y, x), axis=1)
    gaps = np.diff(bearings, axis=1, append=bearings[:, :1] + math.tau)
    circle = float(np.hypot(x, y).mean()), math.degrees(float(gaps.max(axis=1).mean()))
    error = float(np.mean(shapes[-last:]))
    return Formed(case, error, formed_at(shapes), float(nearest), contacts, circle)


def formed_at(errors: Sequence[float]) -> float:
    """When (s) errors, one every EVERY_S, first stay below FORMED_M for FORMED_S; inf: never."""
    within = np.array(errors) < FORMED_M
    run_length = round(FORMED_S / EVERY_S)
    windows = np.lib.stride_tricks.sliding_window_view(within, run_length).all(axis=1)
    return float(np.argmax(windows) * EVERY_S) if windows.any() else math.inf


def line_of(done: Formed) -> str:
    """A run in words."""
    case = done.case
    return (
        f"{case.formation:8} seed {case.seed:3} {'truth    ' if case.truth else 'estimates'}: "
        f"error {done.error:.3f} m, formed {done.formed:5.1f} s, nearest {done.nearest:.2f} m, "
        f"{done.contacts} contacts, radius {done.circle[0]:.2f} m, gap {done.circle[1]:.0f} deg"
    )


def sums(name: str, results: Sequence[Formed]) -> str:
    """Estimates beside the truth, over all seeds."""
    own, true = ([r for r in results if r.case.truth is truth] for truth in (False, True))
    errors, times = (
        [
            (float(np.mean([getattr(r, key) for r in runs])) if runs else math.nan)
            for runs in (own, true)
        ]
        for key in ("error", "formed")
    )
    return (
        f"{name}: error {errors[0]:.3f} m (truth {errors[1]:.3f}: x{errors[0] / errors[1]:.2f}), "
        f"formed {times[0]:.1f} s (truth {times[1]:.1f}: x{times[0] / times[1]:.2f}), "
        f"{sum(r.contacts for r in own)} contacts in {len(own)} runs"
    )


@click.command(help=__doc__)
@click.argument("names", nargs=-1, type=click.Choice(sorted(ERRORS)))
@click.option("--seeds", default="1-3", show_default=True, help="First and last.")
@click.option("--seconds", default=40.0, show_default=True, help="Of each run.")
@click.option("--disturb", type=click.Choice(DISTURBANCES), default="nothing")
@click.option("--workers", default=os.cpu_count(), show_default=True, help="Runs at a time.")
def main(names: tuple[str, ...], seeds: str, seconds: float, disturb: str, workers: int) -> None:
    """Print a line a run, and the sums."""
    first, last = map(int, seeds.split("-"))
    names = names or tuple(sorted(ERRORS))
    cases = [
        Case(name, seed, seconds, disturb, truth)
        for name in names
        for seed in range(first, last + 1)
        for truth in (False, True)
    ]
    results = []
    with multiprocessing.Pool(workers) as pool:
        for done in pool.imap_unordered(run, cases):
            results.append(done)
            print(line_of(done), flush=True)
    for name in names:
        print(sums(name, [r for r in results if r.case.formation == name]))


if __name__ == "__main__":
    main()
