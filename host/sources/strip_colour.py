"""The colour of the strips that a camera finds, against the one in robot.toml.

Of strips of one colour alone: two colours are told by their difference, and none is calibrated.
"""

from collections import deque

import numpy as np

from host.calibration.camera.colour import learn, pixels_in_box
from host.config import Camera, Strip
from host.errors import UserError
from host.geometry import wrap
from host.messages import Bearings, FloatArray, Image
from host.perception.jpeg_decoder import UnusableError, decode

_EVERY_S, _MOST = 1.0, 16  # between two pictures that are kept; of them
_HALF_BOX_PX = 12  # around a strip's middle; a strip 2 m away is about that wide
_OFF = 0.25  # of the range's width, from its middle: half way to where strips are lost


class StripColour:
    """Checks the pixels of strips that one camera found recently. For one thread."""

    def __init__(self, strip: Strip, camera: Camera) -> None:
        self._strip, self._camera = strip, camera
        self._kept: deque[tuple[float, Image]] = deque(maxlen=_MOST)

    def take(self, jpeg: bytes, seen: Bearings) -> None:
        """Note a picture and what was found in it."""
        due = not self._kept or seen.time >= self._kept[-1][0] + _EVERY_S
        if self._strip.pattern == "one_colour" and due and seen.pixels is not None:
            pixels = self._pixels(jpeg, seen.pixels)
            if len(pixels):
                self._kept.append((seen.time, pixels))

    def remarks(self) -> list[str]:
        """What is wrong with the colour and what to do, where it is near the end of its range."""
        strip = self._strip
        if not self._kept:
            return []
        try:
            hue = learn(np.concatenate([pixels for _, pixels in self._kept]), strip).hue_deg
        except UserError:
            return []  # too few of them have a colour
        off = abs(float(np.degrees(wrap(np.radians(hue - strip.hue_deg)))))
        if off <= _OFF * strip.hue_width_deg:
            return []
        return [
            f"the strips' hue is {hue:.0f} deg, {off:.0f} deg off the middle of robot.toml's "
            f"{strip.hue_deg:.0f} +- {0.5 * strip.hue_width_deg:.0f} deg: swarmloc calibrate "
            "colour with pictures in this light, and hold the camera's white balance"
        ]

    def _pixels(self, jpeg: bytes, places: FloatArray) -> Image:
        """Pixels (n, 3) BGR about the middles of strips: places (n, 2), px."""
        found: list[Image] = [np.zeros((0, 3), np.uint8)]
        if not len(places):
            return found[0]
        camera = self._camera
        try:
            picture = decode(jpeg, (camera.width_px, camera.height_px), camera.height_px)
        except UnusableError:
            return found[0]
        for x, y in places:
            corner = round(float(x)) - _HALF_BOX_PX, round(float(y)) - _HALF_BOX_PX
            box = (max(corner[0], 0), max(corner[1], 0), 2 * _HALF_BOX_PX, 2 * _HALF_BOX_PX)
            found.append(pixels_in_box(picture, box))
        return np.concatenate(found)
