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

_DARK = 24.0  # of 255: in what is darker, noise passes for colour
_GREEN = np.array([[-0.5, 1.0, -0.5]], dtype=np.float32)  # of blue, green, red
_ORANGE = np.array([[-1.0, 0.0, 1.0]], dtype=np.float32)
_MEAN = np.full((1, 3), 1.0 / 3.0, dtype=np.float32)
_SHRINK = 0.25  # of a colour's blue or orange: red, which is half magenta, counts less by it
_WEAK = 0.25  # of the opponent colour: what has less of it may be grey under coloured light
_MOST_CAST = 0.12  # a room that is all of one colour is no coloured light
_SPARSE = 8  # of so many pixels a side, one is asked for the light's colour


class OpponentColour:
    """The opponent colour of pictures of one size. For one thread.

    o = (G − (R + B) / 2) / mean, less the cast of the light on grey, drawn towards 0 by a share of
    |R − B| / mean.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        # Written again for each picture: fresh memory costs more than the arithmetic.
        self._bgr = np.empty((*shape, 3), dtype=np.float32)
        self._green, self._orange, self._mean, self._rest = np.empty((4, *shape), dtype=np.float32)

    def of(self, picture: Image) -> Single:
        """Opponent colour (h, w) of a picture (h, w, 3) BGR; valid until the next picture.

        The cast is the median over what has little colour, within bounds.
        """
        np.copyto(self._bgr, picture)
        cv2.transform(self._bgr, _GREEN, dst=self._green)
        cv2.transform(self._bgr, _ORANGE, dst=self._orange)
        cv2.transform(self._bgr, _MEAN, dst=self._mean)
        np.maximum(self._mean, _DARK, out=self._mean)
        cv2.divide(self._green, self._mean, dst=self._green)
        cv2.divide(self._orange, self._mean, dst=self._orange)
        self._green -= self._cast()
        np.abs(self._orange, out=self._orange)
        self._orange *= _SHRINK
        np.minimum(self._green, self._orange, out=self._rest)
        np.negative(self._orange, out=self._orange)
        np.maximum(self._rest, self._orange, out=self._rest)
        self._green -= self._rest
        return self._green

    def _cast(self) -> np.float32:
        some = self._green[::_SPARSE, ::_SPARSE]
        grey = some[np.abs(some) < _WEAK]
        cast = float(np.median(grey)) if len(grey) else 0.0
        return np.float32(min(max(cast, -_MOST_CAST), _MOST_CAST))


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
        self._cells = self.y * columns + self.x
        self._light = shown.astype(np.float32)
        self._grid = np.empty(shown.shape, dtype=np.float32)

    def of(self, values: Single, most: float) -> Single:
        """`values` (rows, columns) of the reduced picture in this grid (h, w), within ±most.

        0 where the picture shows nothing. The array is valid until the next call.
        """
        np.take(values.ravel(), self._cells, out=self._grid, mode="clip")
        np.clip(self._grid, -most, most, out=self._grid)
        self._grid *= self._light
        return self._grid

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
