"""How late a sensor is: a scan over delays, then the delay fitted together with the mounting.

A reading stamped t was made at t - delay. On some paths (a circle at constant speed) a delay and a
rotation of the sensor are the same thing; the curvature at the least cost does not show that, the
curve as a whole does: it is flat.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.calibration.robust.statistics import (
    bent_factor,
    block_sums,
    blocks_of,
    check_rows,
    plane_sigma,
    sandwich,
)
from host.errors import UserError
from host.geometry import rotation, to_parent
from host.messages import FloatArray

_TUKEY = 4.685  # 95 % efficient where errors are normal
_ROUNDS, _SETTLED = 50, 1e-8
_SLOPE_S = 0.01  # half the interval over which the true path's velocity is taken
_LEAST_PAIRS = 12
_SINGULAR, _LEAST_SIGMA = 1e-10, 1e-12
CORRELATED_S = 3.0  # errors further apart in time are taken to be independent


@dataclass(frozen=True, slots=True)
class DelayCurve:
    """What the best fit costs at each delay: delays (k,) s, ascending, and costs (k,)."""

    delays: FloatArray
    costs: FloatArray

    @property
    def best(self) -> float:
        """The delay (s) of least cost: of the parabola through the least one and its neighbours."""
        index = int(np.argmin(self.costs))
        if not 0 < index < len(self.costs) - 1:
            return float(self.delays[index])
        before, here, after = self.costs[index - 1 : index + 2]
        bend = before - 2.0 * here + after
        share = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
        return float(self.delays[index] + share * (self.delays[index + 1] - self.delays[index]))

    def interval(self, rise: float) -> tuple[float, float]:
        """Confidence interval of the delay: low and high (s).

        rise: of the cost above the least one that is significant. Another dip as deep lies inside,
        too. The interval goes from the last delay below it whose cost is significantly higher to
        the first such one above it, or to the end of the scan where there is none.
        """
        inside = np.flatnonzero(self.costs <= float(self.costs.min()) + rise)
        first = max(int(inside[0]) - 1, 0)
        last = min(int(inside[-1]) + 1, len(self.costs) - 1)
        return float(self.delays[first]), float(self.delays[last])


def scan(cost: Callable[[float], float], low: float, high: float, step: float) -> DelayCurve:
    """The cost of the best fit at each delay from `low` to `high` (s), every `step`.

    cost(delay): of everything else fitted at that delay, by a robust measure that does not change
    with the delay (such as the mean of squared errors, each cut off at a fixed bound). Raises
    ValueError for no delays, and where the cost of one is not finite.
    """
    if not (step > 0.0 and low <= high):
        raise ValueError(f"no delays from {low} to {high} s every {step} s")
    count = round((high - low) / step) + 1
    delays = np.linspace(low, low + step * (count - 1), count)
    costs = np.array([cost(float(delay)) for delay in delays])
    check_rows("costs", costs, (count,))
    return DelayCurve(delays, costs)


@dataclass(frozen=True, slots=True)
class JointFit:
    """A sensor's mounting and delay at once.

    values (5,): x, y (m), heading (rad), delay (s), and by how much it measures too far (m).
    covariance (5, 5): of these; infinite where the path does not separate them. errors (n, 2) m:
    where each reading lies, less the truth, nan where there is none; the last value is left in.
    weights (n,): from 0 (a wrong pair) to 1.
    """

    values: FloatArray
    covariance: FloatArray
    errors: FloatArray
    weights: FloatArray


def fit_jointly(
    points: FloatArray,
    times: FloatArray,
    sigmas: FloatArray,
    truth: Callable[[FloatArray], FloatArray],
    start: FloatArray,
) -> JointFit:
    """Mounting and delay that take a sensor's points (n, 2) m, stamped `times` (n,), to the truth.

    sigmas (n,): standard deviations of the points per axis, up to a common factor. truth: where
    the things measured were in the robot frame, (n, 2) m at any times (n,); nan where unknown.
    start (5,): values to begin with, whose wrong pairs are less than half. Gauss-Newton with
    Tukey's weights; the covariance is a sandwich over blocks of 3 s, the errors' correlation time.
    Raises UserError where fewer than 12 pairs have a truth, ValueError for what can be no numbers
    of readings.

    That all ranges are too long is fitted too: where teammates were not seen evenly all around,
    it would pass for a mounting that is off.
    """
    count, values = len(points), np.array(start, dtype=float)
    check_rows("points", points, (count, 2))
    check_rows("times", times, (count,))
    check_rows("sigmas", sigmas, (count,), _LEAST_SIGMA)
    check_rows("start values", values, (5,))
    for _ in range(_ROUNDS):
        errors, slopes, weights, _ = linearise(points, times, sigmas, truth, values)
        strength = weights / sigmas**2
        normal = np.einsum("n,nai,naj->ij", strength, slopes, slopes)
        gradient = np.einsum("n,nai,na->i", strength, slopes, errors)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        # Without its weakest directions: what is not observable stays at the start.
        step = np.linalg.lstsq(normal / np.outer(size, size), gradient / size, rcond=_SINGULAR)[0]
        values = values - step / size
        if np.abs(step / size).max() < _SETTLED:
            break
    errors, slopes, weights, bends = linearise(points, times, sigmas, truth, values)
    covariance = _sandwich(errors, slopes, weights, bends, sigmas, times)
    placed = to_parent(points, values[:3])
    return JointFit(values, covariance, placed - truth(times - values[3]), weights)


def linearise(
    points: FloatArray,
    times: FloatArray,
    sigmas: FloatArray,
    truth: Callable[[FloatArray], FloatArray],
    values: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Errors (n, 2), their slopes (n, 2, 5), Tukey's weights (n,), and how these fall (n,).

    Without a truth, all are 0.
    """
    x, y, heading, delay, too_far = values
    rotated = points @ rotation(heading).T
    beams = rotated / np.maximum(np.hypot(*rotated.T), 1e-9)[:, None]
    placed = rotated - too_far * beams
    errors = placed + np.array([x, y]) - truth(times - delay)
    velocity = truth(times - delay + _SLOPE_S) - truth(times - delay - _SLOPE_S)
    slopes = np.zeros((len(points), 2, len(values)))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
    slopes[:, 0, 2], slopes[:, 1, 2] = -placed[:, 1], placed[:, 0]
    slopes[:, :, 3] = velocity / (2.0 * _SLOPE_S)
    slopes[:, :, 4] = -beams
    known = np.isfinite(errors).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
    if np.count_nonzero(known) < _LEAST_PAIRS:
        raise UserError(
            "too few readings to fit a delay",
            f"{np.count_nonzero(known)} were made while motion capture saw both robots",
            "record for longer, with both robots in view of motion capture",
        )
    errors[~known], slopes[~known] = 0.0, 0.0
    relative = np.hypot(*errors.T) / sigmas
    bound = _TUKEY * max(plane_sigma(relative[known]), 1e-9)
    root = np.where(known, np.maximum(1.0 - (relative / bound) ** 2, 0.0), 0.0)
    return errors, slopes, root**2, -4.0 * root / bound**2


def _sandwich(
    errors: FloatArray,
    slopes: FloatArray,
    weights: FloatArray,
    bends: FloatArray,
    sigmas: FloatArray,
    times: FloatArray,
) -> FloatArray:
    """Covariance (5, 5) of the fit, by how much sums of its gradient scatter over blocks."""
    scaled, tilted = errors / sigmas[:, None], slopes / sigmas[:, None, None]
    pulls = np.einsum("na,nai->ni", scaled, tilted)
    hessian = np.einsum("n,nai,naj->ij", weights, tilted, tilted) + (pulls.T * bends) @ pulls
    sums = block_sums(weights[:, None] * pulls, blocks_of(times, CORRELATED_S))
    size = np.sqrt(np.maximum(np.abs(np.diag(hessian)), 1e-300))
    relative = hessian / np.outer(size, size)
    if len(sums) <= len(size) or np.linalg.eigvalsh(relative)[0] < _SINGULAR:
        return np.full((len(size), len(size)), math.inf)
    back = np.linalg.inv(relative) / np.outer(size, size)
    return sandwich(back, bent_factor(len(sums), len(size)) * sums.T @ sums)
