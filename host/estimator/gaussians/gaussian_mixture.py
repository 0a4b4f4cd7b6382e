"""Gaussian mixtures of planar positions, as columns of one array, and their Kalman steps.

A mixture is `rows` (ROWS, ..., n): one column a component, one row a quantity, so that every step
is a few numpy calls whatever n is. A covariance is kept as its three distinct entries.
"""

import math

import numpy as np

from host.estimator.gaussians.near_pairs import near_pairs
from host.geometry import wrap
from host.messages import Displacement, FloatArray, IntArray

ROWS = 6
X, Y, PXX, PXY, PYY, WEIGHT = range(ROWS)  # m, m²; weight: expected number of targets


def predict_mixture(rows: FloatArray, motion: Displacement, noise: FloatArray | float) -> None:
    """Move the mixture into the robot's new frame, in place (Perera 2021 eq. 7–8, repaired).

    noise: variance (m², per axis) that the targets' own motion adds. The robot rotates counter-
    clockwise by dpsi, so targets rotate by R(dpsi)^T; a heading error moves them across the ray.
    """
    c, s = math.cos(motion.dpsi), math.sin(motion.dpsi)
    flat = rows.reshape(ROWS, -1)
    offset = flat[: Y + 1] - np.array([[motion.dx], [motion.dy]])
    flat[: Y + 1] = np.array([[c, s], [-s, c]]) @ offset
    # R^T P R, of the three entries of P.
    flat[PXX : PYY + 1] = (
        np.array(
            [[c * c, 2 * c * s, s * s], [-c * s, c * c - s * s, c * s], [s * s, -2 * c * s, c * c]]
        )
        @ flat[PXX : PYY + 1]
    )
    x, y = rows[X], rows[Y]
    rows[PXX] += motion.translation_variance + noise + motion.heading_variance * y * y
    rows[PXY] -= motion.heading_variance * x * y
    rows[PYY] += motion.translation_variance + noise + motion.heading_variance * x * x


def gated_pairs(
    rows: FloatArray, positions: FloatArray, covariances: FloatArray, gate: float
) -> tuple[IntArray, IntArray]:
    """Indices (p,), (p,) of the components and readings that may belong together.

    rows (ROWS, n), readings (m, 2) with (m, 2, 2). Kept is at least every pair within `gate`
    (squared Mahalanobis distance), as the trace bounds the longest axis.
    """
    n, m = rows.shape[1], len(positions)
    if not n or not m:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    noise = (covariances[:, 0, 0] + covariances[:, 1, 1]).max()
    reach = gate * (rows[PXX] + rows[PYY] + noise)
    return near_pairs(rows[: Y + 1], reach, positions.T)


def update_by_positions(
    prior: FloatArray, positions: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Kalman updates by position readings, H = I (eq. 13, 14, 16).

    prior (ROWS, ..., p), their readings (2, ..., p) m and the readings' noise (3, ..., p): xx, xy,
    yy in m². Returns the updated rows, weights untouched, and N(innovation; 0, S) (..., p), 1/m².
    For 2x2 matrices P - P S^-1 P = (|R| P + |P| R) / |S|, which needs no cancelling difference.
    """
    p, r = prior[PXX : PYY + 1], noise
    sxx, sxy, syy = p + r
    inverse = 1.0 / (sxx * syy - sxy * sxy)
    dx, dy = positions - prior[: Y + 1]
    ax, ay = (syy * dx - sxy * dy) * inverse, (sxx * dy - sxy * dx) * inverse
    updated = np.empty_like(prior)
    updated[X] = prior[X] + p[0] * ax + p[1] * ay
    updated[Y] = prior[Y] + p[1] * ax + p[2] * ay
    from_prior = (r[0] * r[2] - r[1] * r[1]) * inverse
    from_reading = (p[0] * p[2] - p[1] * p[1]) * inverse
    updated[PXX : PYY + 1] = from_prior * p + from_reading * r
    updated[WEIGHT] = prior[WEIGHT]
    square = np.maximum(dx * ax + dy * ay, 0.0)  # rounding can leave a little less
    likelihood = np.exp(-0.5 * square) * np.sqrt(inverse) * (0.5 / math.pi)
    return updated, likelihood


def update_by_bearings(
    prior: FloatArray, bearings: FloatArray, noise: float, origin: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Extended Kalman updates by bearing readings (eq. 25, 26, 28, repaired).

    prior (ROWS, p), their readings (p,) rad, seen from `origin` (x, y) m, and the readings' noise,
    rad². Returns the updated rows, weights untouched, and N(innovation; 0, S) (p,), 1/rad.
    The innovation is a wrapped angle and H = (-y, x) / r², both from the rays' origin.
    """
    dx, dy = prior[X] - origin[0], prior[Y] - origin[1]
    square = np.maximum(dx * dx + dy * dy, 1e-6)
    hx, hy = -dy / square, dx / square
    px = prior[PXX] * hx + prior[PXY] * hy  # P H^T
    py = prior[PXY] * hx + prior[PYY] * hy
    variance = hx * px + hy * py + noise  # S
    innovation = wrap(bearings - np.arctan2(dy, dx))
    likelihood = np.exp(-0.5 * innovation * innovation / variance)
    likelihood /= np.sqrt(2.0 * math.pi * variance)
    kx, ky = px / variance, py / variance
    updated = prior.copy()
    updated[: PYY + 1] += (kx * innovation, ky * innovation, -kx * px, -kx * py, -ky * py)
    return updated, likelihood


def match_moments(rows: FloatArray, into: IntArray, centres: FloatArray) -> FloatArray:
    """Merge components (ROWS, ..., N) into k ones of the same weight, mean and covariance.

    into (N,): which one each goes to. centres (2, ..., k) m: a point near those that go to each,
    about which moments are taken so that nothing is lost to cancellation. Weights must be > 0.
    """
    size = centres.shape[-1]
    share = rows[WEIGHT]
    offset = rows[: Y + 1] - centres.take(into, axis=-1)
    sums = np.empty_like(rows)
    sums[: Y + 1] = weighted = share * offset
    sums[PXX : PYY + 1] = share * rows[PXX : PYY + 1]
    sums[PXX] += weighted[X] * offset[X]
    sums[PXY] += weighted[X] * offset[Y]
    sums[PYY] += weighted[Y] * offset[Y]
    sums[WEIGHT] = share
    # All rows in one pass: row k is summed into the bins from k * size on.
    count = sums.size // max(len(into), 1)
    bins = into + size * np.arange(count)[:, None]
    totals = np.bincount(bins.ravel(), sums.ravel(), count * size)
    merged = np.asarray(totals, dtype=np.float64).reshape(*rows.shape[:-1], size)
    merged[:WEIGHT] /= merged[WEIGHT]
    x, y = merged[X], merged[Y]
    merged[PXX] -= x * x
    merged[PXY] -= x * y
    merged[PYY] -= y * y
    merged[: Y + 1] += centres
    return merged
