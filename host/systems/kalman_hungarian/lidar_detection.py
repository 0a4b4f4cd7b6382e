"""Robots in a scan: on the lidar's own, or where a camera says (Belaroussi 2024, section 4.3).

A robot is another robot's lidar: a cluster of returns as small as that. Its mean lies on the
surface, some 2 cm before the axis.
"""

import math
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from host.geometry import wrap
from host.messages import FloatArray

Detection = Literal["standalone", "partial", "full"]
DETECTIONS: tuple[Detection, ...] = ("standalone", "partial", "full")

_GAP_M = 0.15  # between returns of one cluster
_RETURNS = (2, 10)  # of a cluster
_RADIUS_M = 0.04  # of a cluster about its mean
_BOX_MARGIN_RAD = math.radians(10.0)  # beside the robot's own half width
_ROBOT_RADIUS_M = 0.15
_FULL_GATE_M = 0.15  # section 5.3.3


def detect(how: Detection, returns: FloatArray, seen: FloatArray) -> FloatArray:
    """Positions (k, 2) m of robots in the returns (n, 2) m of a scan, in the robot frame.

    seen (m, 2) m: where the camera says that robots are. standalone needs none of it (section
    4.3.1), partial takes the cluster in the middle of each bounding box, full the return nearest
    to each position (both 4.3.2).
    """
    if how == "standalone" or not len(returns):
        return clusters(returns)
    each = _in_box if how == "partial" else _nearest
    found = [position for one in seen if (position := each(returns, one)) is not None]
    return np.array(found).reshape(-1, 2)


def clusters(returns: FloatArray) -> FloatArray:
    """Means (k, 2) of the clusters of `returns` (n, 2) that may be lidars (section 4.3.1)."""
    if not len(returns):
        return np.zeros((0, 2))
    first, second = cKDTree(returns).query_pairs(_GAP_M, output_type="ndarray").T
    near = coo_array((np.ones(len(first)), (first, second)), (len(returns), len(returns)))
    count, member = connected_components(near, directed=False)
    sizes = np.bincount(member, minlength=count)
    sums = [np.bincount(member, axis, minlength=count) for axis in returns.T]
    means = np.column_stack(sums) / sizes[:, None]
    radii = np.zeros(count)
    np.maximum.at(radii, member, np.hypot(*(returns - means[member]).T))
    least, most = _RETURNS
    kept: FloatArray = means[(sizes >= least) & (sizes <= most) & (radii <= _RADIUS_M)]
    return kept


def _in_box(returns: FloatArray, seen: FloatArray) -> FloatArray | None:
    """The cluster nearest to the middle of a robot's bounding box; None for no cluster in it."""
    middle, distance = math.atan2(seen[1], seen[0]), math.hypot(*seen)
    half = _BOX_MARGIN_RAD + math.asin(min(_ROBOT_RADIUS_M / max(distance, _ROBOT_RADIUS_M), 1.0))
    aside = np.abs(wrap(np.arctan2(returns[:, 1], returns[:, 0]) - middle))
    found = clusters(returns[aside <= half])
    if not len(found):
        return None
    off = np.abs(wrap(np.arctan2(found[:, 1], found[:, 0]) - middle))
    best: FloatArray = found[np.argmin(off)]
    return best


def _nearest(returns: FloatArray, seen: FloatArray) -> FloatArray | None:
    """The return nearest to a position; None for none within 15 cm."""
    apart = np.hypot(*(returns - seen).T)
    nearest = int(np.argmin(apart))
    found: FloatArray = returns[nearest]
    return found if apart[nearest] < _FULL_GATE_M else None
