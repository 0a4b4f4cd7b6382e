"""Gaussian mixtures of planar positions, as columns of one array, and their Kalman steps.

A mixture is `rows` (ROWS, n): one column a component, one row a quantity, so that every step is a
few numpy calls whatever n is. Two-by-two covariances are kept as their three distinct entries.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from host.geometry import wrap
from host.messages import Bearings, Displacement, FloatArray, IntArray, Positions

ROWS = 10
# x, y (m); covariance (m²); weight: expected targets; robot: 1 a teammate, 0 an obstacle;
# seen: time of the last reading (s); confirmed: 1 once reported; label: a number to know it by.
X, Y, PXX, PXY, PYY, WEIGHT, ROBOT, SEEN, CONFIRMED, LABEL = range(ROWS)

_DENSE_PAIRS = 4096  # up to here a full distance table is faster than a KD-tree
_NEIGHBOURS = 8  # readings a component may be paired with when the tree is used


def empty() -> FloatArray:
    """A mixture without components."""
    return np.zeros((ROWS, 0))


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


@dataclass(frozen=True, slots=True)
class Pairs:
    """Components paired with readings that could be theirs, and each pair's Kalman update.

    component, reading (p,): indices. likelihood (p,): N(innovation; 0, S) in 1/m² (1/rad for
    bearings). updated (ROWS, p): the component after the reading, its weight still the prior's.
    """

    component: IntArray
    reading: IntArray
    likelihood: FloatArray
    updated: FloatArray


def pair_positions(
    rows: FloatArray, measured: Positions, lag_variance: FloatArray, gate: float
) -> Pairs:
    """Kalman updates by position readings, H = I (eq. 13–16).

    lag_variance (m,) m²: what a teammate may have moved since each reading was made.
    gate: squared Mahalanobis distance beyond which a pair may be left out.
    """
    positions, covariances = measured.positions, measured.covariances
    i, j = _near(rows, positions, covariances, gate)
    updated = rows[:, i]
    x, y, pxx, pxy, pyy = updated[: PYY + 1]
    dx, dy = positions[j, 0] - x, positions[j, 1] - y
    noise = covariances.reshape(-1, 4)[j].T
    lag = lag_variance[j] * updated[ROBOT]
    sxx, sxy, syy = pxx + noise[0] + lag, pxy + noise[1], pyy + noise[3] + lag
    determinant = sxx * syy - sxy * sxy
    ax, ay = (syy * dx - sxy * dy) / determinant, (sxx * dy - sxy * dx) / determinant
    likelihood = np.exp(-0.5 * (dx * ax + dy * ay)) / (2.0 * math.pi * np.sqrt(determinant))
    # S^-1 P, for P' = P - P S^-1 P.
    bxx, bxy = (syy * pxx - sxy * pxy) / determinant, (syy * pxy - sxy * pyy) / determinant
    byx, byy = (sxx * pxy - sxy * pxx) / determinant, (sxx * pyy - sxy * pxy) / determinant
    updated[: PYY + 1] = (
        x + pxx * ax + pxy * ay,
        y + pxy * ax + pyy * ay,
        pxx - pxx * bxx - pxy * byx,
        pxy - pxx * bxy - pxy * byy,
        pyy - pxy * bxy - pyy * byy,
    )
    return Pairs(i, j, likelihood, updated)


def _near(
    rows: FloatArray, positions: FloatArray, covariances: FloatArray, gate: float
) -> tuple[IntArray, IntArray]:
    """Indices of the pairs that can be within the gate: the trace bounds the largest axis."""
    n, m = rows.shape[1], len(positions)
    if not n or not m:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    noise = float((covariances[:, 0, 0] + covariances[:, 1, 1]).max())
    reach = gate * (rows[PXX] + rows[PYY] + noise)
    if n * m <= _DENSE_PAIRS:
        dx = rows[X][:, None] - positions[:, 0]
        dy = rows[Y][:, None] - positions[:, 1]
        i, j = np.nonzero(dx * dx + dy * dy < reach[:, None])
        return i, j
    distance, reading = cKDTree(positions).query(
        rows[: Y + 1].T, k=min(_NEIGHBOURS, m), distance_upper_bound=math.sqrt(float(reach.max()))
    )
    i, k = np.nonzero(distance * distance < reach[:, None])
    return i, np.asarray(reading)[i, k]


def pair_bearings(
    rows: FloatArray, measured: Bearings, lag_variance: FloatArray | float, gate: float
) -> Pairs:
    """Extended Kalman updates by bearing readings (eq. 25–28, repaired).

    The innovation is a wrapped angle and H = (-y, x) / r², both from the rays' origin.
    lag_variance (m²): what the targets may have moved since the reading was made.
    """
    variances, origin = measured.variances, measured.origin
    dx, dy = rows[X] - origin[0], rows[Y] - origin[1]
    square = np.maximum(dx * dx + dy * dy, 1e-6)
    hx, hy = -dy / square, dx / square
    gx = rows[PXX] * hx + rows[PXY] * hy
    gy = rows[PXY] * hx + rows[PYY] * hy
    spread = hx * gx + hy * gy + lag_variance / square
    innovations = wrap(measured.bearings - np.arctan2(dy, dx)[:, None])
    i, j = np.nonzero(innovations * innovations < gate * (spread[:, None] + variances))
    innovation, variance = innovations[i, j], spread[i] + variances[j]
    likelihood = np.exp(-0.5 * innovation * innovation / variance)
    likelihood /= np.sqrt(2.0 * math.pi * variance)
    updated = rows[:, i]
    px, py = gx[i], gy[i]
    kx, ky = px / variance, py / variance
    updated[: PYY + 1] += (kx * innovation, ky * innovation, -kx * px, -kx * py, -ky * py)
    return Pairs(i, j, likelihood, updated)


def merge(rows: FloatArray, group: IntArray, limit: float) -> tuple[FloatArray, IntArray]:
    """Merge each group of components into its heaviest by matching moments.

    group (n,): small whole numbers. A component further than `limit` (squared Mahalanobis, in the
    sum of both covariances) from its group's heaviest stays by itself. Linear in n. Returns the
    merged rows and the index of the heaviest of each: all but mean, covariance and weight is its.
    """
    n = rows.shape[1]
    order = np.argsort(rows[WEIGHT], kind="stable")
    heaviest = np.zeros(int(group.max(initial=-1)) + 1, dtype=np.int64)
    heaviest[group[order]] = order
    leader = heaviest[group]
    main = rows[: PYY + 1, leader]
    dx, dy = rows[X] - main[X], rows[Y] - main[Y]
    sxx, sxy, syy = rows[PXX : PYY + 1] + main[PXX:]
    square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
    far = square > limit * (sxx * syy - sxy * sxy)
    leader = np.where(far, np.arange(n), leader)
    target = np.zeros(n, dtype=np.int64)
    kept = np.flatnonzero(leader == np.arange(n))
    target[kept] = np.arange(len(kept))
    into = target[leader]
    # Moments about the leader, so that nothing is lost to cancellation.
    share = rows[WEIGHT]
    dx, dy = np.where(far, 0.0, dx), np.where(far, 0.0, dy)
    size = len(kept)
    total = np.bincount(into, share, size)
    mx = np.bincount(into, share * dx, size) / total
    my = np.bincount(into, share * dy, size) / total
    merged = rows[:, kept]
    for row, about, mean in (
        (PXX, dx * dx, mx * mx),
        (PXY, dx * dy, mx * my),
        (PYY, dy * dy, my * my),
    ):
        merged[row] = np.bincount(into, share * (rows[row] + about), size) / total - mean
    merged[X] += mx
    merged[Y] += my
    merged[WEIGHT] = total
    return merged, kept
