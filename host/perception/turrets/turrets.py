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
from host.perception.turrets.fit import fit_circles
from host.perception.turrets.score import LEAST_SCORE, scores
from host.perception.turrets.segments import (
    place,
    returns,
    small_segments,
    strays,
)

_FEWEST = 3  # returns: fewer show nothing
_NULL_M = 1e30  # farther than any return, nearer than where there is no sample
_WITH_NEIGHBOURS = (np.arange(SECTORS) + np.array([[-1], [0], [1]])) % SECTORS


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
    mean_times = segments.sums(seen.times.take(segments.members)) / segments.sizes
    lags = np.maximum(scan.time - mean_times[kept], 0.0)
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
    x, y = centres.T
    apart = np.hypot(x[:, None] - x, y[:, None] - y)
    better = score > score[:, None]
    return np.asarray(~np.any((apart < diameter) & better, axis=1))


def clearance_profile(points: FloatArray, returned: BoolArray) -> FloatArray:
    """How far one sees in each of SECTORS equal sectors from bearing -pi on: (SECTORS,) m.

    points (n, 2) m: of every sample; returned (n,): whether something came back. The nearest
    return in the sector and its two neighbours; inf where only nulls came, 0 where the revolution
    has no sample at all.
    """
    x, y = np.ascontiguousarray(points.T)
    bearing, distance = np.arctan2(y, x), np.hypot(x, y)
    distance = np.where(returned, distance, _NULL_M)
    place = sector(bearing)
    farthest_first = np.argsort(-distance)
    nearest: FloatArray = np.full(SECTORS, math.inf)
    nearest[place.take(farthest_first)] = distance.take(farthest_first)
    around = nearest.take(_WITH_NEIGHBOURS).min(axis=0)
    return np.where(around == math.inf, 0.0, np.where(around == _NULL_M, math.inf, around))
