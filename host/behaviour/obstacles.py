"""What the lidar sees around the robot, as points that a robot can keep away from.

No return is not free space: walls can be too dark, beams graze them, two lidars that aim at each
other blind each other. Where a revolution saw nothing, what was seen there shortly before counts;
where that says nothing either, the gap is closed by a straight line between its ends.
"""

import math
from collections import deque

import numpy as np

from host.config import Lidar
from host.geometry import SECTORS, Path, sector, to_frame, to_parent
from host.messages import BoolArray, FloatArray, IntArray, Scan
from host.perception.turrets.segments import place

REVOLUTIONS = 4  # remembered, where the newest one saw nothing
_WIDEST_CHORD = round(SECTORS * 150 / 360)  # a wider gap is closed by an arc
_WIDTH = 2.0 * math.pi / SECTORS
_CENTRES = (np.arange(SECTORS) + 0.5) * _WIDTH - math.pi


class Obstacles:
    """The nearest surfaces in each direction, kept where they are while the robot moves on.

    time: end of the newest revolution, s; -inf before the first.
    """

    def __init__(self, lidar: Lidar) -> None:
        self._lidar = lidar
        self._recent: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=REVOLUTIONS)
        self._points, self._times = np.zeros((0, 2)), np.zeros(0)  # in the odometry's frame
        self.time = -math.inf

    def add(self, scan: Scan, path: Path) -> None:
        """Take in a revolution. path: the odometry up to its end, always the same one."""
        points, returned = place(scan, self._lidar, path)
        seen = returned & (scan.ranges >= self._lidar.min_range_m)
        pose = path.poses(np.array([scan.time]))[0]
        self._recent.append((to_parent(points[seen], pose), scan.times[seen]))
        ranges, times = self._profile(pose)
        empty = np.isinf(ranges)
        ranges = closed(ranges)
        times[empty] = scan.time
        known = np.isfinite(ranges)
        around = np.stack((ranges * np.cos(_CENTRES), ranges * np.sin(_CENTRES)), axis=1)
        self._points, self._times = to_parent(around[known], pose), times[known]
        self.time = scan.time

    def _profile(self, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest return in each sector (SECTORS,) m, and when (s); the newest that saw any."""
        ranges, times = np.full(SECTORS, math.inf), np.zeros(SECTORS)
        for points, when in self._recent:
            x, y = np.ascontiguousarray(to_frame(points, pose).T)
            distances = np.hypot(x, y)
            farthest_first = np.argsort(-distances, kind="stable")
            places = sector(np.arctan2(y, x))[farthest_first]
            ranges[places] = distances[farthest_first]
            times[places] = when[farthest_first]
        return ranges, times

    def seen_from(self, pose: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
        """The points (n, 2) m in the frame of a robot at `pose` (3,), and their ages (n,) s."""
        return to_frame(self._points, pose), time - self._times


def closed(ranges: FloatArray) -> FloatArray:
    """Fill the gaps (inf) of a profile of SECTORS directions; all gap: it stays as it is."""
    filled = ranges.copy()
    for first, count in _gaps(np.isinf(ranges)):
        before, after = float(ranges[first - 1]), float(ranges[(first + count) % SECTORS])
        inside: IntArray = np.arange(1, count + 1, dtype=np.int64)
        if count > _WIDEST_CHORD:
            line = np.full(count, min(before, after))
        else:
            line = _chord(before, after, _WIDTH * inside.astype(float), (count + 1) * _WIDTH)
        filled[(first + inside - 1) % SECTORS] = line
    return filled


def _chord(before: float, after: float, angles: FloatArray, whole: float) -> FloatArray:
    """Ranges at `angles` from one end of a straight line, seen `whole` rad from the other."""
    across = before * np.sin(angles) + after * np.sin(whole - angles)
    return np.asarray(before * after * math.sin(whole) / across)


def _gaps(empty: BoolArray) -> list[tuple[int, int]]:
    """First index and length of each run of True around the circle; none where all is True."""
    starts: IntArray = np.flatnonzero(empty & ~np.roll(empty, 1))
    ends: IntArray = np.flatnonzero(empty & ~np.roll(empty, -1))
    if len(starts) and ends[0] < starts[0]:
        ends = np.roll(ends, -1)
    lengths = (ends - starts) % SECTORS + 1
    return list(zip(starts.tolist(), lengths.tolist(), strict=True))
