"""The rotation and translation between two sets of points in the plane, some of them wrong pairs.

Arun 1987 (Belaroussi 2024, section 4.4.1): centre both sets, and take the rotation out of the
singular value decomposition of their covariance. Where points lie nearly on a line, that gives a
reflection as readily as a rotation; Umeyama 1991 (eq. 39-40) corrects the sign.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.robust.statistics import check_rows, plane_sigma
from host.errors import UserError
from host.geometry import to_parent
from host.messages import BoolArray, FloatArray

_ROUNDS = 20
_GATE_SIGMAS = 3.5
_NO_SPREAD = 1e-9


@dataclass(frozen=True, slots=True)
class Alignment:
    """to = R(heading) from + (x, y), for points of the plane in metres.

    covariance (3, 3): of x, y (m) and heading (rad), as far as errors of pairs are independent.
    inliers (n,): the pairs that were used. rms m: of the length of their errors.
    """

    x: float
    y: float
    heading: float
    covariance: FloatArray
    inliers: BoolArray
    rms: float

    @property
    def pose(self) -> FloatArray:
        """x, y (m) and heading (rad) of the frame of `from`: (3,)."""
        return np.array([self.x, self.y, self.heading])

    def apply(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) m of the one frame, in the other."""
        return to_parent(points, self.pose)


def align(
    from_points: FloatArray, to_points: FloatArray, weights: FloatArray | None = None
) -> Alignment:
    """The rigid motion that takes points (n, 2) m to their partners (n, 2) with least squares.

    weights (n,): inverse variances up to a common factor; a pair of weight 0 is no inlier. Raises
    UserError for fewer than three pairs, and where the points all lie in one place; ValueError for
    arrays of other shapes, numbers that are not finite, and negative weights.
    """
    weights = np.ones(len(from_points)) if weights is None else np.asarray(weights, dtype=float)
    _check_numbers(from_points, to_points, weights)
    used = weights > 0.0
    if np.count_nonzero(used) < 3:
        raise UserError(
            "too few points to align",
            f"{np.count_nonzero(used)} pairs, where three are the least",
            "record for longer, with the teammate in plain view",
        )
    share = weights / weights.sum()
    from_middle, to_middle = share @ from_points, share @ to_points
    source, target = from_points - from_middle, to_points - to_middle
    covariance = (share[:, None] * target).T @ source
    u, singular, v = np.linalg.svd(covariance)
    guard = np.linalg.det(u) * np.linalg.det(v)
    spread = float(np.sqrt(share @ np.sum(source**2, axis=1) * (share @ np.sum(target**2, axis=1))))
    size = float(np.abs(np.concatenate((from_middle, to_middle))).max())
    if not singular[0] + guard * singular[1] > _NO_SPREAD * max(spread, _NO_SPREAD * size**2):
        raise UserError(
            "the points do not determine a rotation",
            "they lie in one place, or go no way together",
            "drive so that the teammate is seen in many places",
        )
    rotating = u @ np.diag((1.0, guard)) @ v
    x, y = to_middle - rotating @ from_middle
    errors = target - source @ rotating.T
    return Alignment(
        x=float(x),
        y=float(y),
        heading=math.atan2(rotating[1, 0], rotating[0, 0]),
        covariance=_covariance(source, rotating @ from_middle, errors, weights),
        inliers=used,
        rms=float(np.sqrt(np.mean(np.sum(errors[used] ** 2, axis=1)))),
    )


def _check_numbers(from_points: FloatArray, to_points: FloatArray, weights: FloatArray) -> None:
    """Raise ValueError, as text, for what cannot be points and weights."""
    count = len(from_points)
    if not count:
        raise ValueError("there are no points to align")
    check_rows("points", from_points, (count, 2))
    check_rows("partners", to_points, (count, 2))
    check_rows("weights", weights, (count,), 0.0)


def _covariance(
    source: FloatArray, rotated_middle: FloatArray, errors: FloatArray, weights: FloatArray
) -> FloatArray:
    """Covariance (3, 3) of x, y and heading, by the scatter of the errors (n, 2) themselves.

    About the middle of the points, rotation and translation are independent; the translation of
    the frame's origin has the rotation in it.
    """
    freedom = 2 * np.count_nonzero(weights) - 3
    variance = float(weights @ np.sum(errors**2, axis=1)) / freedom
    angle = variance / float(weights @ np.sum(source**2, axis=1))
    lever = np.array([rotated_middle[1], -rotated_middle[0], 1.0])
    found: FloatArray = angle * np.outer(lever, lever)
    found[0, 0] += variance / weights.sum()
    found[1, 1] += variance / weights.sum()
    return found


def align_robustly(
    from_points: FloatArray,
    to_points: FloatArray,
    error_m: float,
    start: FloatArray,
    weights: FloatArray | None = None,
) -> Alignment:
    """The rigid motion that most pairs agree on, though more than half of them may be wrong.

    error_m: the largest error (m) that a right pair may have; wrong ones need not have less. From
    a pose `start` (3,) the fit is repeated with the pairs near it alone, until they stay the same:
    near is 3.5 times their own scatter, and `error_m` at most. Raises UserError and ValueError as
    `align` does, and UserError where no three pairs agree.
    """
    weights = np.ones(len(from_points)) if weights is None else np.asarray(weights, dtype=float)
    _check_numbers(from_points, to_points, weights)
    errors = np.hypot(*(to_parent(from_points, start) - to_points).T)
    inliers = errors <= error_m
    found = _align_inliers(from_points, to_points, weights, inliers)
    for _ in range(_ROUNDS):
        errors = np.hypot(*(found.apply(from_points) - to_points).T)
        relative = errors * np.sqrt(weights)
        near = errors <= error_m
        if not near.any():
            break
        scatter = plane_sigma(relative[near])
        last, inliers = inliers, near & (relative <= _GATE_SIGMAS * scatter)
        found = _align_inliers(from_points, to_points, weights, inliers)
        if np.array_equal(last, inliers):
            break
    return found


def _align_inliers(
    from_points: FloatArray, to_points: FloatArray, weights: FloatArray, inliers: BoolArray
) -> Alignment:
    if np.count_nonzero(inliers) < 3:
        raise UserError(
            "no rotation and translation that pairs of points agree on",
            f"{np.count_nonzero(inliers)} of {len(inliers)} pairs agree",
            "see that the numbers of the bodies are those of the robots meant",
        )
    return align(from_points, to_points, np.where(inliers, weights, 0.0))
