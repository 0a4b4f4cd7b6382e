"""Where a lidar's beams meet a square room, cylinders and boxes; plain geometry, no noise."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.drivers.x4.packets import CROSSING_M, EMITTER_OFFSET_M
from host.geometry import columns, to_frame, to_parent
from host.messages import FloatArray, IntArray

_INWARDS_M = math.hypot(EMITTER_OFFSET_M, CROSSING_M)


@dataclass(frozen=True, slots=True)
class Beams:
    """Straight beams in the world: they start at origins (k, 2) m along unit directions (k, 2).

    centres (k, 2) m: the lidar's axis at each sample, from which it counts ranges and bearings.
    """

    centres: FloatArray
    origins: FloatArray
    directions: FloatArray

    def ranges(self, distances: FloatArray) -> FloatArray:
        """Ranges (k,) m from the lidar's axis of the points at `distances` (k,) m on the beams."""
        x, y = (self.points(distances) - self.centres).T
        ranges: FloatArray = np.hypot(x, y)
        return ranges

    def points(self, distances: FloatArray) -> FloatArray:
        """Points (k, 2) of the world at `distances` (k,) m along the beams."""
        return self.origins + distances[:, None] * self.directions


# The beams at raw angles (k,) rad, clockwise, on a robot at poses (k, 3), by the lidar's mounting.
BeamsOf = Callable[[FloatArray, FloatArray, tuple[float, float, float]], Beams]


def straight_beams(
    raw_angles: FloatArray, poses: FloatArray, mounting: tuple[float, float, float]
) -> Beams:
    """Return beams that start at the lidar's axis and go straight outwards."""
    centres, ahead = _axes_and_bearings(raw_angles, poses, mounting)
    return Beams(centres, centres, columns(np.cos(ahead), np.sin(ahead)))


def x4_beams(
    raw_angles: FloatArray, poses: FloatArray, mounting: tuple[float, float, float]
) -> Beams:
    """Return the beams at raw angles (k,) rad, clockwise, of an X4 on a robot at poses (k, 3).

    mounting: the lidar's x, y (m) and heading (rad) in the robot frame. The laser sits beside the
    axis and looks inwards: in the frame rotated by the raw angle, x along it and y clockwise, the
    beam is the line y = 21.8 - x 21.8 / 155.3, in mm.
    """
    centres, ahead = _axes_and_bearings(raw_angles, poses, mounting)
    cosine, sine = np.cos(ahead), np.sin(ahead)
    clockwise = columns(sine, -cosine)
    directions = (CROSSING_M * columns(cosine, sine) - EMITTER_OFFSET_M * clockwise) / _INWARDS_M
    return Beams(centres, centres + EMITTER_OFFSET_M * clockwise, directions)


def _axes_and_bearings(
    raw_angles: FloatArray, poses: FloatArray, mounting: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Where the lidar's axis is (k, 2) m at each sample, and which way (k,) rad it looks."""
    x, y, heading = mounting
    return to_parent(np.array((x, y)), poses), poses[:, 2] + heading - raw_angles


@dataclass(frozen=True, slots=True)
class CylinderHits:
    """Which cylinder each beam meets first.

    distances (k,) m along the beam, inf where it meets none; misses (k,) m: how far off the
    cylinder's axis the beam passes; index (k,): which cylinder, meaningless where none.
    """

    distances: FloatArray
    misses: FloatArray
    index: IntArray


def meet_cylinders(beams: Beams, axes: FloatArray, radius: float | FloatArray) -> CylinderHits:
    """Meet cylinders whose axes stand at (k, m, 2), or none at all (m = 0).

    radius: m, of all of them or of each (m,).
    """
    count, cylinders = axes.shape[:2]
    if not cylinders:
        nothing = np.full(count, np.inf)
        return CylinderHits(nothing, nothing, np.zeros(count, dtype=np.int64))
    x = axes[..., 0] - beams.origins[:, :1]
    y = axes[..., 1] - beams.origins[:, 1:]
    ux, uy = beams.directions[:, :1], beams.directions[:, 1:]
    along = ux * x + uy * y
    off = ux * y - uy * x
    inside = radius**2 - off**2
    beam, axis = np.nonzero((inside > 0.0) & (along > 0.0))
    distances = np.full(along.shape, np.inf)
    distances[beam, axis] = along[beam, axis] - np.sqrt(inside[beam, axis])
    index = np.argmin(distances, axis=1)
    each = np.arange(count)
    return CylinderHits(distances[each, index], np.abs(off[each, index]), index)


@dataclass(frozen=True, slots=True)
class BoxHits:
    """Where beams from outside meet boxes first.

    distances (k,) m along the beam, inf where there is none; incidence_cosines (k,): 1 straight
    on, 0 grazing.
    """

    distances: FloatArray
    incidence_cosines: FloatArray


def meet_boxes(beams: Beams, boxes: FloatArray) -> BoxHits:
    """Meet the sides of boxes (m, 5): x, y (m), heading (rad), length and width (m)."""
    count = len(beams.directions)
    if not len(boxes):
        return BoxHits(np.full(count, np.inf), np.ones(count))
    origins = to_frame(beams.origins[:, None], boxes[:, :3])
    turned = np.column_stack((np.zeros((len(boxes), 2)), boxes[:, 2]))
    directions = to_frame(beams.directions[:, None], turned)
    # A beam is inside of a box where it is between both pairs of opposite sides.
    with np.errstate(divide="ignore", invalid="ignore"):
        ways = (np.array([-0.5, 0.5])[:, None, None, None] * boxes[:, 3:] - origins) / directions
    enters, leaves = np.min(ways, axis=0), np.max(ways, axis=0)
    distances = np.max(enters, axis=2)
    met = (distances < np.min(leaves, axis=2)) & (distances > 0.0)
    distances = np.where(met, distances, np.inf)
    index = np.argmin(distances, axis=1)
    each = np.arange(count)
    side = np.argmax(enters[each, index], axis=1)
    return BoxHits(distances[each, index], np.abs(directions[each, index, side]))


@dataclass(frozen=True, slots=True)
class WallHits:
    """Where beams from inside meet the walls.

    distances (k,) m along the beam; incidence_cosines (k,): 1 straight on, 0 grazing;
    places (k,) m: the point's way along the walls, from 0 to their whole length.
    """

    distances: FloatArray
    incidence_cosines: FloatArray
    places: FloatArray


def meet_walls(beams: Beams, half_side_m: float) -> WallHits:
    """Meet the four walls of the square room |x|, |y| <= half_side_m."""
    with np.errstate(divide="ignore"):
        ways = (np.copysign(half_side_m, beams.directions) - beams.origins) / beams.directions
    wall = np.argmin(ways, axis=1)  # 0: met at x = ±half a side, 1: at y
    each = np.arange(len(wall))
    distances = ways[each, wall]
    points = beams.points(distances)
    side = 2 * wall + (beams.directions[each, wall] > 0.0)
    places = (2 * side + 1) * half_side_m + points[each, 1 - wall]
    return WallHits(distances, np.abs(beams.directions[each, wall]), places)
