"""A scan cut into segments, each of one surface, and what stands beside each of them.

Consecutive returns belong to one segment unless the range steps or the points are far apart, both
measured by the width of a turret. So a turret is one segment even close before a wall.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.config import Lidar
from host.geometry import Path, columns, to_parent
from host.messages import BoolArray, FloatArray, IntArray, Scan

STEP = 0.6  # turret widths between the ranges of neighbours: another surface begins ...
_GAP = 0.92  # ... and so it does where the points are further apart
_WIDTH_MARGIN_M = 0.02
_CLOSE_SAMPLES = 3  # what is nearer within so many samples may hide an end
_LEAST_SHARE = 0.3  # of the returns that a turret in plain view would give
_CENTRE_DEPTH = 0.8  # radii from the visible arc to the axis


@dataclass(frozen=True, slots=True)
class Returns:
    """The returns of a revolution (n,) in scan order, beginning with that of a new surface.

    points (n, 2) m: in the robot frame at the end of the revolution. ranges (n,) m and times (n,)
    s as in the scan; sample (n,): which of its `samples` each is. starts (n,): first of a segment.
    """

    points: FloatArray
    ranges: FloatArray
    times: FloatArray
    sample: IntArray
    samples: int
    starts: BoolArray

    @property
    def spacing(self) -> float:
        """Angle between samples, rad."""
        return math.tau / self.samples


@dataclass(frozen=True, slots=True)
class Segments:
    """Segments (k,) that are as small as a turret, of the returns `first` to `last`.

    middles (k, 2) m between their ends; rays (k, 2): unit vectors from the lidar to there, and
    distances (k,) m. widths (k,) rad: of a turret there; extents (k,) rad: from first to last.
    steps (2, k) m: how much further the returns on both sides are; nulls (2, k): how many samples
    without a return lie between. hidden (2, k): whether something close beside is nearer, so that
    it may hide an end. sizes (k,): returns in each; members (m,): all of these returns, one segment
    after the other; begins (k,): where in `members` each begins.
    """

    first: IntArray
    last: IntArray
    middles: FloatArray
    rays: FloatArray
    distances: FloatArray
    widths: FloatArray
    extents: FloatArray
    steps: FloatArray
    nulls: IntArray
    hidden: BoolArray
    sizes: IntArray
    members: IntArray
    begins: IntArray

    def of_members(self, values: FloatArray) -> FloatArray:
        """For each of the members (m,) the value (k,) of its segment."""
        return values.repeat(self.sizes)

    def sums(self, values: FloatArray) -> FloatArray:
        """The sums (..., k) of the values (..., m) of each segment's members."""
        return np.asarray(np.add.reduceat(values, self.begins, axis=-1))


def place(scan: Scan, lidar: Lidar, path: Path) -> tuple[FloatArray, BoolArray]:
    """Where every sample (n, 2) m was in the robot frame at the end, and which ones returned.

    Each is placed with the pose that the robot had when it was measured (de-skewing) and with the
    lidar's mounting. A sample without a return still has a direction: it is placed 1 m away.
    """
    mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
    returned = scan.ranges > 0.0
    reach = np.where(returned, scan.ranges, 1.0)
    beams = columns(reach * np.cos(scan.angles), reach * np.sin(scan.angles))
    return path.carry(to_parent(beams, mounting), scan.times, scan.time), returned


def strays(ranges: FloatArray, returned: BoolArray, diameter: float) -> BoolArray:
    """Which returns (n,) stand alone before or behind a surface that goes on at both sides.

    Light of another lidar, dust: each is like none of the two samples at either side, of which one
    on the left and one on the right are alike.
    """
    step, count = STEP * diameter, len(ranges)
    # A null is alike to none, not even to another null.
    reach = np.where(returned, ranges, -(1.0 + step) * np.arange(1, count + 1))
    around = (np.arange(count) + np.array([[-2], [-1], [1], [2]])) % max(count, 1)
    beside = reach.take(around)
    like = np.any(np.abs(beside - reach) <= step, axis=0)
    goes_on = np.any(np.abs(beside[:2, None] - beside[2:]) <= step, axis=(0, 1))
    return np.asarray(returned & ~like & goes_on)


def returns(scan: Scan, points: FloatArray, returned: BoolArray, diameter: float) -> Returns:
    """The returns among the samples' `points` (n, 2), and where a new surface begins."""
    sample = np.flatnonzero(returned)
    before = sample.take(np.arange(-1, len(sample) - 1))
    gaps = np.hypot(*np.ascontiguousarray((points.take(before, 0) - points.take(sample, 0)).T))
    steps = np.abs(scan.ranges.take(before) - scan.ranges.take(sample))
    starts = (steps > STEP * diameter) | (gaps > _GAP * diameter)
    # Where all is one surface it begins behind its widest gap.
    begin = int(np.argmax(starts if starts.any() else gaps))
    sample, starts = (np.concatenate((all_[begin:], all_[:begin])) for all_ in (sample, starts))
    starts[:1] = True
    return Returns(
        points.take(sample, 0),
        scan.ranges.take(sample),
        scan.times.take(sample),
        sample,
        len(returned),
        starts,
    )


def small_segments(seen: Returns, lidar: Lidar) -> Segments:
    """The segments that are near enough, and neither wider nor far narrower than a turret."""
    points, ranges, count = seen.points, seen.ranges, len(seen.ranges)
    first = np.flatnonzero(seen.starts)
    last = np.append(first[1:], count) - 1
    chord = np.hypot(*(points[last] - points[first]).T)
    width = 2.0 * np.arctan2(0.5 * lidar.target_diameter_m, ranges[first])
    fits = (
        (last > first)
        & (last - first >= _LEAST_SHARE * width / seen.spacing - 2.0)
        & (chord <= lidar.target_diameter_m + _WIDTH_MARGIN_M)
        & (ranges[first] <= lidar.max_range_m)
    )
    return _measured(seen, first[fits], last[fits], lidar)


def _measured(seen: Returns, first: IntArray, last: IntArray, lidar: Lidar) -> Segments:
    points = seen.points
    # The lidar moves by less than a sample's width while it passes a turret: one origin does.
    origin = np.array([lidar.x_m, lidar.y_m])
    begin, end = points.take(first, 0) - origin, points.take(last, 0) - origin
    middle = 0.5 * (begin + end)
    distance = np.maximum(np.hypot(middle[:, 0], middle[:, 1]), 1e-6)
    turned = np.abs(begin[:, 0] * end[:, 1] - begin[:, 1] * end[:, 0])
    radius = 0.5 * lidar.target_diameter_m
    steps, apart = _beside(seen, first, last)
    sizes = last - first + 1
    begins = sizes.cumsum() - sizes
    members = np.arange(sizes.sum()) + (first - begins).repeat(sizes)
    near = -STEP * lidar.target_diameter_m
    # Between two surfaces there may be one point of neither.
    hidden = np.asarray(((steps < near) & (apart <= _CLOSE_SAMPLES)).any(axis=0))
    return Segments(
        first,
        last,
        middle + origin,
        middle / distance[:, None],
        distance,
        2.0 * np.arcsin(np.minimum(radius / (distance + _CENTRE_DEPTH * radius), 0.99)),
        np.arctan2(turned, np.sum(begin * end, axis=1)),
        steps[0],
        apart[0] - 1,
        hidden,
        sizes,
        members,
        begins,
    )


def _beside(seen: Returns, first: IntArray, last: IntArray) -> tuple[FloatArray, IntArray]:
    """Of the first and second return on both sides, each (2, 2, k): the second index is the side.

    How much further it is, m, and how many samples away.
    """
    away, ends = np.array([[1], [2]]), np.stack((first, last))
    beside = np.stack((first - away, last + away), axis=1) % len(seen.ranges)
    apart = (seen.sample.take(beside) - seen.sample.take(ends)) * np.array([[-1], [1]])
    return seen.ranges.take(beside) - seen.ranges.take(ends), apart % seen.samples
