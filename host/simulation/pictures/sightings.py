"""What is visible to a camera: the truth for rendered pictures."""

from dataclasses import dataclass

import numpy as np

from host.config import Strip
from host.messages import BoolArray, FloatArray
from host.perception.lens import View
from host.simulation.pictures.blocks import Block, opaque
from host.simulation.pictures.solids import BIN, POST, Cylinder, robot_of, strip_of
from host.simulation.world.furniture import NO_FURNITURE, Furniture

NOTHING: FloatArray = np.zeros((0, 2))
_ACROSS, _UP = 24, 6  # places on a strip that are looked at


@dataclass(frozen=True, slots=True)
class Sightings:
    """Each teammate as one camera has it in view.

    bearings (n,) rad and ranges (n,) m: of its origin, level, from the camera's place, in the
    robot frame's directions. shares (n,): how much of its strip's near side is in the picture and
    behind nothing, 0 to 1.
    """

    bearings: FloatArray
    ranges: FloatArray
    shares: FloatArray


def visible(
    view: View,
    strip: Strip,
    teammates: FloatArray,
    posts: FloatArray,
    furniture: Furniture = NO_FURNITURE,
    bins: FloatArray = NOTHING,
) -> Sightings:
    """What is visible to `view` of teammates (n, 2) m among posts (m, 2), bins (k, 2) m, furniture.

    All are in the robot frame.
    """
    x, y = (teammates - view.origin[:2]).T
    coat = strip_of(strip)
    solids: list[tuple[int, Block | Cylinder, FloatArray]] = [
        (number, part, place)
        for number, place in enumerate(teammates)
        for part in (*robot_of(strip), coat)
    ]
    solids += [(-1, POST, place) for place in posts]
    solids += [(-1, BIN, place) for place in bins]
    solids += [(-1, solid, place) for solid, place in opaque(furniture)]
    shares = [
        _share(view, coat, place, [solid[1:] for solid in solids if solid[0] != number])
        for number, place in enumerate(teammates)
    ]
    return Sightings(np.arctan2(y, x), np.hypot(x, y), np.array(shares))


def _share(
    view: View, coat: Cylinder, place: FloatArray, solids: list[tuple[Block | Cylinder, FloatArray]]
) -> float:
    points = near_side(coat, place, view.origin)
    if not len(points):
        return 0.0
    seen = inside_picture(view, points)
    for solid, where in solids:
        seen &= ~solid.between(where, view.origin, points)
    return float(np.mean(seen))


def near_side(coat: Cylinder, place: FloatArray, viewpoint: FloatArray) -> FloatArray:
    """Points (k, 3) on the half of a coat that `viewpoint` sees, about evenly as it sees them."""
    across = (np.arange(_ACROSS) + 0.5) / _ACROSS * 2.0 - 1.0
    angles = coat.arc(place, viewpoint, np.arcsin(across) / (0.5 * np.pi))
    up = (np.arange(_UP) + 0.5) / _UP
    heights = coat.bottom_m + up * (coat.top_m - coat.bottom_m)
    return coat.rims(place, angles, heights).reshape(-1, 3)


def inside_picture(view: View, points: FloatArray) -> BoolArray:
    """Which points (n, 3) the picture has a pixel for."""
    camera = view.lens.camera
    x, y = view.pixels_of(points).T  # nan compares false
    across: BoolArray = (x >= -0.5) & (x < camera.width_px - 0.5)
    down: BoolArray = (y >= -0.5) & (y < camera.height_px - 0.5)
    return across & down
