"""Outlines in a reduced picture → patches in azimuth and elevation; parts of one strip together."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from host.messages import BoolArray, Image
from host.perception.strips.geometry import StripGeometry

_EDGE = np.ones((3, 3), np.uint8)  # pixels at the edge of a patch are filled in part
_RING = np.ones((5, 5), np.uint8)
_MARGIN = 3  # px around a patch: both
_MERGED_WIDE = 1.3  # times as wide as a strip so tall
_SAME_HEIGHT = 0.7  # of the taller of two parts of one strip: so much of it is beside the other
Outline = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Patch:
    """Part of a blob, or all of it.

    left to bottom: its box in the reduced picture, without right and bottom themselves. azimuths,
    elevations (rad): from where to where it reaches. outlines: (n, 1, 2) px each.
    """

    left: int
    top: int
    right: int
    bottom: int
    azimuths: tuple[float, float]
    elevations: tuple[float, float]
    outlines: tuple[Outline, ...]

    def with_other(self, other: "Patch") -> "Patch":
        """Both as one."""
        return Patch(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
            _hull(self.azimuths, other.azimuths),
            _hull(self.elevations, other.elevations),
            self.outlines + other.outlines,
        )

    @property
    def wide(self) -> float:
        return self.azimuths[1] - self.azimuths[0]

    @property
    def tall(self) -> float:
        return self.elevations[1] - self.elevations[0]

    def box(self) -> tuple[slice, slice]:
        """Rows and columns of the box with its margin, which may reach over the picture's end."""
        top, left = max(self.top - _MARGIN, 0), max(self.left - _MARGIN, 0)
        return slice(top, self.bottom + _MARGIN), slice(left, self.right + _MARGIN)

    def inside_and_around(self, shape: tuple[int, ...]) -> tuple[BoolArray, BoolArray, BoolArray]:
        """Which pixels of the box (of that shape) are the patch's; those and its edge; the next."""
        rows, columns = self.box()
        filled: Image = np.zeros(shape, np.uint8)
        offset = (-columns.start, -rows.start)
        cv2.drawContours(filled, list(self.outlines), -1, 1, cv2.FILLED, offset=offset)
        own = cv2.dilate(filled, _EDGE)
        around = np.asarray(cv2.dilate(own, _RING) > own)
        return filled > 0, np.asarray(own > 0), around


def patch_of(outline: Outline, geometry: StripGeometry) -> Patch:
    """The patch within an outline (n, 1, 2) px of the reduced picture."""
    x, y = outline[:, 0, 0], outline[:, 0, 1]
    azimuth, elevation = geometry.azimuth[y, x], geometry.elevation[y, x]
    # Outlines pass through the middles of the outermost pixels.
    half = 0.5 * math.sqrt(geometry.solid_angle[y[0], x[0]])
    return Patch(
        int(x.min()),
        int(y.min()),
        int(x.max()) + 1,
        int(y.max()) + 1,
        (float(azimuth.min()) - half, float(azimuth.max()) + half),
        (float(elevation.min()) - half, float(elevation.max()) + half),
        (outline,),
    )


def merged(patches: list[Patch], proportion: float) -> list[Patch]:
    """Patches, those that are parts of one strip as one. proportion: a strip's width by height."""
    whole: list[Patch] = []
    for patch in sorted(patches, key=lambda patch: patch.left):
        for k in range(len(whole)):
            if _one_strip(whole[k], patch, proportion):
                whole[k] = whole[k].with_other(patch)
                break
        else:
            whole.append(patch)
    return whole


def _one_strip(a: Patch, b: Patch, proportion: float) -> bool:
    """Whether two patches may be what is seen of one strip beside something thin before it.

    Both parts then have the strip's height, and together at most its width. Something taller is
    another thing, and so is a strip at another distance.
    """
    beside = min(a.elevations[1], b.elevations[1]) - max(a.elevations[0], b.elevations[0])
    if beside < _SAME_HEIGHT * max(a.tall, b.tall):
        return False
    both = a.with_other(b)
    return both.wide <= _MERGED_WIDE * proportion * both.tall


def _hull(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    return min(a[0], b[0]), max(a[1], b[1])
