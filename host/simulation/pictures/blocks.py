"""Furniture as a camera on the robot sees it: boxes, legs, seats and table tops."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from host.geometry import to_frame
from host.messages import BoolArray, FloatArray
from host.simulation.pictures.solids import Colour, Cylinder, Face, lit, shade
from host.simulation.world.furniture import SEAT_M, TABLE_TOP_M, Furniture, corners

CARDBOARD: Colour = (112.0, 146.0, 172.0)
STEEL: Colour = (92.0, 90.0, 88.0)
_SEAT: Colour = (96.0, 70.0, 52.0)
_TABLE_TOP: Colour = (190.0, 196.0, 198.0)
_SLICE_M = 0.12  # of a side: narrow enough to be as a whole before or behind a robot
_OVERLAP_M = 0.005  # of slices, so that nothing shines through between them

# Faces painted together: how far away they are (m), they, and a point (3,) in their middle.
Drawn = tuple[float, list[Face], FloatArray]


@dataclass(frozen=True, slots=True)
class Block:
    """An upright box that stands on the floor: its top (m above the floor) and colour."""

    top_m: float
    colour: Colour

    def between(
        self, rectangle: FloatArray, viewpoint: FloatArray, points: FloatArray
    ) -> BoolArray:
        """Which `points` (k, 3) the block on a rectangle (5,) hides from `viewpoint` (3,)."""
        start = to_frame(viewpoint[None, :2], rectangle[:3])
        way = to_frame(points[:, :2], rectangle[:3]) - start
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.array([[[-0.5]], [[0.5]]]) * rectangle[3:] - start) / way
        enters = np.maximum(np.max(np.min(ends, axis=0), axis=1), 0.0)
        leaves = np.minimum(np.min(np.max(ends, axis=0), axis=1), 1.0)
        heights = viewpoint[2] + np.stack((enters, leaves)) * (points[:, 2] - viewpoint[2])
        hides: BoolArray = (enters < leaves) & (heights.min(axis=0) < self.top_m)
        return hides

    def sides(
        self, rectangle: FloatArray, viewpoint: FloatArray, light_rad: float
    ) -> Iterator[Face]:
        """Slices of the sides that `viewpoint` (3,) sees, each a flat face."""
        ends = corners(rectangle)
        for begin, end in zip(ends, np.roll(ends, -1, axis=0), strict=True):
            along = end - begin
            length = math.hypot(*along)
            outwards = np.array([along[1], -along[0]]) / length
            if outwards @ (viewpoint[:2] - begin) <= 0.0:
                continue
            colour = lit(self.colour, shade(math.atan2(outwards[1], outwards[0]) - light_rad))
            count = math.ceil(length / _SLICE_M)
            for k in range(count):
                shares = np.array([k / count, min((k + 1) / count + _OVERLAP_M / length, 1.0)])
                yield _slice(begin + shares[:, None] * along, self.top_m, colour)

    def lid(self, rectangle: FloatArray) -> Face:
        """The block from above."""
        return plate(rectangle, self.top_m, self.colour)


def plate(rectangle: FloatArray, height_m: float, colour: Colour) -> Face:
    """A level rectangle; its sides have corners in between, for a fisheye bends them."""
    ends = corners(rectangle)
    share = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None]
    level = np.concatenate(
        [a + share * (b - a) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
    )
    return Face(np.column_stack((level, np.full(len(level), height_m))), colour)


def opaque(furniture: Furniture) -> Iterator[tuple[Block | Cylinder, FloatArray]]:
    """What of furniture (robot frame) may hide a strip, and the place of each."""
    for place, radius, top in zip(
        furniture.legs, furniture.leg_radii, furniture.leg_tops, strict=True
    ):
        yield Cylinder(radius, 0.0, top, STEEL, STEEL), place
    for rectangle in furniture.boxes:
        yield Block(furniture.box_top_m, CARDBOARD), rectangle


def drawn(furniture: Furniture, viewpoint: FloatArray, light_rad: float) -> Iterator[Drawn]:
    """Furniture (robot frame), in pieces small enough to be ordered by their distance."""
    for solid, place in opaque(furniture):
        if isinstance(solid, Cylinder):
            yield _drawn(solid.faces(place, viewpoint, light_rad), place, viewpoint)
            continue
        for face in solid.sides(place, viewpoint, light_rad):
            yield _drawn([face], face.corners[:, :2].mean(axis=0), viewpoint)
        if viewpoint[2] > solid.top_m:
            yield _drawn([solid.lid(place)], place[:2], viewpoint)
    for rectangle in furniture.chairs:
        yield _drawn([plate(rectangle, SEAT_M, _SEAT)], rectangle[:2], viewpoint)
    for rectangle in furniture.tables:
        yield _drawn([plate(rectangle, TABLE_TOP_M, _TABLE_TOP)], rectangle[:2], viewpoint)


def _drawn(faces: list[Face], place: FloatArray, viewpoint: FloatArray) -> Drawn:
    middle = np.append(place, np.mean([face.corners[:, 2].mean() for face in faces] or [0.0]))
    return math.hypot(*(place - viewpoint[:2])), faces, middle


def _slice(ends: FloatArray, top_m: float, colour: Colour) -> Face:
    """An upright strip of a side from the floor to its top; its edges bend in a fisheye."""
    heights = np.linspace(0.0, top_m, 6)
    up = np.column_stack((np.tile(ends[0], (6, 1)), heights))
    down = np.column_stack((np.tile(ends[1], (6, 1)), heights[::-1]))
    return Face(np.concatenate((up, down)), colour)
