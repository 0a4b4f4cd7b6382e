"""How the robot moved by what its lidar saw alone, revolution by revolution."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.config import Lidar
from host.geometry import to_parent
from host.messages import FloatArray, Scan
from host.perception.scan_match import FEWEST_RETURNS, Surroundings, returns_of

_FITS = 0.4  # not more than this share of the returns has nothing near it in the scan before
_GAP_S = 0.4  # revolutions further apart cannot be matched


@dataclass(frozen=True, slots=True)
class LidarMotion:
    """times (n,) s: the middle of each revolution. poses (n, 3): from the first one's (0, 0, 0).

    Headings are not wrapped.
    """

    times: FloatArray
    poses: FloatArray

    def covers(self, begin: float, end: float) -> bool:
        """Was the robot seen all the time between two times, s?"""
        return bool(self.times[0] <= begin + _GAP_S and self.times[-1] >= end - _GAP_S)

    def between(self, begin: float, end: float) -> FloatArray:
        """The motion (3,) between two times, s, in the frame of the first one."""
        first, last = (
            np.array([np.interp(t, self.times, column) for column in self.poses.T])
            for t in (begin, end)
        )
        c, s = math.cos(first[2]), math.sin(first[2])
        x, y, heading = last - first
        return np.array([c * x + s * y, c * y - s * x, heading])


def motion_of(scans: Sequence[Scan], lidar: Lidar) -> LidarMotion | None:
    """Match each scan with the one before; None where there is a gap or they do not fit.

    The robot should move by less than 0.3 m and 0.5 rad from one revolution to the next.
    """
    mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
    usable = [scan for scan in scans if np.count_nonzero(scan.ranges > 0.0) >= FEWEST_RETURNS]
    gaps = np.diff([scan.time for scan in usable])
    if len(usable) < 2 or gaps.max() > _GAP_S:
        return None
    seen = [returns_of(scan, mounting)[0] for scan in usable]
    poses = [np.zeros(3)]
    for before, points in itertools.pairwise(seen):
        surroundings = Surroundings(before)
        step = surroundings.match(points, np.zeros(3))
        if surroundings.misfit(points, step) > _FITS:
            return None
        at = poses[-1]
        x, y = to_parent(step[None, :2], at)[0]
        poses.append(np.array([x, y, at[2] + step[2]]))
    times = np.array([float(np.mean(scan.times)) for scan in usable])
    return LidarMotion(times, np.array(poses))
