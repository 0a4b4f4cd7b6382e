"""Teammates that only the cameras see: where a strip may be of one that nothing stands for yet.

While the lidar scans, it places what is new, and the cameras show what it is. Without it a strip
has to do both: its size tells the range, and where sizes are not known the ray is cut into pieces,
of which the robot's own motion leaves the right one (range-parametrised, Peach 1995, "Bearings-only
tracking using a set of range-parametrised extended Kalman filters").
"""

import math
from dataclasses import dataclass

import numpy as np

from host.config import Cameras
from host.estimator.sensor_models import CameraModel
from host.geometry import SECTORS, on_rays, wrap
from host.messages import Bearings, FloatArray, IntArray

_LONGEST_S = 1.0  # teammates that appeared longer ago were seen before or have gone
_PIECES_M = 0.3 * 2.0 ** (0.5 * np.arange(8))
_OPEN = np.full(SECTORS, math.inf)


@dataclass(frozen=True, slots=True)
class Places:
    """Where strips may be: hypotheses (k,) that exclude each other where they share a reading.

    reading (k,): whose. positions (k, 2) m, covariances (k, 2, 2) m², in the robot's frame.
    intensity (k,) in the unit of the camera's clutter: how many such strips are expected in this
    picture, of teammates that were not there in the one before.
    """

    reading: IntArray
    positions: FloatArray
    covariances: FloatArray
    intensity: FloatArray

    def of_readings(self, readings: int) -> FloatArray:
        """The intensity (m,) at each reading."""
        return np.asarray(np.bincount(self.reading, self.intensity, readings), dtype=np.float64)


class StripBirths:
    """Births by strips. appear_per_m2_s: teammates that appear."""

    def __init__(self, camera: Cameras, appear_per_m2_s: float) -> None:
        self._model = CameraModel(camera)
        self._use_ranges, self._reach_m = camera.use_ranges, camera.max_range_m
        self._appear = appear_per_m2_s
        self._pictured: dict[str, float] = {}  # when each camera last took a picture

    def elapsed(self, measured: Bearings) -> float:
        """Time since the same camera's picture before, s; call once a picture, in order of time."""
        taken = measured.time - measured.lag
        before = self._pictured.get(measured.camera, -math.inf)
        self._pictured[measured.camera] = max(taken, before)
        return min(max(taken - before, 0.0), _LONGEST_S)

    def places(self, measured: Bearings, elapsed: float) -> Places:
        """Where the strips (m,) of a picture may be that was taken `elapsed` s after another."""
        ranges, variances, area = self._ranges(measured)
        reading = np.arange(len(ranges)).repeat(ranges.shape[1])
        ranges, bearings = ranges.ravel(), measured.bearings.take(reading)
        across = ranges * ranges * measured.variances.take(reading)
        found = self._model.detection(wrap(bearings), ranges, _OPEN, measured.view)
        intensity = self._appear * elapsed * found * area.ravel()
        places = on_rays(measured.origin, bearings, ranges, across, variances.ravel())
        return Places(reading, *places, intensity)

    def _ranges(self, measured: Bearings) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ranges (m, pieces) m, their variances, and the area of each over the clutter's part.

        Of a size, which false strips have at any range up to the reach alike, that is r times the
        reach, m² a rad; of a piece of the ray, that of its sector.
        """
        ranges, variances = measured.ranges, measured.range_variances
        if self._use_ranges and ranges is not None and variances is not None:
            return ranges[:, None], variances[:, None], self._reach_m * ranges[:, None]
        near, far = _PIECES_M[:-1], _PIECES_M[1:]
        shape = (len(measured.bearings), len(near))
        pieces = (0.5 * (near + far), (far - near) ** 2 / 12.0, 0.5 * (far**2 - near**2))
        middle, variance, area = (np.broadcast_to(piece, shape) for piece in pieces)
        return middle, variance, area
