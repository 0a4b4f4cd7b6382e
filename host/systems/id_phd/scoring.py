"""What beliefs in identities are worth: how many are there, how many right, how near."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from host.geometry import wrap
from host.messages import FloatArray
from host.systems.id_phd.id_phd import Belief

REPORTED, SURE = 0.5, 0.9  # probabilities from which on a belief is reported, and claimed
_RIGHT_M = 0.5  # a belief further from its robot is not right, whoever else is near


@dataclass(frozen=True, slots=True)
class Sample:
    """What was believed of one robot at one instant; probability 0 and nan where nothing was.

    right: the robot nearest to the belief is the one it names. error_m, error_rad: of its pose.
    """

    probability: float
    right: bool
    error_m: float
    error_rad: float


def samples(
    beliefs: Sequence[Belief], truth: dict[int, FloatArray], asked: Iterable[int]
) -> list[Sample]:
    """Of each identity of `asked`. truth: the pose (3,) of every robot in the observer's frame."""
    by_identity = {belief.identity: belief for belief in beliefs}
    return [_sample(by_identity.get(identity), truth, identity) for identity in asked]


def _sample(belief: Belief | None, truth: dict[int, FloatArray], identity: int) -> Sample:
    if belief is None:
        return Sample(0.0, False, math.nan, math.nan)
    distances = {name: math.dist(pose[:2], belief.pose[:2]) for name, pose in truth.items()}
    error_m = distances[identity]
    right = error_m < _RIGHT_M and error_m == min(distances.values())
    off = float(wrap(belief.pose[2] - truth[identity][2]))
    return Sample(belief.probability, right, error_m, abs(off))


def figures(found: Sequence[Sample]) -> dict[str, float]:
    """Shares of what was asked for, and medians of the errors where the identity is right.

    reported: with more than .5. right: of these. sure: with more than .9. sure_right: of these.
    """
    reported = [each for each in found if each.probability > REPORTED]
    sure = [each for each in found if each.probability > SURE]
    right = [each for each in reported if each.right]
    return {
        "reported": len(reported) / len(found) if found else math.nan,
        "right": _share(reported),
        "sure": len(sure) / len(found) if found else math.nan,
        "sure_right": _share(sure),
        "error_m": _median([each.error_m for each in right]),
        "heading_deg": math.degrees(_median([each.error_rad for each in right])),
    }


def _share(found: Sequence[Sample]) -> float:
    return sum(each.right for each in found) / len(found) if found else math.nan


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan
