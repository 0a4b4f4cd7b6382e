"""Furniture of a scenario's room: chairs, tables and boxes, where the seed puts them.

Seats and table tops are above the lidar's plane, which meets legs and boxes alone. A chair's legs
are joined by rungs below that plane: robots drive around it. They drive under tables.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from host.errors import UserError
from host.geometry import to_frame, to_parent
from host.messages import FloatArray
from host.simulation.world.scenarios import Scenario

SEAT_M, TABLE_TOP_M = 0.45, 0.74  # heights
_CHAIR_M = (0.36, 0.46)  # from leg to leg
_TABLE_M = ((0.9, 1.4), (0.6, 0.8))  # from leg to leg, along and across
_BOX_M = ((0.3, 0.7), (0.2, 0.45))
_LEG_RADIUS_M = (0.01, 0.0225)
_TABLE_LEG_RADIUS_M = (0.015, 0.035)
_GAP_M = 0.4  # between pieces at least, and between those that stand free and the walls
_TRIES = 2000
_CORNERS: FloatArray = 0.5 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


@dataclass(frozen=True, slots=True)
class Furniture:
    """What stands in the room.

    legs (n, 2) m, leg_radii (n,) m and leg_tops (n,) m above the floor: upright cylinders. chairs,
    tables, boxes (k, 5): rectangles x, y (m), heading (rad), length along it and width (m).
    box_top_m: of all boxes, above the floor.
    """

    legs: FloatArray
    leg_radii: FloatArray
    leg_tops: FloatArray
    chairs: FloatArray
    tables: FloatArray
    boxes: FloatArray
    box_top_m: float

    @property
    def closed(self) -> FloatArray:
        """Rectangles (k, 5) that no robot drives into."""
        return np.concatenate((self.chairs, self.boxes))

    def seen_from(self, pose: FloatArray) -> "Furniture":
        """The furniture in the frame of a robot at `pose` (x, y, heading)."""
        rectangles = [
            np.column_stack((to_frame(r[:, :2], pose), r[:, 2] - pose[2], r[:, 3:]))
            for r in (self.chairs, self.tables, self.boxes)
        ]
        chairs, tables, boxes = rectangles
        legs = to_frame(self.legs, pose)
        return replace(self, legs=legs, chairs=chairs, tables=tables, boxes=boxes)

    def clearance(self, point: FloatArray) -> float:
        """How far (m) a point (2,) is from the nearest leg or closed rectangle."""
        to_legs = np.hypot(*(self.legs - point).T) - self.leg_radii
        to_closed = np.hypot(*(nearest_points(self.closed, point[None])[0] - point).T)
        return float(np.min(np.concatenate((to_legs, to_closed)), initial=math.inf))


NO_FURNITURE = Furniture(
    legs=np.zeros((0, 2)),
    leg_radii=np.zeros(0),
    leg_tops=np.zeros(0),
    chairs=np.zeros((0, 5)),
    tables=np.zeros((0, 5)),
    boxes=np.zeros((0, 5)),
    box_top_m=0.0,
)


def furnish(scenario: Scenario) -> Furniture:
    """Furniture of the scenario's room, by its seed. Raises UserError where it finds no place."""
    room = _Room(scenario)
    tables = [room.put(_sides(room.random, *_TABLE_M)) for _ in range(scenario.tables)]
    boxes = [
        room.put(_sides(room.random, *_BOX_M), at_wall=k % 2 == 0) for k in range(scenario.boxes)
    ]
    chairs = [room.put(np.full(2, room.random.uniform(*_CHAIR_M))) for _ in range(scenario.chairs)]
    legs = [corners(piece) for piece in (*chairs, *tables)]
    radii = [room.random.uniform(*_LEG_RADIUS_M) for _ in chairs]
    radii += [room.random.uniform(*_TABLE_LEG_RADIUS_M) for _ in tables]
    tops = [SEAT_M] * len(chairs) + [TABLE_TOP_M] * len(tables)
    return Furniture(
        legs=np.concatenate((*legs, np.zeros((0, 2)))),
        leg_radii=np.repeat(radii, 4),
        leg_tops=np.repeat(tops, 4),
        chairs=_table_of(chairs),
        tables=_table_of(tables),
        boxes=_table_of(boxes),
        box_top_m=scenario.box_height_m,
    )


def corners(rectangle: FloatArray) -> FloatArray:
    """Corners (4, 2) m of a rectangle (5,), counter-clockwise from its left end ahead."""
    return to_parent(_CORNERS * rectangle[3:], rectangle[:3])


def nearest_points(rectangles: FloatArray, points: FloatArray) -> FloatArray:
    """The points (n, m, 2) of rectangles (m, 5) that are nearest to `points` (n, 2).

    A point inside of a rectangle is its own nearest one.
    """
    inside = to_frame(points[:, None], rectangles[:, :3])
    x, y = np.moveaxis(np.clip(inside, -0.5 * rectangles[:, 3:], 0.5 * rectangles[:, 3:]), 2, 0)
    c, s = np.cos(rectangles[:, 2]), np.sin(rectangles[:, 2])
    nearest: FloatArray = rectangles[:, :2] + np.stack((c * x - s * y, s * x + c * y), axis=-1)
    return nearest


class _Room:
    """Where pieces stand already, as circles around them."""

    def __init__(self, scenario: Scenario) -> None:
        self.random = scenario.generator("furniture")
        self._scenario = scenario
        self._middles = np.zeros((0, 2))
        self._radii = np.zeros(0)

    def put(self, sides: FloatArray, at_wall: bool = False) -> FloatArray:
        """A rectangle (5,) of these sides (2,), apart from the others: free, or along a wall."""
        radius = 0.5 * math.hypot(*sides)
        for _ in range(_TRIES):
            pose = self._along_wall(sides) if at_wall else self._free(radius)
            apart = np.hypot(*(self._middles - pose[:2]).T) - self._radii - radius
            outside = np.abs(pose[:2]).max() - radius > 0.5 * self._scenario.fence_m
            if np.all(apart > _GAP_M) and (outside or not self._scenario.fence_m):
                self._middles = np.vstack((self._middles, pose[:2]))
                self._radii = np.append(self._radii, radius)
                return np.concatenate((pose, sides))
        raise UserError(
            f"no room for the furniture of {self._scenario.name}",
            f"{len(self._radii)} pieces, {_GAP_M} m apart, are all that was placed in "
            f"{self._scenario.side_m} x {self._scenario.side_m} m",
            "ask for fewer chairs, tables or boxes, or a larger side_m",
        )

    def _free(self, radius: float) -> FloatArray:
        reach = max(0.5 * self._scenario.side_m - radius - _GAP_M, 0.0)
        heading = self.random.uniform(-math.pi, math.pi)
        return np.append(self.random.uniform(-reach, reach, 2), heading)

    def _along_wall(self, sides: FloatArray) -> FloatArray:
        half = 0.5 * self._scenario.side_m
        reach = max(half - 0.5 * sides[0], 0.0)
        place = np.array([[self.random.uniform(-reach, reach), half - 0.5 * sides[1]]])
        heading = 0.5 * math.pi * float(self.random.integers(4))
        return np.append(to_parent(place, np.array([0.0, 0.0, heading]))[0], heading)


def _sides(
    random: np.random.Generator, along: tuple[float, float], across: tuple[float, float]
) -> FloatArray:
    return np.array([random.uniform(*along), random.uniform(*across)])


def _table_of(rectangles: list[FloatArray]) -> FloatArray:
    return np.array(rectangles).reshape(-1, 5)
