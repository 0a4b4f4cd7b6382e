"""Pictures of tags as a ceiling camera with any lens sees them, drawn ray by ray.

Each picture is painted three times as fine and averaged. The rays are the tests' own: they share
no formula with the lens under test, but for the polynomial's coefficients.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from host.config import Camera, Ceiling
from host.messages import FloatArray

_FINE = 3
_QUIET = 1.25  # the white field around a tag, in sides of the black square
_CELLS = 6  # of a 4x4 tag and its border


def marker(number: int, pixels: int = _CELLS) -> NDArray[np.uint8]:
    """A tag as a square picture, 0 black and 255 white; as small as can be, its (6, 6) cells."""
    aruco = cv2.aruco
    tags = aruco.getPredefinedDictionary(aruco.DICT_4X4_50)
    if hasattr(aruco, "generateImageMarker"):
        return np.asarray(aruco.generateImageMarker(tags, number, pixels))
    return np.asarray(aruco.drawMarker(tags, number, pixels))  # before 4.7


def rays(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Vectors (n, 3) in the floor's frame of a camera that looks straight down.

    Its picture's up is its heading. The angle of a lens is found step by step, which does for a
    slight distortion.
    """
    across = (pixels - (camera.centre_x_px, camera.centre_y_px)) / camera.focal_px
    radius = np.hypot(*across.T)
    angle = radius.copy()
    for _ in range(8 if camera.k1 or camera.k2 else 0):
        square = angle * angle
        angle = radius / (1.0 + square * (camera.k1 + camera.k2 * square))
    tangent = np.tan(angle) / np.maximum(radius, 1e-12)
    ahead, left = -across[:, 1] * tangent, -across[:, 0] * tangent
    c, s = math.cos(camera.heading_rad), math.sin(camera.heading_rad)
    return np.stack((c * ahead - s * left, s * ahead + c * left, -np.ones_like(angle)), axis=1)


def pixel_of(camera: Camera, point: FloatArray) -> FloatArray:
    """Where a point (3,) m of the floor's frame is in the picture of a camera that looks down."""
    x, y, z = point - (camera.x_m, camera.y_m, camera.z_m)
    c, s = math.cos(camera.heading_rad), math.sin(camera.heading_rad)
    ahead, left = c * x + s * y, c * y - s * x
    across = math.hypot(ahead, left)
    angle = math.atan2(across, -z)
    radius = camera.focal_px * (angle + camera.k1 * angle**3 + camera.k2 * angle**5)
    scale = radius / max(across, 1e-12)
    return np.array([camera.centre_x_px - scale * left, camera.centre_y_px - scale * ahead])


def draw(ceiling: Ceiling, tags: dict[int, tuple[float, float, float]], seed: int = 0) -> NDArray:
    """A grey picture, a little blurred and noisy, of tags at poses x, y (m), heading (rad)."""
    return draw_all(ceiling, list(tags.items()), seed)


def draw_all(
    ceiling: Ceiling, tags: list[tuple[int, tuple[float, float, float]]], seed: int = 0
) -> NDArray:
    """As `draw`, where a number may be there twice."""
    camera, random = ceiling.eye, np.random.default_rng(seed)
    picture = np.full((camera.height_px, camera.width_px), 110.0, np.float32)
    for number, pose in tags:
        _draw_one(picture, ceiling, number, pose)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7)
    picture += 2.0 * random.standard_normal(picture.shape, dtype=np.float32)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _draw_one(
    picture: FloatArray, ceiling: Ceiling, number: int, pose: tuple[float, float, float]
) -> None:
    camera, side = ceiling.eye, ceiling.tag_m
    centre = pixel_of(camera, np.array([pose[0], pose[1], ceiling.tag_height_m]))
    reach = 1.1 * _QUIET * side * camera.focal_px / (camera.z_m - ceiling.tag_height_m)
    x0, y0 = np.maximum(np.floor(centre - reach).astype(int), 0)
    x1, y1 = np.minimum(
        np.ceil(centre + reach).astype(int) + 1, (camera.width_px, camera.height_px)
    )
    fine = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    columns = (np.arange(x0, x1)[:, None] + fine).ravel()
    rows = (np.arange(y0, y1)[:, None] + fine).ravel()
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    seen = rays(camera, pixels)[:, :2] * (camera.z_m - ceiling.tag_height_m) + (
        camera.x_m,
        camera.y_m,
    )
    c, s = math.cos(pose[2]), math.sin(pose[2])
    off = seen - pose[:2]
    right, up = (off @ (c, s)) / side, (off @ (-s, c)) / side
    column = np.floor((right + 0.5) * _CELLS).astype(int)
    row = np.floor((0.5 - up) * _CELLS).astype(int)
    inside = (column >= 0) & (column < _CELLS) & (row >= 0) & (row < _CELLS)
    light = np.where(inside, 20 + 0.8 * marker(number)[row % _CELLS, column % _CELLS], 225.0)
    paper = np.maximum(np.abs(right), np.abs(up)) < 0.5 * _QUIET
    patch = picture[y0:y1, x0:x1]
    under = np.repeat(np.repeat(patch, _FINE, axis=0), _FINE, axis=1).ravel()
    painted = np.where(paper, light, under).reshape(y1 - y0, _FINE, x1 - x0, _FINE)
    picture[y0:y1, x0:x1] = painted.mean(axis=(1, 3))
