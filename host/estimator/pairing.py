"""Which target may have caused which reading, and what the target is after each such pair.

Pairs are gated, so that cost is linear in the targets; each has its Kalman update in every mode.
"""

from dataclasses import dataclass

import numpy as np

from host.estimator.gaussian_mixture import PXX, PXY, PYY, gated_pairs
from host.estimator.moving_gaussians import (
    WEIGHT,
    X,
    Y,
    match_moments,
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

    target, reading (p,): indices. updated (ROWS, k, p): the target after the reading, in each of k
    modes, weights multiplied by the reading's likelihood there, in 1/m² or 1/rad.
    """

    target: IntArray
    reading: IntArray
    updated: FloatArray

    def mass(self) -> FloatArray:
        """Weight times likelihood (p,) over all modes."""
        return np.asarray(self.updated[WEIGHT].sum(axis=0))


def pair_positions(
    rows: FloatArray, whole: FloatArray, measured: Positions, noise: FloatArray, gate: float
) -> Pairs:
    """Targets (ROWS, k, n) with positions (m,); whole (6, n): each target as one Gaussian.

    noise (m, 2, 2). A position is two readings, along the axes of its covariance.
    """
    i, j = gated_pairs(whole, measured.positions, noise, gate)
    lags = 0.0 if measured.lags is None else measured.lags.take(j)
    variances, axes = np.linalg.eigh(noise)
    updated = rows.take(i, axis=2)
    places = measured.positions.T.take(j, axis=1)[:, None]
    for axis in range(2):
        direction = axes[:, :, axis].T.take(j, axis=1)[:, None]
        off = (direction * (places - places_then(updated, lags))).sum(axis=0)
        variance = variances[:, axis].take(j)
        updated[WEIGHT] *= update_along(updated, direction, off, variance, lags)
    return Pairs(i, j, updated)


def pair_bearings(
    rows: FloatArray, whole: FloatArray, measured: Bearings, share: FloatArray, gate: float
) -> Pairs:
    """Targets (ROWS, k, n) with bearings (m,); whole (6, n): each target as one Gaussian.

    share (n,): of independent evidence that the readings are to a target. A bearing reads the
    place across the ray, to first order: H = (-y, x) / r² (Perera 2021 eq. 28, repaired).
    """
    i, j = _gated_bearings(whole, measured, gate)
    updated = rows.take(i, axis=2)
    distance, ray = _rays(places_then(updated, measured.lag), measured)
    bearing = np.arctan2(ray[1], ray[0])
    off = distance * wrap(measured.bearings.take(j) - bearing)
    across = np.stack((-ray[1], ray[0]))
    variance = distance**2 * measured.variances.take(j)
    density = update_along(updated, across, off, variance, measured.lag, share.take(i))
    updated[WEIGHT] *= distance * density
    return Pairs(i, j, updated)


def with_ranges(pairs: Pairs, measured: Bearings, share: FloatArray, reach_m: float) -> Pairs:
    """The pairs of bearings, updated by the ranges that the strips' sizes give.

    Against a false strip, which has any range up to reach_m alike. A size may mislead; then it
    leaves the target where it was.
    """
    if measured.ranges is None or measured.range_variances is None:
        return pairs
    i, j, by_size = pairs.target, pairs.reading, pairs.updated.copy()
    distance, ray = _rays(places_then(by_size, measured.lag), measured)
    off = measured.ranges.take(j) - distance
    variance = measured.range_variances.take(j)
    density = update_along(by_size, ray, off, variance, measured.lag, share.take(i))
    by_size[WEIGHT] *= (1.0 - _ODD_SIZE) * reach_m * density
    pairs.updated[WEIGHT] *= _ODD_SIZE
    both = np.concatenate((pairs.updated, by_size), axis=2)
    centres = by_size[: Y + 1].mean(axis=1)
    return Pairs(i, j, match_moments(both, np.tile(np.arange(len(i)), 2), centres))


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
