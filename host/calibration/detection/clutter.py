"""What the lidar saw that was no teammate, and when another lidar blinded it."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from host.calibration.detection.lidar_views import GATE_M, LidarSurvey, behind_something
from host.calibration.detection.range_curve import BLOCK_S, RangeCurve
from host.calibration.robust.statistics import blocks_of, ratio_variance
from host.config import Lidar
from host.geometry import to_frame
from host.messages import BoolArray, FloatArray

_NULL_SHARE = 0.7  # of the samples on a teammate: nothing comes back from it
_NEAR_M, _NEAR_SHARE = 1.2, 0.6  # close by: both in metres and in half-ranges
_STANDING = 0.5  # of the scans in which a thing would be detected if it were always there
_STANDING_SCANS = 5.0


@dataclass(frozen=True, slots=True)
class Interference:
    """How often a teammate close by in plain view is missed because nothing comes back.

    share: of the revolutions; how long in a row, on average and at most.
    """

    share: float
    mean_s: float
    longest_s: float


@dataclass(frozen=True, slots=True)
class Clutter:
    """False candidates: counts (s,) of each revolution and their places (f, 2) m on the floor.

    standing (k, 2) m: things that stand there all the time and look like teammates. The filter
    keeps them as obstacles, so their candidates are no clutter.
    """

    counts: FloatArray
    places: FloatArray
    standing: FloatArray


def clutter(survey: LidarSurvey, curve: RangeCurve, lidar: Lidar) -> Clutter:
    """False candidates that come and go, and what stands there all the time."""
    standing, of_standing = _standing(survey, curve, lidar)
    scans = survey.false[~of_standing, 0].astype(np.int64)
    counts = np.bincount(scans, minlength=len(survey.areas)).astype(float)
    return Clutter(counts, survey.false[~of_standing, 1:], standing)


def rate_of(counts: FloatArray, sizes: FloatArray, times: FloatArray) -> tuple[float, float]:
    """Events a unit of size, and the standard deviation; nan where nothing was looked at.

    counts, sizes, times (s,): how many there were of what was looked at when (s).
    """
    size = float(sizes.sum())
    if size == 0.0:
        return math.nan, math.nan
    found = (float(counts.sum()) + 0.5) / size  # never none at all
    variance = ratio_variance(counts, sizes, found, blocks_of(times - times.min(), BLOCK_S))
    return found, math.sqrt(variance + 0.5 / size**2)


def _standing(survey: LidarSurvey, curve: RangeCurve, lidar: Lidar) -> tuple[FloatArray, BoolArray]:
    """Places (k, 2) at which something stands all the time, and which false ones (f,) are it."""
    scans, places = survey.false[:, 0], survey.false[:, 1:]
    taken = np.zeros(len(places), dtype=bool)
    of_standing = taken.copy()
    standing: list[FloatArray] = []
    if not len(places):
        return np.zeros((0, 2)), of_standing
    tree = cKDTree(places)
    around = [tree.query_ball_point(place, GATE_M) for place in places]
    crowded = sorted(range(len(places)), key=lambda k: -len(around[k]))
    for k in crowded:
        near = np.array([i for i in around[k] if not taken[i]])
        if taken[k] or len(near) < _STANDING * _STANDING_SCANS:
            continue
        taken[near] = True
        middle = np.median(places[near], axis=0)
        expected = _expected(middle, survey, curve, lidar)
        enough = expected >= _STANDING_SCANS
        if enough and len(np.unique(scans[near])) >= _STANDING * expected:
            standing.append(middle)
            of_standing[near] = True
    return np.array(standing).reshape(-1, 2), of_standing


def _expected(place: FloatArray, survey: LidarSurvey, curve: RangeCurve, lidar: Lidar) -> float:
    """In how many scans a turret that always stood at `place` (2,) would have been detected."""
    seen = to_frame(np.broadcast_to(place, (len(survey.robots), 2)), survey.robots)
    distance = np.hypot(*seen.T)
    shown = (distance <= lidar.max_range_m) & (survey.areas > 0.0)
    shown &= ~behind_something(seen, survey.clearances, lidar)
    return float(curve.at(distance[shown]).sum())


def interference(survey: LidarSurvey, chosen: BoolArray, curve: RangeCurve) -> Interference:
    """How nulls hide teammates close by, of the chosen (n,) views."""
    views = survey.views
    near = chosen & (views.distances < min(_NEAR_M, _NEAR_SHARE * float(curve.values[1])))
    lost = near & ~views.seen & (survey.nulls >= _NULL_SHARE)
    period = float(np.median(np.diff(survey.times))) if len(survey.times) > 1 else 0.0
    runs: list[float] = []
    for teammate in np.unique(views.teammates[lost]):
        times = np.sort(views.times[lost & (views.teammates == teammate)])
        ends = np.flatnonzero(np.diff(times, append=np.inf) > 1.5 * period)
        runs.extend((period * np.diff(ends, prepend=-1)).tolist())
    count = int(near.sum())
    share = float(lost.sum()) / count if count else math.nan
    return Interference(share, float(np.mean(runs)) if runs else 0.0, max(runs, default=0.0))
