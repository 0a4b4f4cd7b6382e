"""A reduced picture's colours along one axis, from green to magenta, by azimuth and elevation.

Light that is warm or cold moves a colour along blue–orange, hardly along this axis, on which wood,
brick and lamps are near the middle too.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from host.messages import BoolArray, Image
from host.perception.strips.geometry import StripGeometry

Single = NDArray[np.float32]

FULL = 200  # what green or magenta is counted as that has as much of it as of grey
MOST = 255.0  # more of a colour counts as so much
_DARK = 24  # of 255: in what is darker, noise passes for colour
_SHRINK = 0.25  # of a colour's |R − B|: red, which is half magenta, counts less by it
_WEAK = 0.25  # what has less green or magenta may be grey under coloured light
_MOST_CAST = 0.12  # a room that is all of one colour is no coloured light
_SPARSE = 8  # of so many pixels a side, one is asked for the light's colour


def opponent(picture: Image, cast: float) -> Single:
    """How green (above 0) or magenta (below) the pixels of a picture (h, w, 3) BGR are, by FULL.

    The opponent colour o = (G − (R + B) / 2) / mean, less the `cast` of the light on grey, drawn
    towards 0 by a share of |R − B| / mean: (h, w), within ±MOST. Differences of bytes end at 0.
    """
    return by_light(*colour_and_light(picture, cast))


def by_light(colour: Single, light: Image) -> Single:
    """The quotient (h, w) of both, by FULL and within ±MOST."""
    quotient = cv2.divide(colour, light, scale=FULL, dtype=cv2.CV_32F)
    return np.asarray(np.clip(quotient, -MOST, MOST), dtype=np.float32)


def colour_and_light(picture: Image, cast: float) -> tuple[Single, Image]:
    """Dividend and divisor (h, w) of the opponent colour, both in levels of 255."""
    blue, green, red = cv2.split(picture)
    between = cv2.addWeighted(blue, 0.5, red, 0.5, 0.0)
    mean = np.maximum(cv2.addWeighted(green, 1.0 / 3.0, between, 2.0 / 3.0, 0.0), _DARK)
    grey = cv2.addWeighted(between, 1.0, mean, cast, 0.0)
    shrink = cv2.convertScaleAbs(cv2.absdiff(red, blue), alpha=_SHRINK)
    greener, redder = (
        cv2.subtract(cv2.subtract(more, less), shrink)
        for more, less in ((green, grey), (grey, green))
    )
    both = cv2.subtract(greener, redder, dtype=cv2.CV_32F)
    return np.asarray(both, dtype=np.float32), np.asarray(mean, dtype=np.uint8)


def cast_of(picture: Image) -> float:
    """The opponent colour of grey things in a picture: its median over weak colours, bounded."""
    blue, green, red = np.moveaxis(picture[::_SPARSE, ::_SPARSE].astype(np.float32), -1, 0)
    between = 0.5 * (blue + red)
    by_mean = (green - between) / np.maximum((green + 2.0 * between) / 3.0, _DARK)
    weak = by_mean[np.abs(by_mean) < _WEAK]
    cast = float(np.median(weak)) if len(weak) else 0.0
    return min(max(cast, -_MOST_CAST), _MOST_CAST)


@dataclass(frozen=True, slots=True)
class Extent:
    """Azimuths (from the camera's heading) and elevations, each (least, greatest), rad."""

    azimuths: tuple[float, float]
    elevations: tuple[float, float]


class Panorama:
    """A grid of equal angles over a reduced picture: nearest pixels, looked up once.

    step_rad between rows and between columns. azimuth (w,) and elevation (h,) rad of their
    middles, elevation from the highest down. x, y (h, w): the pixel of each cell, -1 where `shown`
    is False.
    """

    def __init__(self, geometry: StripGeometry, extent: Extent, step_rad: float) -> None:
        self.step_rad = step_rad
        self.azimuth = np.arange(*extent.azimuths, step_rad)
        self.elevation = np.arange(*extent.elevations[::-1], -step_rad)
        x, y = geometry.reduced_pixels(*np.meshgrid(self.azimuth, self.elevation))
        rows, columns = geometry.drawn.shape
        with np.errstate(invalid="ignore"):  # nan is outside
            shown = (x > -0.5) & (x < columns - 0.5) & (y > -0.5) & (y < rows - 0.5)
        self.shown: BoolArray = shown
        self.x, self.y = (np.rint(np.where(shown, v, -1.0)).astype(np.int16) for v in (x, y))
        self._cells = np.stack((self.x, self.y), axis=-1)

    def of(self, picture: Image) -> Image:
        """A reduced picture (rows, columns, 3) in this grid; black where it shows nothing."""
        # Without coefficients of interpolation OpenCV takes whole pixels.
        grid = cv2.remap(
            picture, self._cells, np.array([]), cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT
        )
        return np.asarray(grid, dtype=np.uint8)

    def row_of(self, elevation: float) -> float:
        """The row's edge, counted from the grid's upper one, at an elevation (rad)."""
        return (float(self.elevation[0]) - elevation) / self.step_rad + 0.5

    def pixels_of(self, rows: slice, columns: slice) -> tuple[slice, slice] | None:
        """Rows and columns of the reduced picture that hold a part of the grid; None: not shown."""
        shown = self.shown[rows, columns]
        if not shown.any():
            return None
        x, y = self.x[rows, columns][shown], self.y[rows, columns][shown]
        return slice(int(y.min()), int(y.max()) + 1), slice(int(x.min()), int(x.max()) + 1)
