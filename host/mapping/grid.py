"""An occupancy grid: what beams of a lidar passed through, and what they met.

Log odds of each cell, every beam on its own (Moravec & Elfes 1985; Thrun, Probabilistic Robotics,
table 9.1).
"""

import numpy as np

from host.messages import BoolArray, FloatArray, Image, IntArray

_HIT, _PASSED = 0.85, -0.4  # log odds of a beam that ends in a cell, and of one that passes it
_MOST = 5.0  # so that what has moved is forgotten
FREE, UNKNOWN, OCCUPIED = 255, 160, 0  # shades in the picture


class OccupancyGrid:
    """Square cells around the origin of a frame. cell_m: their side. side_m: of the whole."""

    def __init__(self, cell_m: float = 0.05, side_m: float = 30.0) -> None:
        self.cell_m = cell_m
        self._half = round(0.5 * side_m / cell_m)
        self._odds = np.zeros((2 * self._half, 2 * self._half))
        self._seen: BoolArray = np.zeros(self._odds.shape, dtype=bool)

    def add(self, starts: FloatArray, ends: FloatArray, met: BoolArray) -> None:
        """Beams from `starts` (n, 2) to `ends` (n, 2), m. met (n,): whether something was there.

        In one scan a cell that anything was met in was passed by no beam, and counts once.
        """
        hit = self._cells(ends[met])
        passed = np.setdiff1d(self._cells(_along(starts, ends, self.cell_m)), hit)
        for cells, odds in ((np.unique(hit), _HIT), (passed, _PASSED)):
            self._odds.flat[cells] = np.clip(self._odds.flat[cells] + odds, -_MOST, _MOST)
            self._seen.flat[cells] = True

    @property
    def occupied(self) -> FloatArray:
        """Middles (k, 2) m of the cells that are taken for occupied."""
        return self._middles(self._seen & (self._odds > 0.0))

    @property
    def free(self) -> FloatArray:
        """Middles (k, 2) m of the cells that are taken for free."""
        return self._middles(self._seen & (self._odds <= 0.0))

    def picture(self) -> Image:
        """What was seen of the grid, y upwards: white is free, black is occupied, grey unknown."""
        shades = np.full(self._odds.shape, UNKNOWN, dtype=np.uint8)
        shades[self._seen] = np.where(self._odds[self._seen] > 0.0, OCCUPIED, FREE)
        rows, columns = np.nonzero(self._seen)
        if not len(rows):
            return np.full((1, 1), UNKNOWN, dtype=np.uint8)
        cut = shades[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        return np.ascontiguousarray(cut.T[::-1])

    def _cells(self, points: FloatArray) -> IntArray:
        """Flat numbers of the cells of points (n, 2); what is outside of the grid is left out."""
        cells = np.floor(points / self.cell_m).astype(np.int64) + self._half
        inside = np.all((cells >= 0) & (cells < 2 * self._half), axis=1)
        return np.asarray(cells[inside, 0] * 2 * self._half + cells[inside, 1])

    def _middles(self, which: BoolArray) -> FloatArray:
        return np.asarray((np.argwhere(which) - self._half + 0.5) * self.cell_m, dtype=np.float64)


def _along(starts: FloatArray, ends: FloatArray, step_m: float) -> FloatArray:
    """Points (k, 2) every half step along the beams, up to half a step before their ends."""
    lengths = np.hypot(*(ends - starts).T)
    counts = np.maximum(np.floor(2.0 * lengths / step_m).astype(np.int64) - 1, 0)
    beam = np.repeat(np.arange(len(starts)), counts)
    number = np.arange(len(beam)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (0.5 * step_m * number / np.maximum(lengths[beam], 1e-9))[:, None]
    points: FloatArray = starts[beam] + share * (ends - starts)[beam]
    return points
