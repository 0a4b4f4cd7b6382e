"""Pictures with strips drawn straight from the formulas: a truth of the tests' own."""

import math

import cv2
import numpy as np

from host.config import Camera, Cameras
from host.messages import FloatArray, Image

STRIP_BGR = (40.0, 35.0, 190.0)
GREEN_BGR, MAGENTA_BGR = (79.0, 166.0, 55.0), (129.0, 49.0, 188.0)
_FINE = 4  # drawn so much larger, and averaged


def pixel_of(point: FloatArray, camera: Camera) -> tuple[float, float]:
    """Where a point (x, y, z) m of the robot frame meets the picture of an equidistant lens."""
    ahead, aside, up = point - (camera.x_m, camera.y_m, camera.z_m)
    c, s = math.cos(camera.heading_rad), math.sin(camera.heading_rad)
    ahead, left = c * ahead + s * aside, c * aside - s * ahead
    c, s = math.cos(camera.tilt_rad), math.sin(camera.tilt_rad)
    axis, down = c * ahead - s * up, -s * ahead - c * up
    across = math.hypot(left, down)
    radius = camera.focal_px * math.atan2(across, axis)
    return camera.centre_x_px - radius * left / across, camera.centre_y_px + radius * down / across


def place(camera: Camera, bearing: float, distance: float) -> FloatArray:
    """Point (x, y) m of the robot frame at a bearing (rad) and distance from the camera."""
    return np.array([camera.x_m, camera.y_m]) + distance * np.array(
        [math.cos(bearing), math.sin(bearing)]
    )


def background(camera: Camera, seed: int) -> Image:
    """Uneven grey with a touch of colour, and a sensor's noise."""
    random = np.random.default_rng(seed)
    cells = random.integers(90, 160, (18, 32, 1)) + random.integers(-10, 11, (18, 32, 3))
    size = (camera.width_px, camera.height_px)
    smooth = cv2.resize(cells.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(smooth + random.normal(0.0, 4.0, smooth.shape), np.uint8)


def draw_quad(
    picture: Image, corners: list[tuple[float, float]], colour: tuple[float, ...]
) -> None:
    """Fill a polygon, its edges smooth."""
    points = np.array(corners)
    height, width = picture.shape[:2]
    x0, y0 = np.clip(np.floor(points.min(axis=0)).astype(int) - 1, 0, (width, height))
    x1, y1 = np.clip(np.ceil(points.max(axis=0)).astype(int) + 2, 0, (width, height))
    if x1 <= x0 or y1 <= y0:
        return
    fine = np.zeros(((y1 - y0) * _FINE, (x1 - x0) * _FINE), np.uint8)
    inner = (points - (x0, y0) + 0.5) * _FINE - 0.5
    cv2.fillPoly(fine, [np.rint(inner * 256).astype(np.int32)], 255, shift=8)
    share = cv2.resize(fine, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA)[..., None] / 255.0
    picture[y0:y1, x0:x1] = picture[y0:y1, x0:x1] * (1.0 - share) + np.array(colour) * share


def draw_coat(
    picture: Image,
    camera: Camera,
    middle: FloatArray,
    heights: tuple[float, float],
    diameter: float,
    colour: tuple[float, ...] = STRIP_BGR,
) -> None:
    """The visible half of an upright cylinder's coat between two heights (m) around (x, y) m."""
    to_camera = np.array([camera.x_m, camera.y_m]) - middle
    facing, reach = math.atan2(to_camera[1], to_camera[0]), float(np.hypot(*to_camera))
    half = math.acos(min(0.5 * diameter / reach, 1.0))
    rim = [
        middle + 0.5 * diameter * np.array([math.cos(a), math.sin(a)])
        for a in facing + np.linspace(-half, half, 25)
    ]
    low = [pixel_of(np.append(point, heights[0]), camera) for point in rim]
    high = [pixel_of(np.append(point, heights[1]), camera) for point in rim]
    draw_quad(picture, low + high[::-1], colour)


def draw_strip(
    picture: Image,
    cameras: Cameras,
    camera: Camera,
    middle: FloatArray,
    colour: tuple[float, ...] = STRIP_BGR,
) -> None:
    """A teammate's strip around (x, y) m."""
    strip = cameras.strip
    heights = (strip.height_m - 0.5 * strip.tall_m, strip.height_m + 0.5 * strip.tall_m)
    draw_coat(picture, camera, middle, heights, strip.diameter_m, colour)


def draw_pair(
    picture: Image,
    cameras: Cameras,
    camera: Camera,
    middle: FloatArray,
    colours: tuple[tuple[float, ...], tuple[float, ...]] = (GREEN_BGR, MAGENTA_BGR),
) -> None:
    """A teammate's strip of two colours, upper and lower, around (x, y) m."""
    strip = cameras.strip
    for side, colour in zip((1.0, -1.0), colours, strict=True):
        edge = strip.height_m + side * 0.5 * strip.tall_m
        draw_coat(picture, camera, middle, (strip.height_m, edge), strip.diameter_m, colour)


def encode(picture: Image, quality: int = 80) -> bytes:
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])
