"""Gaussian mixtures of planar positions, as columns of one array, and their Kalman steps.

A mixture is `rows` (ROWS, ..., n): one column a component, one row a quantity, so that every step
is a few numpy calls whatever n is. A covariance is kept as its three distinct entries.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from host.geometry import wrap
from host.messages import Bearings, Displacement, FloatArray, IntArray

ROWS = 6
X, Y, PXX, PXY, PYY, WEIGHT = range(ROWS)  # m, m²; weight: expected number of targets

_DENSE_PAIRS = 4096  # up to here a full distance table is faster than a KD-tree
_NEIGHBOURS = 8  # readings a component may be paired with when the tree is used


def carry(rows: FloatArray, motion: Displacement, noise: FloatArray | float) -> None:
    """Move the mixture into the robot's new frame, in place (Perera 2021 eq. 7–8, repaired).

    noise: variance (m², per axis) that the targets' own motion adds. The robot turns counter-
    clockwise by dpsi, so targets turn by R(dpsi)^T; a heading error moves them across the ray.
    """
    c, s = math.cos(motion.dpsi), math.sin(motion.dpsi)
    x, y, pxx, pxy, pyy = rows[: PYY + 1]
    ux, uy = x - motion.dx, y - motion.dy
    x, y = c * ux + s * uy, c * uy - s * ux
    cs, cc, ss = c * s, c * c, s * s
    added = motion.translation_variance + noise
    across = motion.heading_variance
    twice = 2.0 * cs * pxy
    rows[PXX], rows[PXY], rows[PYY] = (
        cc * pxx + ss * pyy + twice + added + across * y * y,
        cs * (pyy - pxx) + (cc - ss) * pxy - across * x * y,
        ss * pxx + cc * pyy - twice + added + across * x * x,
    )
    rows[X], rows[Y] = x, y


def near(
    rows: FloatArray, positions: FloatArray, covariances: FloatArray, gate: float
) -> tuple[IntArray, IntArray]:
    """Indices (p,), (p,) of the components and readings that may belong together.

    rows (ROWS, n), readings (m, 2) with (m, 2, 2). Kept is at least every pair within `gate`
    (squared Mahalanobis distance): the trace bounds the longest axis.
    """
    n, m = rows.shape[1], len(positions)
    if not n or not m:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    noise = float((covariances[:, 0, 0] + covariances[:, 1, 1]).max())
    reach = gate * (rows[PXX] + rows[PYY] + noise)
    if n * m <= _DENSE_PAIRS:
        dx = rows[X][:, None] - positions[:, 0]
        dy = rows[Y][:, None] - positions[:, 1]
        i, j = (dx * dx + dy * dy < reach[:, None]).nonzero()
        return i, j
    distance, reading = cKDTree(positions).query(
        rows[: Y + 1].T, k=min(_NEIGHBOURS, m), distance_upper_bound=math.sqrt(float(reach.max()))
    )
    i, k = (distance * distance < reach[:, None]).nonzero()
    return i, np.asarray(reading)[i, k]


def update_by_positions(
    prior: FloatArray, positions: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Kalman updates by position readings, H = I (eq. 13, 14, 16).

    prior (ROWS, ..., p), its readings (p, 2) and their noise (3, ..., p): xx, xy, yy in m².
    Returns the updated rows, weights untouched, and N(innovation; 0, S) (..., p) in 1/m².
    """
    x, y, pxx, pxy, pyy = prior[: PYY + 1]
    dx, dy = positions[:, 0] - x, positions[:, 1] - y
    sxx, sxy, syy = pxx + noise[0], pxy + noise[1], pyy + noise[2]
    determinant = sxx * syy - sxy * sxy
    inverse = 1.0 / determinant
    ax, ay = (syy * dx - sxy * dy) * inverse, (sxx * dy - sxy * dx) * inverse
    # S^-1 P, for P' = P - P S^-1 P.
    bxx, bxy = (syy * pxx - sxy * pxy) * inverse, (syy * pxy - sxy * pyy) * inverse
    byx, byy = (sxx * pxy - sxy * pxx) * inverse, (sxx * pyy - sxy * pxy) * inverse
    updated = np.empty_like(prior)
    updated[X] = x + pxx * ax + pxy * ay
    updated[Y] = y + pxy * ax + pyy * ay
    updated[PXX] = pxx - pxx * bxx - pxy * byx
    updated[PXY] = pxy - pxx * bxy - pxy * byy
    updated[PYY] = pyy - pxy * bxy - pyy * byy
    updated[WEIGHT] = prior[WEIGHT]
    likelihood = np.exp(-0.5 * (dx * ax + dy * ay)) * np.sqrt(inverse) * (0.5 / math.pi)
    return updated, likelihood


@dataclass(frozen=True, slots=True)
class BearingPairs:
    """Components paired with bearings that could be theirs, and each pair's update.

    component, reading (p,): indices. likelihood (p,): N(innovation; 0, S) in 1/rad. updated
    (ROWS, p): the component after the reading, its weight untouched.
    """

    component: IntArray
    reading: IntArray
    likelihood: FloatArray
    updated: FloatArray


def update_by_bearings(
    rows: FloatArray, measured: Bearings, lag_variance: FloatArray | float, gate: float
) -> BearingPairs:
    """Extended Kalman updates by bearing readings (eq. 25, 26, 28, repaired).

    The innovation is a wrapped angle and H = (-y, x) / r², both from the rays' origin.
    lag_variance (m²): what the targets may have moved since the reading was made.
    """
    dx, dy = rows[X] - measured.origin[0], rows[Y] - measured.origin[1]
    square = np.maximum(dx * dx + dy * dy, 1e-6)
    hx, hy = -dy / square, dx / square
    gx = rows[PXX] * hx + rows[PXY] * hy
    gy = rows[PXY] * hx + rows[PYY] * hy
    spread = hx * gx + hy * gy + lag_variance / square
    innovations = wrap(measured.bearings - np.arctan2(dy, dx)[:, None])
    i, j = (innovations**2 < gate * (spread[:, None] + measured.variances)).nonzero()
    innovation, variance = innovations[i, j], spread[i] + measured.variances[j]
    likelihood = np.exp(-0.5 * innovation * innovation / variance)
    likelihood /= np.sqrt(2.0 * math.pi * variance)
    updated = rows[:, i]
    px, py = gx[i], gy[i]
    kx, ky = px / variance, py / variance
    updated[: PYY + 1] += (kx * innovation, ky * innovation, -kx * px, -kx * py, -ky * py)
    return BearingPairs(i, j, likelihood, updated)


def match_moments(rows: FloatArray, into: IntArray, about: FloatArray) -> FloatArray:
    """Merge components (ROWS, N) into `size` ones with the same weight, mean and covariance.

    into (N,): the component each goes to. about (2, size) m: a point near each of those, about
    which the moments are taken, so that nothing is lost to cancellation. Weights must be > 0.
    """
    size = about.shape[1]
    share = rows[WEIGHT]
    dx, dy = rows[X] - about[X, into], rows[Y] - about[Y, into]
    sx, sy = share * dx, share * dy
    total = np.bincount(into, share, size)
    inverse = 1.0 / total
    mx, my = np.bincount(into, sx, size) * inverse, np.bincount(into, sy, size) * inverse
    merged = np.empty((ROWS, size))
    merged[X], merged[Y] = about[X] + mx, about[Y] + my
    merged[PXX] = np.bincount(into, share * rows[PXX] + sx * dx, size) * inverse - mx * mx
    merged[PXY] = np.bincount(into, share * rows[PXY] + sx * dy, size) * inverse - mx * my
    merged[PYY] = np.bincount(into, share * rows[PYY] + sy * dy, size) * inverse - my * my
    merged[WEIGHT] = total
    return merged
