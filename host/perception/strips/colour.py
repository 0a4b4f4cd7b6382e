"""Which pixels have the strip's colour, and how much of it."""

import colorsys

import cv2
import numpy as np

from host.config import Strip
from host.messages import FloatArray, Image

_HUES = 180  # OpenCV counts hue in steps of 2 deg, so that it fits a byte
_DARK = 12.0  # of 255; what is darker has no colour to speak of


class StripColour:
    """The colour range of [camera.strip], as OpenCV has hue, saturation and value."""

    def __init__(self, strip: Strip) -> None:
        half = 0.25 * strip.hue_width_deg
        middle = 0.5 * strip.hue_deg
        low, high = round(middle - half), round(middle + half)
        if high - low >= _HUES:
            spans = [(0, _HUES - 1)]
        elif low < 0:
            spans = [(0, high), (low + _HUES, _HUES - 1)]
        elif high >= _HUES:
            spans = [(low, _HUES - 1), (0, high - _HUES)]
        else:
            spans = [(low, high)]
        saturation, value = round(255.0 * strip.saturation_min), round(255.0 * strip.value_min)
        self._ranges = [((a, saturation, value), (b, 255, 255)) for a, b in spans]
        red, green, blue = colorsys.hsv_to_rgb(strip.hue_deg / 360.0, 1.0, 1.0)
        pure = np.array([blue, green, red])
        self._direction = pure - pure.mean()

    def mask(self, picture: Image) -> Image:
        """255 where a pixel of `picture` (h, w, 3) BGR is in the range, else 0: (h, w)."""
        hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
        masks = [cv2.inRange(hsv, low, high) for low, high in self._ranges]
        mask = masks[0] if len(masks) == 1 else cv2.bitwise_or(masks[0], masks[1])
        return np.asarray(mask, dtype=np.uint8)

    def purity(self, picture: Image) -> FloatArray:
        """How much of the light of each pixel of `picture` (h, w, 3) BGR is of the colour: (h, w).

        0 for grey. Light and shade on a strip leave it as it is, and a pixel that the strip fills
        in part has less.
        """
        return np.asarray(self.amount(picture) / np.maximum(picture.max(axis=2), _DARK))

    def amount(self, picture: Image) -> FloatArray:
        """How much of the colour each pixel of `picture` (h, w, 3) BGR has, of 255: (h, w).

        It is proportional to light, and to how much of the pixel the strip fills, on any grey.
        """
        return np.asarray(np.maximum(picture @ self._direction, 0.0))
