"""Circles of known radius fitted to segments: where turrets would stand, and how surely.

A few returns say little about where the centre lies across the beam. What does are the ends: the
outermost returns are on the turret and the next samples beside them are not.
"""

from dataclasses import dataclass

import numpy as np

from host.config import Lidar
from host.messages import FloatArray
from host.perception.turrets.segments import Returns, Segments

X4_NOISE_M = 0.0016  # std of one range at 1 m, of recorded X4s over still targets
_NEAREST_NOISE_M = 0.3  # nearer than this the range noise stays what it is ...
_FAR_NOISE_M = 5.0  # ... and here it is twice as much as in proportion (recorded X4s)
_RIM_RAD = 0.00125  # of each end of the arc gives no return, on average
_LEAST_SPACINGS = 0.3  # no end is known better than to this share of the samples' spacing
_FREE_END = 0.9  # spacings: where the arc may end that nothing nearer hides, seen with its shape
_WANDER_RAD = 0.0007  # of all bearings of a revolution together (recorded X4s: up to 0.003)
_LOST_ENDS = 0.02  # share of the arcs whose ends do not return for another reason
_ODD_RESIDUAL = 3.0  # in units of the noise: what is off by more belongs half to what is behind
_ORDINARY_MISFIT = 2.0  # mean square in units of the noise, from which on covariances grow
_FIT_STEPS = 4


@dataclass(frozen=True, slots=True)
class Circles:
    """centres (k, 2) m, covariances (k, 2, 2) m², misfits (k,): sum of (residual / noise)².

    The noise of the misfits is the X4's, that of the covariances the configured one."""

    centres: FloatArray
    covariances: FloatArray
    misfits: FloatArray


def noise_m(distances: FloatArray, at_1m: float) -> FloatArray:
    """Standard deviation (k,) m of one range at distances (k,) m."""
    growth = 1.0 + (distances / _FAR_NOISE_M) ** 2
    return at_1m * np.maximum(distances, _NEAREST_NOISE_M) * growth


def bearing_offsets(segments: Segments, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Bearing of each centre from that of the segment's middle, and its std, (k,) rad.

    Positive is towards the last return. In plain view the centre is in the middle: all returns lie
    within the width of a turret and the samples beside them do not, and both leave an interval of
    places. Where something nearer may hide one end, the other end decides.
    """
    width = np.maximum(segments.widths - 2.0 * _RIM_RAD, spacing)
    spare = np.maximum(width - segments.extents, 0.0)
    over = np.maximum(segments.extents - width, 0.0)
    beyond = segments.extents + 2.0 * spacing - width
    interval = np.where(beyond > 0.0, np.minimum(spare, beyond), spare)
    hidden = segments.hidden
    one_hidden = hidden[0] != hidden[1]
    # Half a width from the free end, which lies half a spacing beyond its last return.
    offset = np.maximum(0.5 * (spare - spacing), 0.0) * (1.0 * hidden[1] - hidden[0])
    interval = np.where(hidden[0] & hidden[1], spare, interval)
    interval = np.where(one_hidden, np.minimum(spare, _FREE_END * spacing), interval)
    interval = np.sqrt((1.0 - _LOST_ENDS) * interval**2 + _LOST_ENDS * spare**2) + over
    interval = np.maximum(interval, _LEAST_SPACINGS * spacing)
    std = np.hypot(interval / np.sqrt(12.0), _WANDER_RAD)
    return offset, std


def fit_circles(seen: Returns, segments: Segments, lidar: Lidar) -> Circles:
    """Gauss-Newton on |p - c| = r for all segments at once, with the bearing as an observation."""
    radius, distance = 0.5 * lidar.target_diameter_m, segments.distances
    offset, std = bearing_offsets(segments, seen.spacing)
    x, y = np.ascontiguousarray(seen.points.take(segments.members, 0).T)
    ray_x, ray_y = np.ascontiguousarray(segments.rays.T)
    across = np.stack((-ray_y, ray_x))
    ends = (seen.points.take(segments.last, 0) - segments.middles).T
    shift = np.sign((across * ends).sum(axis=0)) * offset * distance
    middle = segments.middles.T + shift * across
    side = 1.0 / (std * distance) ** 2
    outer = side * np.stack((across[0] * across[0], across[0] * across[1], across[1] * across[1]))
    precision = 1.0 / noise_m(distance, lidar.range_noise_m) ** 2
    oddness = segments.of_members(precision / _ODD_RESIDUAL**2)
    centre = middle + (0.8 * radius) * np.stack((ray_x, ray_y))
    for _ in range(_FIT_STEPS):
        away_x, away_y = x - segments.of_members(centre[0]), y - segments.of_members(centre[1])
        length = np.maximum(np.hypot(away_x, away_y), 1e-9)
        unit_x, unit_y, residual = away_x / length, away_y / length, length - radius
        weight = 1.0 / (1.0 + oddness * residual * residual)
        by_x, by_y = weight * unit_x, weight * unit_y
        table = (by_x * unit_x, by_x * unit_y, by_y * unit_y, by_x * residual, by_y * residual)
        sums = precision * segments.sums(np.stack(table))
        xx, xy, yy = sums[:3] + outer  # the information
        determinant = xx * yy - xy * xy
        slack = side * (across * (middle - centre)).sum(axis=0)
        right_x, right_y = sums[3:] + slack * across
        centre[0] += (yy * right_x - xy * right_y) / determinant
        centre[1] += (xx * right_y - xy * right_x) / determinant
    away_x, away_y = x - segments.of_members(centre[0]), y - segments.of_members(centre[1])
    squares = segments.sums((np.hypot(away_x, away_y) - radius) ** 2)
    off = side * (across * (middle - centre)).sum(axis=0) ** 2
    # What fits badly is no clean circle: so much less is known of its centre.
    misfit = (precision * squares + off) / segments.sizes
    scale = np.maximum(misfit / _ORDINARY_MISFIT, 1.0) / determinant
    covariances = (scale * np.stack((yy, -xy, -xy, xx))).T.reshape(-1, 2, 2)
    return Circles(centre.T, covariances, squares / noise_m(distance, X4_NOISE_M) ** 2 + off)
