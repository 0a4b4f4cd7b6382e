"""The colour of the strips that the cameras find, against the one in robot.toml.

Of strips of one colour alone: two colours are told by their difference, and none is calibrated.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from host.calibration.camera.colour import learn, pixels_in_box
from host.config import Camera, Cameras
from host.doctor.findings import Finding, Level
from host.errors import UserError
from host.geometry import wrap
from host.messages import Bearings, FloatArray, Image
from host.perception.jpeg_decoder import UnusableError, decode
from host.sources.cameras import StripCamera

_EVERY_S, _MOST = 0.5, 16  # pictures that are kept of a camera
_HALF_BOX_PX = 12  # around a strip's middle; a strip 2 m away is about that wide
_OFF = 0.25  # of the range's width, from its middle: half way to where strips are lost

Kept = list[tuple[float, bytes, FloatArray]]  # s, a JPEG, where strips are in it (n, 2) px


class StripPictures:
    """Keeps pictures with strips in them while the cameras work; `findings` judges them."""

    def __init__(self, cameras: Sequence[StripCamera]) -> None:
        self._kept: dict[str, Kept] = defaultdict(list)
        for camera in cameras:
            camera.watchers.append(self.keep)

    def keep(self, jpeg: bytes, seen: Bearings) -> None:
        """Note a picture and what was found in it, in its camera's thread."""
        kept = self._kept[seen.camera]
        due = not kept or seen.time >= kept[-1][0] + _EVERY_S
        if due and len(kept) < _MOST and seen.pixels is not None and len(seen.pixels):
            kept.append((seen.time, jpeg, seen.pixels))

    def findings(self, cameras: Cameras) -> list[Finding]:
        """One for each camera that saw strips whose colour is near the end of the range."""
        found = [
            _judged(name, getattr(cameras, name), cameras, kept)
            for name, kept in sorted(self._kept.items())
        ]
        return [finding for finding in found if finding is not None]


def _judged(name: str, camera: Camera, cameras: Cameras, kept: Kept) -> Finding | None:
    strip = cameras.strip
    pixels = _strips_pixels(camera, kept)
    if strip.pattern != "one_colour" or not len(pixels):
        return None
    try:
        hue = learn(pixels, strip).hue_deg
    except UserError:
        return None  # too few of them have a colour
    off = abs(float(np.degrees(wrap(np.radians(hue - strip.hue_deg)))))
    what = (
        f"the strips' hue is {hue:.0f} deg, {off:.0f} deg off the middle of robot.toml's "
        f"{strip.hue_deg:.0f} +- {0.5 * strip.hue_width_deg:.0f} deg"
    )
    if off <= _OFF * strip.hue_width_deg:
        return Finding(f"{name} camera", Level.OK, what)
    return Finding(
        f"{name} camera",
        Level.WARN,
        what,
        "swarmloc calibrate colour with pictures in this light; hold the camera's white balance",
    )


def _strips_pixels(camera: Camera, kept: Kept) -> Image:
    """Pixels (n, 3) BGR about the middles of all strips found."""
    found: list[Image] = [np.zeros((0, 3), np.uint8)]
    for _, jpeg, places in kept:
        try:
            picture = decode(jpeg, (camera.width_px, camera.height_px), camera.height_px)
        except UnusableError:
            continue
        for x, y in places:
            corner = round(float(x)) - _HALF_BOX_PX, round(float(y)) - _HALF_BOX_PX
            box = (max(corner[0], 0), max(corner[1], 0), 2 * _HALF_BOX_PX, 2 * _HALF_BOX_PX)
            found.append(pixels_in_box(picture, box))
    return np.concatenate(found)
