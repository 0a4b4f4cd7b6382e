"""What rooms look like: the paint of floor and walls, by name; some are hard on a red strip.

Colours are (blue, green, red), 0 to 255, at full light. Rows of walls count from the floor up.
"""

import colorsys
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from host.messages import FloatArray, Image

_POSTERS = (  # none of them red
    (120.0, 90.0, 50.0),
    (70.0, 120.0, 70.0),
    (60.0, 60.0, 62.0),
    (90.0, 170.0, 190.0),
    (88.0, 112.0, 140.0),
    (215.0, 215.0, 215.0),
)
_BRICK, _MORTAR = (58.0, 72.0, 150.0), (150.0, 158.0, 164.0)
_BRICK_M, _COURSE_M, _JOINT_M = 0.25, 0.075, 0.012  # with their joints
_CARPET = (45.0, 38.0, 140.0)
_ORANGE = (45.0, 95.0, 200.0)
_PLANK, _PANEL = (70.0, 118.0, 172.0), (52.0, 80.0, 148.0)
_BOARD_M, _SHELF_M = 0.03, 0.35

Paint = Callable[[tuple[int, int], float, np.random.Generator], FloatArray]


@dataclass(frozen=True, slots=True)
class RoomPaint:
    """Paints of a room, each (shape, px per m, random) to colours (h, w, 3).

    per_m: px of paint per m. coarse_px: px of the picture a side of one that is computed.
    """

    floor: Paint
    walls: Paint
    per_m: float = 100.0
    coarse_px: int = 5


def _worn(shape: tuple[int, int], strength: float, random: np.random.Generator) -> FloatArray:
    """Brightness (h, w) around 1 with spots of many sizes."""
    height, width = shape
    worn = np.ones(shape)
    for size in (2, 5, 20, 80):
        spots = random.standard_normal((height // size + 2, width // size + 2), dtype=np.float32)
        worn += 0.5 * strength * cv2.resize(spots, (width, height), interpolation=cv2.INTER_CUBIC)
    return worn


def _tiles(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    """A worn grey-brown floor in tiles of half a metre."""
    return _tiled((104.0, 116.0, 124.0), shape, per_m, random)


def _tiled(
    colour: tuple[float, float, float],
    shape: tuple[int, int],
    per_m: float,
    random: np.random.Generator,
) -> FloatArray:
    side = shape[0]
    floor = np.array(colour) * _worn(shape, 0.09, random)[..., None]
    tile = max(1, int(0.5 * per_m))
    shades = random.uniform(0.94, 1.06, (side // tile + 1, side // tile + 1))
    floor *= np.kron(shades, np.ones((tile, tile)))[:side, :side, None]
    floor[::tile] *= 0.8
    floor[:, ::tile] *= 0.8
    return np.asarray(floor)


def _light_walls(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    """Four light walls with a skirting board, doors and posters."""
    walls = np.array([176.0, 184.0, 188.0]) * _worn(shape, 0.03, random)[..., None]
    for _ in range(int(shape[1] / per_m / 2.0)):
        left = random.integers(0, shape[1])
        right = left + int(random.uniform(0.2, 0.9) * per_m)
        low, high = (int(h * per_m) for h in np.sort(random.uniform(0.1, 2.3, 2)))
        walls[low:high, left:right] = _POSTERS[random.integers(len(_POSTERS))]
    walls[: max(1, int(0.07 * per_m))] = (62.0, 70.0, 76.0)
    return np.asarray(walls)


def _bricks(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    """Red bricks, each burnt unlike its neighbours, in light mortar."""
    height, width = shape
    up, along = (np.arange(n) / per_m for n in shape)
    course = (up / _COURSE_M).astype(int)
    shifted = along + 0.5 * _BRICK_M * (course % 2)[:, None]
    brick = (shifted / _BRICK_M).astype(int)
    shades = random.uniform(0.7, 1.15, (course[-1] + 1, int(brick.max()) + 1, 1))
    tints = random.uniform(0.9, 1.1, (*shades.shape[:2], 3))
    walls = np.array(_BRICK) * (shades * tints)[course[:, None], brick]
    joint = (shifted % _BRICK_M < _JOINT_M) | (up % _COURSE_M < _JOINT_M)[:, None]
    walls[joint] = _MORTAR
    return np.asarray(walls * _worn((height, width), 0.06, random)[..., None])


def _carpet(shape: tuple[int, int], _per_m: float, random: np.random.Generator) -> FloatArray:
    return np.array(_CARPET) * _worn(shape, 0.15, random)[..., None]


def _orange_tiles(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    return _tiled(_ORANGE, shape, per_m, random)


def _planks(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    """Floorboards with their grain."""
    return _wood(_PLANK, 0.14, shape, per_m, random)


def _panels(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    """Walls panelled in reddish wood to 1.2 m, light above."""
    walls = _light_walls(shape, per_m, random)
    top = int(1.2 * per_m)
    walls[:top] = _wood(_PANEL, 0.2, (shape[1], top), per_m, random).transpose(1, 0, 2)
    return walls


def _wood(
    colour: tuple[float, float, float],
    board_m: float,
    shape: tuple[int, int],
    per_m: float,
    random: np.random.Generator,
) -> FloatArray:
    """Boards along the columns (h, w, 3): shades and tints of their own, streaks along them."""
    height, width = shape
    board = (np.arange(height) / per_m / board_m).astype(int)
    shades = random.uniform(0.75, 1.15, (board[-1] + 1, 1)) * random.uniform(
        0.92, 1.08, (board[-1] + 1, 3)
    )
    grain = random.standard_normal((height, width // 40 + 2), dtype=np.float32)
    streaks = 1.0 + 0.08 * cv2.resize(grain, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.array(colour) * shades[board][:, None] * streaks[..., None])


def _shelves(shape: tuple[int, int], per_m: float, random: np.random.Generator) -> FloatArray:
    """Shelves full of boxes and books of every colour, up to 1.8 m."""
    walls = _light_walls(shape, per_m, random)
    for shelf in range(int(1.8 / _SHELF_M)):
        bottom = shelf * _SHELF_M + _BOARD_M
        rows = slice(int((bottom - _BOARD_M) * per_m), int((bottom + _SHELF_M) * per_m))
        walls[rows] = (40.0, 42.0, 44.0)
        walls[rows.start : int(bottom * per_m)] = (150.0, 172.0, 184.0)
        place = 0.0
        while place < shape[1] / per_m:
            wide, tall = random.uniform(0.03, 0.3), random.uniform(0.08, _SHELF_M - _BOARD_M - 0.02)
            box = slice(int(place * per_m), int((place + wide) * per_m))
            red, green, blue = colorsys.hsv_to_rgb(
                random.uniform(), random.uniform(0.2, 0.95), random.uniform(0.25, 0.9)
            )
            walls[int(bottom * per_m) : int((bottom + tall) * per_m), box] = (
                255.0 * blue,
                255.0 * green,
                255.0 * red,
            )
            place += wide + random.choice((0.004, 0.01, 0.1))
    return walls


def as_image(values: FloatArray) -> Image:
    """Colours (h, w, 3) as a picture's."""
    return np.clip(values, 0.0, 255.0).astype(np.uint8)


PLAIN = RoomPaint(_tiles, _light_walls)
ROOMS = {
    "plain": PLAIN,
    "sharp": RoomPaint(_tiles, _light_walls, 200.0, 2),
    "brick": RoomPaint(_tiles, _bricks, 200.0, 2),
    "carpet": RoomPaint(_carpet, _light_walls, 200.0, 2),
    "orange_floor": RoomPaint(_orange_tiles, _light_walls, 200.0, 2),
    "wood": RoomPaint(_planks, _panels, 200.0, 2),
    "shelves": RoomPaint(_tiles, _shelves, 200.0, 2),
}
