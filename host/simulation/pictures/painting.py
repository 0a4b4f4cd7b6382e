"""Paint faces into a picture: antialiased, blurred by the robot's rotation, nearer over farther."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from host.messages import FloatArray, Image
from host.perception.lens import View
from host.simulation.pictures.solids import Face

_SHIFT_BITS = 4  # of fillPoly's coordinates


@dataclass(frozen=True, slots=True)
class Sprite:
    """Painted faces and where they belong.

    x, y: the canvas pixel of the upper left one. bgra (h, w, 4): colours times coverage, coverage.
    """

    x: int
    y: int
    bgra: Image


class Painter:
    """Paints what one camera sees on its pictures."""

    def __init__(self, view: View) -> None:
        self._view = view
        camera = view.lens.camera
        self._size = (camera.width_px, camera.height_px)
        corners = np.array(
            [[x, y] for x in (0, camera.width_px - 1) for y in (0, camera.height_px - 1)]
        )
        angles = view.lens.angle(
            np.hypot(*(corners - (camera.centre_x_px, camera.centre_y_px)).T.astype(float))
        )
        self._edge_rad = float(np.max(np.where(np.isnan(angles), view.lens.limit_rad, angles)))

    def sprite(
        self, faces: Sequence[Face], middle: FloatArray, turn_rad: float = 0.0
    ) -> Sprite | None:
        """Faces painted in their order; None where no part of them is in the picture.

        middle (3,) m: by whose way the whole is blurred, where the robot rotates by `turn_rad`
        while the picture is exposed.
        """
        outlines = self._outlines(faces)
        if not outlines:
            return None
        smear = self._smear(middle, turn_rad)
        every = np.concatenate([pixels for pixels, _ in outlines])
        margin = 0.5 * np.abs(smear) + 1.0
        low = np.maximum(np.floor(every.min(axis=0) - margin), 0.0).astype(int)
        high = np.minimum(np.ceil(every.max(axis=0) + margin) + 1.0, self._size).astype(int)
        width, height = high - low
        if width <= 0 or height <= 0:
            return None
        fine = _fineness(max(width, height))
        large = np.zeros((height * fine, width * fine, 4), dtype=np.uint8)
        for pixels, colour in outlines:
            # Pixel (0, 0) is the middle of the first one, and of its finer ones too.
            corners = ((pixels - low + 0.5) * fine - 0.5) * 2**_SHIFT_BITS
            cv2.fillPoly(large, [np.rint(corners).astype(np.int32)], colour, shift=_SHIFT_BITS)
        return Sprite(int(low[0]), int(low[1]), _blurred(_halved(large, fine), smear))

    def _outlines(
        self, faces: Sequence[Face]
    ) -> list[tuple[FloatArray, tuple[float, float, float, float]]]:
        """Corners (k, 2) px and colours, with full coverage, of what may be in the picture."""
        if not faces:
            return []
        corners = np.concatenate([face.corners for face in faces])
        rays = (corners - self._view.origin) @ self._view.to_robot
        pixels = self._view.lens.project(rays)
        off_axis = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
        # What lies around the direction straight behind would be drawn across the picture.
        near = off_axis <= self._edge_rad
        known = ~np.isnan(pixels[:, 0])
        whole = bool(known.all() and near.all())
        outlines = []
        end = 0
        for face in faces:
            part = slice(end, end := end + len(face.corners))
            drawn = pixels[part]
            if not whole:
                drawn = drawn[known[part]] if near[part].any() else drawn[:0]
            if len(drawn) > 2:
                blue, green, red = (min(value, 255.0) for value in face.colour)
                outlines.append((drawn, (blue, green, red, 255.0)))
        return outlines

    def _smear(self, middle: FloatArray, turn_rad: float) -> FloatArray:
        """How far (2,) px a point of the room moves in the picture while the robot rotates."""
        if turn_rad == 0.0:
            return np.zeros(2)
        c, s = math.cos(0.5 * turn_rad), math.sin(0.5 * turn_rad)
        x, y, z = middle
        ways = np.array([[c * x + s * y, c * y - s * x, z], [c * x - s * y, c * y + s * x, z]])
        after, before = self._view.pixels_of(ways)
        return np.asarray(np.nan_to_num(after - before))


def lay(canvas: Image, sprite: Sprite, gain: float) -> None:
    """Lay a sprite over the canvas, its colours brightened by `gain`."""
    height, width = sprite.bgra.shape[:2]
    place = canvas[sprite.y : sprite.y + height, sprite.x : sprite.x + width]
    coverage = cv2.cvtColor(sprite.bgra[..., 3], cv2.COLOR_GRAY2BGR)
    colours = cv2.convertScaleAbs(cv2.cvtColor(sprite.bgra, cv2.COLOR_BGRA2BGR), alpha=gain)
    colours = cv2.min(colours, coverage)  # as bright as white, times the coverage
    behind = cv2.multiply(place, cv2.bitwise_not(coverage), scale=1.0 / 255.0)
    cv2.add(behind, colours, dst=place)


def _fineness(size_px: int) -> int:
    """How many times finer to paint, a power of 2: large things need it less, and cost more."""
    if size_px <= 60:
        return 8
    return 4 if size_px <= 200 else 2


def _halved(image: Image, times: int) -> Image:
    """Means over squares of `times` pixels a side, a power of 2: OpenCV halves much faster."""
    while times > 1:
        height, width = image.shape[:2]
        image = np.asarray(
            cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA),
            dtype=np.uint8,
        )
        times //= 2
    return image


def _blurred(image: Image, smear: FloatArray) -> Image:
    if np.hypot(*smear) < 0.5:
        return image
    blurred = cv2.filter2D(image, -1, _line(smear), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, dtype=np.uint8)


def _line(smear: FloatArray) -> NDArray[np.float32]:
    """Kernel that blurs along `smear` (2,) px and moves no centroid."""
    half = np.ceil(0.5 * np.abs(smear)).astype(int)
    kernel = np.zeros((2 * half[1] + 3, 2 * half[0] + 3))
    for share in np.linspace(-0.5, 0.5, 2 * int(np.abs(smear).max()) + 3):
        x, y = share * smear + half + 1
        left, above = int(x), int(y)
        right_share, below_share = x - left, y - above
        kernel[above, left] += (1 - below_share) * (1 - right_share)
        kernel[above, left + 1] += (1 - below_share) * right_share
        kernel[above + 1, left] += below_share * (1 - right_share)
        kernel[above + 1, left + 1] += below_share * right_share
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)
