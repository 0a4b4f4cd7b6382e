"""JPEG → blobs that look like strips → bearings of teammates.

The picture is reduced to a quarter as it is decoded, and only as far down as strips can be. What
is looked for in it is the pattern that `[camera.strip]` names.
"""

from collections import Counter
from typing import Protocol

import numpy as np

from host.config import Camera, Cameras
from host.messages import Bearings, Image
from host.perception.jpeg_decoder import UnusableError, decode
from host.perception.lens import Lens
from host.perception.strips.blob import Blob
from host.perception.strips.geometry import StripGeometry
from host.perception.strips.red_strip import OneColourSearch
from host.perception.strips.two_colour_strip import TwoColourSearch

_SPARSE = 8  # of so many pixels a side, one is asked whether it has colour
_COLOURLESS = 4  # levels of 255 between the channels: no camera that sees colour stays below


class PatternSearch(Protocol):
    """Finds the strips of one pattern in reduced pictures."""

    def blobs_in(self, picture: Image) -> list[Blob]:
        """Everything that looks like a strip, left to right. picture (rows, columns, 3) BGR."""


def pattern_search(
    cameras: Cameras, camera: Camera, geometry: StripGeometry, counts: Counter[str]
) -> PatternSearch:
    """The search for the configured pattern."""
    if cameras.strip.pattern == "one_colour":
        return OneColourSearch(cameras, geometry, counts)
    return TwoColourSearch(cameras, camera, geometry)


class StripFinder:
    """Finds teammates' strips in one camera's pictures. For one thread.

    counts: pictures searched, those not used, those without any colour and blobs dropped, each by
    its reason, and strips found. name: of the camera, as its Bearings name it.
    """

    def __init__(self, cameras: Cameras, camera: Camera, name: str = "") -> None:
        self._cameras, self._camera, self._name = cameras, camera, name
        self._size = (camera.width_px, camera.height_px)
        self.geometry = StripGeometry(cameras, camera)
        self._lens = Lens(camera)
        self.counts = Counter({"pictures": 0, "strips": 0})
        self._pattern = pattern_search(cameras, camera, self.geometry, self.counts)

    def find(self, jpeg: bytes, time: float) -> Bearings | None:
        """Bearings of the teammates in a picture taken at `time`; None where it is not whole."""
        try:
            blobs = [blob for blob in self.search(jpeg) if blob.kept]
        except UnusableError:
            return None
        pixels = np.array([(blob.x, blob.y) for blob in blobs], dtype=float).reshape(-1, 2)
        own = np.array([blob.variance_rad2 for blob in blobs], dtype=float)
        noise = self._cameras.bearing_noise_rad**2 + self._lens.extrapolation_variances(pixels)
        return Bearings(
            time=time,
            bearings=np.array([blob.bearing_rad for blob in blobs], dtype=float),
            variances=noise + own,
            origin=(self._camera.x_m, self._camera.y_m),
            view=self.geometry.view,
            ranges=np.array([blob.range_m for blob in blobs], dtype=float),
            range_variances=np.array([blob.range_std_m**2 for blob in blobs], dtype=float),
            camera=self._name,
            pixels=pixels,
        )

    def blobs(self, jpeg: bytes) -> list[Blob]:
        """Everything that looks like a strip, left to right; none where it is not whole."""
        try:
            return self.search(jpeg)
        except UnusableError:
            return []

    def search(self, jpeg: bytes) -> list[Blob]:
        """As `blobs`; raises UnusableError, once counted, where the picture is not whole."""
        self.counts["pictures"] += 1
        try:
            picture = decode(jpeg, self._size, self.geometry.rows)
        except UnusableError as error:
            self.counts[f"pictures_{error}"] += 1
            raise
        if _is_colourless(picture):
            self.counts["pictures_colourless"] += 1
        blobs = self._pattern.blobs_in(picture)
        self.counts.update("strips" if blob.kept else f"dropped_{blob.reason}" for blob in blobs)
        return blobs


def _is_colourless(picture: Image) -> bool:
    """Whether a picture (h, w, 3) is black and white: no strip can be found in it."""
    sparse = picture[::_SPARSE, ::_SPARSE]
    return bool((sparse.max(axis=2) - sparse.min(axis=2)).max() < _COLOURLESS)
