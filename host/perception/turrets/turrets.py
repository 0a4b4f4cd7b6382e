"""Scan → where lidar turrets of teammates may be (Perera 2021 ch. 5.6, Belaroussi 2024 4.3.1).

A turret is a cylinder of known diameter that stands free. The scan is cut into segments, each of
one surface; those as small as a turret get a circle fitted and a score, by their shape and by what
stands beside them. The centre is that of the fitted circle, not the mean of the visible arc, which
lies most of a radius too near.
"""

import math

import numpy as np

from host.config import Lidar
from host.geometry import SECTORS, Path, sector
from host.messages import BoolArray, FloatArray, Positions, Scan
from host.perception.turrets.fit import fit_circles, members
from host.perception.turrets.score import LEAST_SCORE, scores
from host.perception.turrets.segments import (
    Returns,
    Segments,
    place,
    returns,
    small_segments,
    strays,
)

_FEWEST = 3  # returns: fewer show nothing


def find(scan: Scan, lidar: Lidar, path: Path) -> Positions:
    """Candidate teammates in the robot frame at the end of the revolution.

    Covariances come from the fit; `scores` say how much each looks like a turret rather than
    furniture; `lags` say when in the revolution each was seen.
    """
    points, returned = place(scan, lidar, path)
    returned &= ~strays(scan.ranges, returned, lidar.target_diameter_m)
    clearance = clearance_profile(points, returned)
    if np.count_nonzero(returned) < _FEWEST:
        none = np.zeros(0)
        shapes = np.zeros((0, 2)), np.zeros((0, 2, 2))
        return Positions(scan.time, *shapes, none, clearance, scores=none)
    seen = returns(scan, points, returned, lidar.target_diameter_m)
    segments = small_segments(seen, lidar)
    circles = fit_circles(seen, segments, lidar)
    score = scores(seen, segments, circles, lidar.target_diameter_m)
    kept = np.flatnonzero(score > LEAST_SCORE)
    kept = kept[_distinct(circles.centres[kept], score[kept], lidar.target_diameter_m)]
    lags = np.maximum(scan.time - _mean_times(seen, segments)[kept], 0.0)
    return Positions(
        scan.time,
        circles.centres[kept],
        circles.covariances[kept],
        lags,
        clearance,
        scores=score[kept],
    )


def _distinct(centres: FloatArray, score: FloatArray, diameter: float) -> BoolArray:
    """Which of the candidates (k,) have no better one so near that it must be the same turret.

    A robot that rotates with the beam sees at the end of a revolution again what it began with.
    """
    apart = np.hypot(*np.moveaxis(centres[:, None] - centres, 2, 0))
    better = score > score[:, None]
    return np.asarray(~np.any((apart < diameter) & better, axis=1))


def _mean_times(seen: Returns, segments: Segments) -> FloatArray:
    """When each segment was seen (k,) s; some of its returns may be the first, others the last."""
    member, group = members(segments)
    sums = np.bincount(group, seen.times[member], len(segments.first))
    return np.asarray(sums / segments.sizes)


def clearance_profile(points: FloatArray, returned: BoolArray) -> FloatArray:
    """How far one sees in each of SECTORS equal sectors from bearing -pi on: (SECTORS,) m.

    points (n, 2) m: of every sample; returned (n,): whether something came back. The nearest
    return in the sector and its two neighbours; inf where only nulls came, 0 where the revolution
    has no sample at all.
    """
    x, y = np.ascontiguousarray(points.T)
    bearing, distance = np.arctan2(y, x), np.hypot(x, y)
    distance = np.where(returned, distance, math.inf)
    place = sector(bearing)
    farthest_first = np.argsort(-distance, kind="stable")
    nearest: FloatArray = np.full(SECTORS, -1.0)
    nearest[place[farthest_first]] = distance[farthest_first]
    unseen = nearest < 0.0
    unseen &= np.roll(unseen, 1) & np.roll(unseen, -1)
    nearest[nearest < 0.0] = math.inf
    around = np.minimum(nearest, np.minimum(np.roll(nearest, 1), np.roll(nearest, -1)))
    return np.where(unseen, 0.0, around)
