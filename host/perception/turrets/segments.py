"""A scan cut into segments, each of one surface, and what stands beside each of them.

Consecutive returns belong to one segment unless the range steps or the points are far apart, both
measured by the width of a turret. So a turret is one segment even close before a wall.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.config import Lidar
from host.geometry import Path, to_parent
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
    it may hide an end.
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

    @property
    def sizes(self) -> IntArray:
        """Returns in each."""
        return self.last - self.first + 1


def place(scan: Scan, lidar: Lidar, path: Path) -> tuple[FloatArray, BoolArray]:
    """Where every sample (n, 2) m was in the robot frame at the end, and which ones returned.

    Each is placed with the pose that the robot had when it was measured (de-skewing) and with the
    lidar's mounting. A sample without a return still has a direction: it is placed 1 m away.
    """
    mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
    returned = scan.ranges > 0.0
    reach = np.where(returned, scan.ranges, 1.0)
    beams = np.stack((reach * np.cos(scan.angles), reach * np.sin(scan.angles)), axis=1)
    return path.carry(to_parent(beams, mounting), scan.times, scan.time), returned


def strays(ranges: FloatArray, returned: BoolArray, diameter: float) -> BoolArray:
    """Which returns (n,) stand alone before or behind a surface that goes on at both sides.

    Light of another lidar, dust: each is like none of the two samples at either side, of which one
    on the left and one on the right are alike.
    """
    reach = np.where(returned, ranges, math.inf)
    left, right = (np.stack([np.roll(reach, k * side) for k in (1, 2)]) for side in (1, -1))
    step = STEP * diameter
    with np.errstate(invalid="ignore"):  # inf - inf of two nulls is alike to none
        like = np.any(np.abs(np.concatenate((left, right)) - reach) <= step, axis=0)
        goes_on = np.any(np.abs(left[:, None] - right) <= step, axis=(0, 1))
    return np.asarray(returned & ~like & goes_on)


def returns(scan: Scan, points: FloatArray, returned: BoolArray, diameter: float) -> Returns:
    """The returns among the samples' `points` (n, 2), and where a new surface begins."""
    sample = np.flatnonzero(returned)
    points, ranges = points[sample], scan.ranges[sample]
    before = np.roll(points, 1, axis=0) - points
    gaps = np.hypot(*before.T)
    starts = (np.abs(ranges - np.roll(ranges, 1)) > STEP * diameter) | (gaps > _GAP * diameter)
    # Where all is one surface it begins behind its widest gap.
    begin = int(np.argmax(starts if starts.any() else gaps))
    order = (np.arange(len(sample)) + begin) % len(sample)
    starts = starts[order]
    starts[:1] = True
    return Returns(
        points[order],
        ranges[order],
        scan.times[sample][order],
        sample[order],
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
    begin, end = points[first] - origin, points[last] - origin
    middle = 0.5 * (begin + end)
    distance = np.maximum(np.hypot(*middle.T), 1e-6)
    turned = np.abs(begin[:, 0] * end[:, 1] - begin[:, 1] * end[:, 0])
    radius = 0.5 * lidar.target_diameter_m
    steps, apart = _beside(seen, first, last, 1)
    further_steps, further_apart = _beside(seen, first, last, 2)
    near = -STEP * lidar.target_diameter_m
    # Between two surfaces there may be one point of neither.
    hidden = (steps < near) & (apart <= _CLOSE_SAMPLES)
    hidden |= (further_steps < near) & (further_apart <= _CLOSE_SAMPLES)
    return Segments(
        first,
        last,
        middle + origin,
        middle / distance[:, None],
        distance,
        2.0 * np.arcsin(np.minimum(radius / (distance + _CENTRE_DEPTH * radius), 0.99)),
        np.arctan2(turned, np.sum(begin * end, axis=1)),
        steps,
        apart - 1,
        hidden,
    )


def _beside(
    seen: Returns, first: IntArray, last: IntArray, away: int
) -> tuple[FloatArray, IntArray]:
    """Of the returns `away` places beside: how much further (2, k) m, how many samples (2, k)."""
    ends = np.stack((first, last))
    beside = np.stack((first - away, last + away)) % len(seen.ranges)
    apart = (seen.sample[beside] - seen.sample[ends]) * np.array([[-1], [1]]) % seen.samples
    return seen.ranges[beside] - seen.ranges[ends], apart
