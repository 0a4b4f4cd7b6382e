"""Scan → where lidar turrets of teammates may be (Perera 2021 ch. 5.6, Belaroussi 2024 4.3.1).

A turret is a cylinder of known diameter that stands free. Returns are clustered by distance; a
cluster that is no wider than a turret, has returns enough for one and does not lie on the line
of its neighbours is a candidate. The centre is that of the fitted circle, not the mean of the
visible arc, which lies most of a radius too near.
"""

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from host.config import Lidar
from host.geometry import SECTORS, Path, sector, to_parent
from host.messages import BoolArray, FloatArray, IntArray, Positions, Scan

_CLUSTER_GAP_M = 0.06  # returns closer than this belong together
_WIDTH_MARGIN_M = 0.02
_LINE_M = 0.02  # a piece of wall lies this close to the line between its neighbours ...
_LINE_REACH_M = 0.6  # ... which are then this near
_RUN = 6  # returns on one side that make a line
_LEAST_SHARE = 0.35  # of the returns that a turret in plain view would give
_HIDING_M = 0.1  # a neighbour nearer by more than this may hide a part
_SIDE_M, _SIDE_RAD = 0.004, 0.0015  # std of the arc's middle: missing ends and half a sample
_FIT_STEPS = 4


def find(scan: Scan, lidar: Lidar, path: Path) -> Positions:
    """Candidate teammates in the robot frame at the end of the turn.

    Every return is placed with the pose the robot had when it was measured (de-skewing) and the
    lidar's mounting. Covariances come from the fit; `lags` say when in the turn each was seen.
    """
    mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
    returned = scan.ranges > 0.0
    reach = np.where(returned, scan.ranges, 1.0)  # a null sample still has a direction
    beams = np.stack((reach * np.cos(scan.angles), reach * np.sin(scan.angles)), axis=1)
    points = path.carry(to_parent(beams, mounting), scan.times, scan.time)
    clearance = clearance_profile(points, returned)
    points, ranges, times = points[returned], scan.ranges[returned], scan.times[returned]
    if len(points) < 3:
        none = np.zeros((0, 2))
        return Positions(scan.time, none, np.zeros((0, 2, 2)), np.zeros(0), clearance)
    label = _clusters(points)
    # Begin between two clusters, so that the samples of each are in the order they were taken;
    # where all is one cluster, behind its widest gap.
    steps = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
    other = label != label[-1]
    start = int(np.argmax(other if other.any() else steps))
    turn = (np.arange(len(points)) + start) % len(points)
    points, ranges, times, label = points[turn], ranges[turn], times[turn], label[turn]
    chosen, first, last, hidden = _select(points, ranges, label, lidar)
    member = np.flatnonzero(np.isin(label, chosen))
    group = np.searchsorted(chosen, label[member])
    origins = path.carry(np.broadcast_to(mounting[:2], (len(first), 2)), times[first], scan.time)
    centres, covariances = _fit_circles(
        points[member], origins, group, 0.5 * (points[first] + points[last]), hidden, lidar
    )
    lags = np.maximum(scan.time - 0.5 * (times[first] + times[last]), 0.0)
    return Positions(scan.time, centres, covariances, lags, clearance)


def clearance_profile(points: FloatArray, returned: BoolArray) -> FloatArray:
    """How far one sees in each of SECTORS equal sectors from bearing -pi on: (SECTORS,) m.

    points (n, 2) m: of every sample; returned (n,): whether something came back. The nearest
    return in the sector and its two neighbours; inf where only nulls came, 0 where the turn has
    no sample at all.
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


def _clusters(points: FloatArray) -> IntArray:
    """Label (n,) of each point's Euclidean cluster: chains of points closer than the gap."""
    pairs = cKDTree(points).query_pairs(_CLUSTER_GAP_M, output_type="ndarray")
    n = len(points)
    links = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _select(
    points: FloatArray, ranges: FloatArray, label: IntArray, lidar: Lidar
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Clusters that may be turrets: labels, first and last samples, and which are part hidden."""
    n = len(points)
    order = np.argsort(label, kind="stable")
    begin = np.flatnonzero(np.diff(label[order], prepend=-1))
    size = np.diff(begin, append=n)
    first, last = order[begin], order[begin + size - 1]
    # Not from first to last: a wall all around ends where it begins.
    spread = np.hypot(*(points[order] - np.repeat(points[first], size, axis=0)).T)
    width = np.maximum.reduceat(spread, begin)
    expected = lidar.target_diameter_m / ranges[first] * n / (2.0 * math.pi)
    accepted = (
        (width <= lidar.target_diameter_m + _WIDTH_MARGIN_M)
        & (ranges[first] <= lidar.max_range_m)
        & (size >= np.maximum(2.0, _LEAST_SHARE * expected))
        & ~_on_wall(points, label, first, last)
    )
    chosen = np.flatnonzero(accepted)
    nearer = np.minimum(ranges[first - 1], ranges[(last + 1) % n]) < ranges[first] - _HIDING_M
    return chosen, first[chosen], last[chosen], nearer[chosen].astype(float)


def _on_wall(points: FloatArray, label: IntArray, first: IntArray, last: IntArray) -> BoolArray:
    """Whether clusters (k,) from sample `first` to `last` lie on a line with what is around them.

    A piece of wall between two gaps is as small as a turret, but the wall goes on beside it.
    """
    n = len(points)
    middle = 0.5 * (points[first] + points[last])
    nowhere = 10.0 * _LINE_REACH_M  # further than any neighbour that counts

    def beside(index: IntArray) -> FloatArray:
        # Where little else returned, one comes around to the cluster itself.
        itself = label[index] == label[first]
        return np.where(itself[:, None], middle + nowhere, points[index])

    left = [beside((first - k) % n) for k in (1, _RUN // 2, _RUN)]
    right = [beside((last + k) % n) for k in (1, _RUN // 2, _RUN)]
    found = np.zeros(len(first), dtype=bool)
    # Three returns of the wall make a line: all on one side, or two on one and one on the other.
    for a, b, c in (left, right, (left[0], left[1], right[0]), (right[0], right[1], left[0])):
        straight = _off_line(b, a, c) < 0.5 * _LINE_M
        found |= straight & (_off_line(middle, a, c) < _LINE_M)
    return found


def _off_line(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance (k,) m of points (k, 2) from the lines through a and b; inf where these are far."""
    along, offset = b - a, point - a
    length = np.maximum(np.hypot(*along.T), 1e-9)
    across = np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]) / length
    far = (np.hypot(*offset.T) > _LINE_REACH_M) | (length > 2.0 * _LINE_REACH_M)
    return np.where(far, math.inf, across)


def _fit_circles(
    points: FloatArray,
    origins: FloatArray,
    group: IntArray,
    middle: FloatArray,
    hidden: FloatArray,
    lidar: Lidar,
) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 2) of circles of known radius through the points of each group, (m, 2, 2).

    Gauss-Newton on |p - c| = r for all groups at once. A few returns say little about where the
    centre lies across the beam, so that the middle of the arc is a second, weaker observation;
    weaker still where something nearer hides one end.
    """
    m, radius = len(middle), 0.5 * lidar.target_diameter_m
    ray = middle - origins
    distance = np.maximum(np.hypot(*ray.T), 1e-6)
    ray /= distance[:, None]
    across = np.stack((-ray[:, 1], ray[:, 0]), axis=1)
    centre = middle + 0.8 * radius * ray
    precision = 1.0 / (lidar.range_noise_m * np.maximum(distance, 0.3)) ** 2
    side = 1.0 / (_SIDE_M + _SIDE_RAD * distance + 0.5 * radius * hidden) ** 2
    outer = side[:, None, None] * across[:, :, None] * across[:, None, :]
    information = np.zeros((m, 2, 2))
    for _ in range(_FIT_STEPS):
        offset = points - centre[group]
        length = np.maximum(np.hypot(*offset.T), 1e-9)
        unit = offset / length[:, None]
        residual = length - radius
        sums = [
            np.bincount(group, value, m)
            for value in (
                unit[:, 0] * unit[:, 0],
                unit[:, 0] * unit[:, 1],
                unit[:, 1] * unit[:, 1],
                unit[:, 0] * residual,
                unit[:, 1] * residual,
            )
        ]
        information = precision[:, None, None] * np.stack(
            (sums[0], sums[1], sums[1], sums[2]), axis=1
        ).reshape(m, 2, 2)
        information += outer
        slack = side * np.sum(across * (middle - centre), axis=1)
        right = precision[:, None] * np.stack(sums[3:], axis=1) + slack[:, None] * across
        centre = centre + np.linalg.solve(information, right[:, :, None])[:, :, 0]
    return centre, np.asarray(np.linalg.inv(information), dtype=np.float64)
