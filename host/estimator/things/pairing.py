"""Which target may have caused which reading, and how the target changes by each such pair.

Pairs are gated, so that cost is linear in the targets; each has its Kalman update in every motion.
"""

from dataclasses import dataclass

import numpy as np

from host.estimator.gaussians.gaussian_mixture import PXX, PXY, PYY, gated_pairs
from host.estimator.gaussians.moving_gaussians import (
    X,
    Y,
    change,
    innovations,
    places_then,
    update_along,
)
from host.geometry import wrap
from host.messages import Bearings, FloatArray, IntArray, Positions

_NEAREST_M = 1e-3  # nearer to the rays' origin than this a bearing has no meaning
_ODD_SIZE = 0.2  # share of strips whose size misleads: hidden in part, they look too far away


@dataclass(frozen=True, slots=True)
class Pairs:
    """Targets paired with readings that may be theirs.

    target, reading (p,): indices. likelihood (k, p): of the reading, if it is the target's in each
    of k motions, in 1/m² or 1/rad. changes (ROWS, k, p): of the target by the reading, as
    `moving_gaussians.absorb` takes them.
    """

    target: IntArray
    reading: IntArray
    likelihood: FloatArray
    changes: FloatArray


def pair_positions(
    rows: FloatArray, whole: FloatArray, measured: Positions, noise: FloatArray, gate: float
) -> Pairs:
    """Targets (ROWS, k, n) with positions (m,) within the gate (squared sigma) in some motion.

    whole (6, n): each target as one Gaussian. noise (m, 2, 2) m².
    """
    i, j = gated_pairs(whole, measured.positions, noise, gate)
    lags = 0.0 if measured.lags is None else measured.lags.take(j)
    places = measured.positions.T.take(j, axis=1)[:, None]
    of_pairs = innovations(rows.take(i, axis=2), places, noise.take(j, axis=0), lags)
    near = (of_pairs.squares.min(axis=0) < gate).nonzero()[0]
    likelihood = of_pairs.likelihood.take(near, axis=1)
    return Pairs(i.take(near), j.take(near), likelihood, of_pairs.changes(near))


def pair_bearings(
    rows: FloatArray,
    whole: FloatArray,
    measured: Bearings,
    share: FloatArray,
    gate: float,
    ranges_to_m: float | None,
) -> Pairs:
    """Targets (ROWS, k, n) with bearings (m,); whole (6, n): each target as one Gaussian.

    share (n,): of independent evidence that the readings are to a target. A bearing reads the
    place across the ray, to first order: H = (-y, x) / r² (Perera 2021 eq. 28, repaired).
    ranges_to_m: how far strips are seen, if their sizes are used; else None.
    """
    i, j = _gated_bearings(whole, measured, gate)
    before = rows.take(i, axis=2)
    after, share = before.copy(), share.take(i)
    distance, ray = _rays(places_then(after, measured.lag), measured)
    bearing = np.arctan2(ray[1], ray[0])
    off = distance * wrap(measured.bearings.take(j) - bearing)
    across = np.stack((-ray[1], ray[0]))
    variance = distance**2 * measured.variances.take(j)
    density = update_along(after, across, off, variance, measured.lag, share)
    pairs = Pairs(i, j, distance * density, change(before, after))
    if ranges_to_m is None or measured.ranges is None or measured.range_variances is None:
        return pairs
    distance, ray = _rays(places_then(after, measured.lag), measured)
    off = measured.ranges.take(j) - distance
    variance = measured.range_variances.take(j)
    density = update_along(after, ray, off, variance, measured.lag, share)
    return _with_sizes(pairs, (1.0 - _ODD_SIZE) * ranges_to_m * density, change(before, after))


def _with_sizes(pairs: Pairs, fits: FloatArray, changes: FloatArray) -> Pairs:
    """The pairs of bearings, updated by the ranges that the strips' sizes give.

    fits (k, p): how well the range fits, against a false strip, which has any range that is seen
    alike. changes (ROWS, k, p): by bearing and range. A size may mislead; then it says nothing.
    """
    by_size = fits / (fits + _ODD_SIZE)
    mixed = pairs.changes + by_size * (changes - pairs.changes)
    return Pairs(pairs.target, pairs.reading, pairs.likelihood * (fits + _ODD_SIZE), mixed)


def _gated_bearings(
    whole: FloatArray, measured: Bearings, gate: float
) -> tuple[IntArray, IntArray]:
    """Indices (p,), (p,) of the targets (6, n) and bearings within the gate (squared sigma)."""
    distance, (ux, uy) = _rays(whole[: Y + 1], measured)
    across = uy * uy * whole[PXX] - 2.0 * ux * uy * whole[PXY] + ux * ux * whole[PYY]
    variance = (across / distance**2)[:, None] + measured.variances
    off = wrap(measured.bearings - np.arctan2(uy, ux)[:, None])
    i, j = (off * off < gate * variance).nonzero()
    return i, j


def _rays(places: FloatArray, measured: Bearings) -> tuple[FloatArray, FloatArray]:
    """Distances (..., n) m and directions (2, ..., n) of places from the rays' origin."""
    x, y = places[X] - measured.origin[0], places[Y] - measured.origin[1]
    distance = np.maximum(np.hypot(x, y), _NEAREST_M)
    return distance, np.stack((x, y)) / distance
