"""A reduced picture's colours along one axis, from green to magenta, by azimuth and elevation.

Light that is warm or cold moves a colour along blue–orange, hardly along this axis, on which wood,
brick and lamps are near the middle too.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from host.messages import BoolArray, Image
from host.perception.strip_geometry import StripGeometry

Single = NDArray[np.float32]

FULL = 200  # what green or magenta is counted as that has as much of it as of grey
_DARK = 24  # of 255: in what is darker, noise passes for colour
_SHRINK = 0.25  # of a colour's |R − B|: red, which is half magenta, counts less by it
_WEAK = 0.25  # what has less green or magenta may be grey under coloured light
_MOST_CAST = 0.12  # a room that is all of one colour is no coloured light
_SPARSE = 8  # of so many pixels a side, one is asked for the light's colour


def green_and_magenta(picture: Image) -> tuple[Image, Image]:
    """How green and how magenta the pixels of a picture (h, w, 3) BGR are: (h, w) each, by FULL.

    The opponent colour o = (G − (R + B) / 2) / mean, less the cast of the light on grey, drawn
    towards 0 by a share of |R − B| / mean: its positive part is green, its negative one magenta.
    In bytes, whose differences end at 0.
    """
    blue, green, red = cv2.split(picture)
    between = cv2.addWeighted(blue, 0.5, red, 0.5, 0.0)
    mean = np.maximum(cv2.addWeighted(green, 1.0 / 3.0, between, 2.0 / 3.0, 0.0), _DARK)
    grey = cv2.addWeighted(between, 1.0, mean, _cast(picture), 0.0)
    shrink = cv2.convertScaleAbs(cv2.absdiff(red, blue), alpha=_SHRINK)
    greener, redder = (
        cv2.subtract(cv2.subtract(more, less), shrink)
        for more, less in ((green, grey), (grey, green))
    )
    return _bytes(cv2.divide(greener, mean, scale=FULL)), _bytes(
        cv2.divide(redder, mean, scale=FULL)
    )


def _bytes(plane: object) -> Image:
    """As OpenCV has it, with the type that it does not declare."""
    return np.asarray(plane, dtype=np.uint8)


def _cast(picture: Image) -> float:
    """The opponent colour of grey things: its median over weak colours, within bounds."""
    blue, green, red = np.moveaxis(picture[::_SPARSE, ::_SPARSE].astype(np.float32), -1, 0)
    between = 0.5 * (blue + red)
    opponent = (green - between) / np.maximum((green + 2.0 * between) / 3.0, _DARK)
    weak = opponent[np.abs(opponent) < _WEAK]
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
    middles, elevation from the highest down. x, y (h, w): the pixel of each cell, 0 where `shown`
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
        self.x, self.y = (np.rint(np.where(shown, v, 0.0)).astype(np.intp) for v in (x, y))
        self._cells = (self.y * columns + self.x).ravel()
        self._hidden = ~shown

    def of(self, values: Image) -> Image:
        """`values` (rows, columns) of the reduced picture in this grid; 0 where it has none."""
        grid: Image = np.take(values.ravel(), self._cells, mode="clip").reshape(self.shown.shape)
        grid[self._hidden] = 0
        return grid

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
