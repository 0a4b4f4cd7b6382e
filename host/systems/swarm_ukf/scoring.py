"""A map of a swarm, laid on the truth without reflection (Miller 2019, section III-A)."""

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from host.geometry import rotation, wrap
from host.messages import Displacement, FloatArray, Positions
from host.systems.swarm_ukf.swarm import SwarmUkf

Event = tuple[int, Displacement | Positions]  # which robot, and what it reports
_ARRIVED_S = 0.2  # after an instant all odometry up to it has arrived
_LEAST_EIGENVALUE = 1e-9  # of the largest: below it a direction is the free frame's


def laid(poses: FloatArray, truth: FloatArray) -> FloatArray:
    """Poses (n, 3) moved as a whole so that positions fit those of `truth` with least squares.

    Kabsch 1976 in the plane, where the best rotation is the angle of a sum: never a reflection.
    """
    own, true = poses[:, :2] - poses[:, :2].mean(axis=0), truth[:, :2] - truth[:, :2].mean(axis=0)
    angle = float(np.angle(np.sum(np.conj(own @ (1.0, 1.0j)) * (true @ (1.0, 1.0j)))))
    positions = own @ rotation(angle).T + truth[:, :2].mean(axis=0)
    return np.column_stack((positions, poses[:, 2] + angle))


@dataclass
class SwarmScore:
    """errors: (n,) m and heading_errors: (n,) rad of each scored instant; nees a degree of freedom.

    scored: instants with truth. started s: when there first was a map. solve_s, update_s: processor
    time of the start and of all that followed.
    """

    errors: list[FloatArray] = field(default_factory=list)
    heading_errors: list[FloatArray] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    scored: int = 0
    started: float = math.nan
    solve_s: float = 0.0
    update_s: float = 0.0

    def add(self, swarm: SwarmUkf, truth: FloatArray) -> None:
        """Score one instant: poses (n, 3) of `truth` in any frame."""
        self.scored += 1
        if swarm.map is None:
            return
        fitted = laid(swarm.map.poses, truth)
        error = fitted - truth
        error[:, 2] = wrap(error[:, 2])
        self.errors.append(np.hypot(error[:, 0], error[:, 1]))
        self.heading_errors.append(np.abs(error[:, 2]))
        self.nees.append(_nees(swarm, error, float(fitted[0, 2])))

    def figures(self) -> dict[str, float]:
        """Mean errors, NEES a degree of freedom, share of the time with a map, processor times."""
        if not self.errors:
            return {"observable": 0.0}
        return {
            "error_m": float(np.mean(self.errors)),
            "heading_deg": math.degrees(float(np.mean(self.heading_errors))),
            "nees": float(np.mean(self.nees)),
            "observable": len(self.errors) / self.scored,
            "started_s": self.started,
            "solve_ms": 1e3 * self.solve_s,
            "second_ms": 1e3 * self.update_s / len(self.errors),
        }


def _nees(swarm: SwarmUkf, error: FloatArray, heading: float) -> float:
    """Normalised squared error of errors (n, 3) in the truth's frame; 3n - 3 degrees of freedom."""
    if swarm.map is None:
        return math.nan
    own = error.copy()
    own[:, :2] = error[:, :2] @ rotation(heading - float(swarm.map.poses[0, 2]))
    values, vectors = np.linalg.eigh(swarm.map.covariance)
    held = values > _LEAST_EIGENVALUE * values[-1]
    along = own.ravel() @ vectors[:, held]
    return float(np.sum(along**2 / values[held]) / held.sum())


def score_swarm(
    swarm: SwarmUkf,
    events: Iterable[Event],
    instants: Sequence[float],
    truth: Callable[[float], FloatArray],
) -> SwarmScore:
    """Run `swarm` on events in order of time, and score it at `instants` (s) against `truth`."""
    score = SwarmScore()
    waiting = iter(events)
    event = next(waiting, None)
    for instant in instants:
        while event is not None and event[1].time <= instant + _ARRIVED_S:
            swarm.take(*event)
            event = next(waiting, None)
        before, begin = swarm.map is None, time.process_time()
        swarm.run_until(instant)
        spent = time.process_time() - begin
        if not before:
            score.update_s += spent
        elif swarm.map is not None:
            score.started, score.solve_s = instant, spent
        score.add(swarm, truth(instant))
    return score
