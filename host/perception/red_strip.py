"""Strips of one colour in a reduced picture (Perera 2021 ch. 5.4, eq. 33–37).

What has the strip's colour is outlined; parts of one strip are put together; what cannot be a strip
at its height, at any distance in reach, is dropped with a reason. The bearing is the mean over the
blob's pixels, each weighted by its colour and by how much of the world it covers.

Eq. 33 gives the azimuth with the ray's coordinates exchanged: it is atan2(y, x) in the robot frame.
"""

import math
from collections import Counter

import cv2
import numpy as np

from host.config import Cameras
from host.messages import FloatArray, Image
from host.perception.blob import Blob
from host.perception.jpeg_decoder import SCALE
from host.perception.strip_colour import StripColour
from host.perception.strip_geometry import REACH_M, StripGeometry, full_size
from host.perception.strip_patches import Patch, merged, patch_of

_NEAREST, _FARTHEST = 0.7, 1.3  # times the bounds of reach: what a size may say of the distance
_TOO_WIDE, _TOO_TALL = 1.7, 3.0  # times the strip's own proportions; a strip may be hidden in part
_EDGE = 0.15  # of a strip's full colour: less is taken for the background
_PIXEL_STD = 0.1  # std of a blob's middle in reduced pixels
_MOST_BLOBS = 200  # a picture that has more is of another colour than it should be


class OneColourSearch:
    """Finds strips of one colour in one camera's reduced pictures.

    counts: where pictures with too many blobs are counted.
    """

    def __init__(self, cameras: Cameras, geometry: StripGeometry, counts: Counter[str]) -> None:
        self._cameras, self.geometry, self._counts = cameras, geometry, counts
        self._colour = StripColour(cameras.strip)

    def blobs_in(self, picture: Image) -> list[Blob]:
        """Everything in the strip's colour, left to right. picture (rows, columns, 3) BGR."""
        return [self._judge(patch, picture) for patch in self._patches(self.mask(picture))]

    def mask(self, picture: Image) -> Image:
        """255 where a reduced picture (h, w, 3) has the strip's colour, in the lens: (h, w)."""
        drawn = cv2.bitwise_and(self._colour.mask(picture), self.geometry.drawn)
        return np.asarray(drawn, dtype=np.uint8)

    def _patches(self, mask: Image) -> list[Patch]:
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        if len(contours) > _MOST_BLOBS:
            self._counts["pictures_overfull"] += 1
            contours = sorted(contours, key=len, reverse=True)[:_MOST_BLOBS]
        patches = [patch_of(np.asarray(contour, np.int32), self.geometry) for contour in contours]
        return merged(patches, self._proportion)

    @property
    def _proportion(self) -> float:
        return self._cameras.strip.diameter_m / self._cameras.strip.tall_m

    def _judge(self, patch: Patch, picture: Image) -> Blob:
        """Measure one blob, and say whether it can be a teammate's strip."""
        box = patch.box()
        drawn = self.geometry.drawn[box]
        own = patch.inside(drawn.shape) & (drawn > 0)
        purity = np.where(own, self._colour.purity(picture[box]), 0.0)
        share = purity / max(float(purity.max()), 1e-3)
        share[share < _EDGE] = 0.0
        solid = self.geometry.solid_angle[box] * share
        total = float(solid.sum())
        if total == 0.0:
            return _colourless(patch)
        azimuth = float((solid * self.geometry.azimuth[box]).sum()) / total
        elevation = float((solid * self.geometry.elevation[box]).sum()) / total
        pixels = float(share.sum())
        strip = self._cameras.strip
        distance = math.sqrt(strip.diameter_m * strip.tall_m / total)
        reason = self._reason(patch, azimuth, elevation, distance)
        pixel_rad = math.sqrt(total / pixels)
        # Hidden in part, or with another strip behind it: the middle may be that much aside.
        misfit = max(
            0.0, abs(self._proportion * patch.tall - patch.wide) - self._proportion * pixel_rad
        )
        return Blob(
            x=_middle(share.sum(axis=0), box[1].start, pixels),
            y=_middle(share.sum(axis=1), box[0].start, pixels),
            width=float(SCALE * (patch.right - patch.left)),
            height=float(SCALE * (patch.bottom - patch.top)),
            area_px=SCALE * SCALE * pixels,
            kept=not reason,
            reason=reason,
            bearing_rad=self.geometry.bearing(azimuth),
            variance_rad2=(_PIXEL_STD * pixel_rad) ** 2 + misfit**2 / 12.0,
            range_m=distance,
            range_std_m=distance * math.hypot(0.1, 0.7 / math.sqrt(pixels)),
        )

    def _reason(self, patch: Patch, azimuth: float, elevation: float, distance: float) -> str:
        """Why a blob cannot be a strip; nothing where it can."""
        geometry = self.geometry
        pixel = 2.0 * math.sqrt(geometry.solid_angle[patch.top, patch.left])
        reasons = {
            "above_band": elevation > geometry.highest,
            "own_body": geometry.on_own_body(azimuth, elevation),
            "below_band": elevation < geometry.lowest,
            "too_large": distance < _NEAREST * REACH_M,
            "too_small": distance > _FARTHEST * self._cameras.max_range_m,
            "too_wide": patch.wide > _TOO_WIDE * self._proportion * patch.tall + pixel,
            "too_tall": patch.tall > _TOO_TALL / self._proportion * patch.wide + pixel,
        }
        return next((reason for reason, applies in reasons.items() if applies), "")


def _colourless(patch: Patch) -> Blob:
    """A blob of grey pixels, which a range down to no saturation lets in."""
    width, height = SCALE * (patch.right - patch.left), SCALE * (patch.bottom - patch.top)
    x, y = SCALE * patch.left + 0.5 * (width - 1), SCALE * patch.top + 0.5 * (height - 1)
    return Blob(x, y, float(width), float(height), 0.0, False, "colourless")


def _middle(sums: FloatArray, first: int, total: float) -> float:
    """The weighted middle (full-size px) of rows or columns from `first` on."""
    return float(full_size(first + (sums * np.arange(len(sums))).sum() / total))
