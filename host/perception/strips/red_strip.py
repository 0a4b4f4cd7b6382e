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
from host.messages import BoolArray, FloatArray, Image
from host.perception.jpeg_decoder import SCALE
from host.perception.strips.blob import Blob, bearing_variance, distance_m, distance_std_m
from host.perception.strips.colour import StripColour
from host.perception.strips.geometry import REACH_M, StripGeometry
from host.perception.strips.patches import Patch, merged, patch_of

_NEAREST, _FARTHEST = 0.7, 1.3  # times the bounds of reach: what a size may say of the distance
_TOO_WIDE, _TOO_TALL = 1.7, 3.0  # times the strip's own proportions; a strip may be hidden in part
# Reduced pixels of a blob, by how much of its colour each has; and those within the range. Fewer
# are specks, which rooms are full of.
_LEAST_PIXELS, _LEAST_MASK = 4.0, 2
_MOST_AROUND = 0.8  # of a blob's own colour: what is around it has no more, or it is part of that
_EDGE = 0.15  # of a strip's full colour: less is taken for the background
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
        if outside := self._outside(patch):
            return _unmeasured(patch, outside)
        box = patch.box()
        drawn = self.geometry.drawn[box] > 0
        inside, own, around = patch.inside_and_around(drawn.shape)
        if np.count_nonzero(inside) < _LEAST_MASK:
            return _unmeasured(patch, "too_few_pixels")
        purity = self._colour.purity(picture[box])
        share = _share(purity, own & drawn)
        solid = self.geometry.solid_angle[box] * share
        total, pixels = float(solid.sum()), float(share.sum())
        if total == 0.0:
            return _unmeasured(patch, "colourless")
        azimuth = float((solid * self.geometry.azimuth[box]).sum()) / total
        # Light on a strip differs from side to side, not from top to bottom. There what is darker
        # than the strip, the turret below it, would pass for the strip by purity.
        upright = self.geometry.solid_angle[box] * _share(
            self._colour.amount(picture[box]), own & drawn
        )
        elevation = float((upright * self.geometry.elevation[box]).sum() / upright.sum())
        distance = distance_m(self._cameras.strip, total)
        reason = self._reason(patch, azimuth, elevation, distance)
        if not reason and pixels < _LEAST_PIXELS:
            reason = "too_few_pixels"
        if not reason and not _stands_out(purity, own & drawn, around & drawn):
            reason = "like_background"
        x, y = self.geometry.pixel(azimuth, elevation)
        return Blob(
            x=x,
            y=y,
            width=float(SCALE * (patch.right - patch.left)),
            height=float(SCALE * (patch.bottom - patch.top)),
            area_px=SCALE * SCALE * pixels,
            kept=not reason,
            reason=reason,
            bearing_rad=self.geometry.bearing(azimuth),
            variance_rad2=self._variance(patch, math.sqrt(total / pixels)),
            range_m=distance,
            range_std_m=distance_std_m(distance, pixels),
        )

    def _variance(self, patch: Patch, pixel_rad: float) -> float:
        """Of a blob's bearing, rad²; pixel_rad: of a reduced pixel there."""
        # Hidden in part, or with another strip behind it: the middle may be that much aside.
        misfit = max(
            0.0, abs(self._proportion * patch.tall - patch.wide) - self._proportion * pixel_rad
        )
        return bearing_variance(pixel_rad, misfit)

    def _outside(self, patch: Patch) -> str:
        """Why no part of a patch can be of a strip, by where it is; nothing where one can."""
        if patch.elevations[0] > self.geometry.highest:
            return "above_band"
        if patch.elevations[1] >= self.geometry.lowest:
            return ""
        middle = (0.5 * sum(patch.azimuths), 0.5 * sum(patch.elevations))
        return "own_body" if self.geometry.on_own_body(*middle) else "below_band"

    def _reason(self, patch: Patch, azimuth: float, elevation: float, distance: float) -> str:
        """Why a blob cannot be a strip; nothing where it can."""
        geometry = self.geometry
        pixel = 2.0 * math.sqrt(geometry.solid_angle[patch.top, patch.left])
        # A strip hidden in part seems farther away by its area, but not by its height.
        nearest = min(distance, self._cameras.strip.tall_m / patch.tall)
        low, high = geometry.elevations_at(_NEAREST * nearest, _FARTHEST * distance)
        reasons = {
            "too_wide": patch.wide > _TOO_WIDE * self._proportion * patch.tall + pixel,
            "too_tall": patch.tall > _TOO_TALL / self._proportion * patch.wide + pixel,
            "above_band": elevation > geometry.highest,
            "own_body": geometry.on_own_body(azimuth, elevation),
            "below_band": elevation < geometry.lowest,
            "too_large": distance < _NEAREST * REACH_M,
            "too_small": distance > _FARTHEST * self._cameras.max_range_m,
            "wrong_height": not low <= elevation <= high,
        }
        return next((reason for reason, applies in reasons.items() if applies), "")


def _stands_out(purity: FloatArray, own: BoolArray, around: BoolArray) -> bool:
    """Whether what is around a blob has clearly less of the colour than the blob itself."""
    if not own.any() or not around.any():
        return True
    return bool(purity[around].mean() <= _MOST_AROUND * purity[own].mean())


def _unmeasured(patch: Patch, reason: str) -> Blob:
    """A blob that is dropped without a look at its pixels."""
    width, height = SCALE * (patch.right - patch.left), SCALE * (patch.bottom - patch.top)
    x, y = SCALE * patch.left + 0.5 * (width - 1), SCALE * patch.top + 0.5 * (height - 1)
    return Blob(x, y, float(width), float(height), 0.0, False, reason)


def _share(colour: FloatArray, own: BoolArray) -> FloatArray:
    """How much of each pixel the strip fills, 0 to 1, by how much of its `colour` the pixels have.

    0 in those that are not its `own`.
    """
    share = np.where(own, colour, 0.0)
    share /= max(float(share.max()), 1e-3)
    share[share < _EDGE] = 0.0
    return np.asarray(share)
