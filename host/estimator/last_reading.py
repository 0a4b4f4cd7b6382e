"""No filter at all: each reading is a teammate for some seconds. The floor others stand beside."""

import numpy as np

from host.geometry import into_new_frame
from host.message_checks import check
from host.messages import Bearings, BoolArray, Displacement, Estimate, Positions


class LastReading:
    """Keeps every position reading for keep_s, carried by odometry.

    merge_m: a reading drops the older ones this close to it. process_noise: m²/s per axis by which
    a reading's covariance grows. Bearings alone show no position and are left out.
    """

    def __init__(
        self, keep_s: float = 5.0, merge_m: float = 0.5, process_noise: float = 0.005
    ) -> None:
        self._keep_s = keep_s
        self._merge_m = merge_m
        self._process_noise = process_noise
        self._time = 0.0
        self._next_label = 0
        self._positions = np.zeros((0, 2))
        self._covariances = np.zeros((0, 2, 2))
        self._ages = np.zeros(0)
        self._labels = np.zeros(0, dtype=np.int64)

    def predict(self, motion: Displacement) -> None:
        """Carry the readings into the robot's new frame; drop those older than keep_s."""
        check(motion)
        self._time = motion.time
        self._positions, carried = into_new_frame(self._positions, self._covariances, motion)
        self._covariances = carried + self._process_noise * motion.interval * np.eye(2)
        self._ages = self._ages + motion.interval
        self._keep(self._ages < self._keep_s)

    def update(self, measurement: Positions | Bearings) -> None:
        """Add the readings, and drop older ones within merge_m of any of them."""
        check(measurement)
        self._time = measurement.time
        if isinstance(measurement, Bearings):
            return
        new = measurement.positions
        apart = np.linalg.norm(self._positions[:, None] - new[None], axis=2) >= self._merge_m
        self._keep(apart.all(axis=1))
        labels = self._next_label + np.arange(len(new), dtype=np.int64)
        self._next_label += len(new)
        self._positions = np.concatenate((self._positions, new))
        self._covariances = np.concatenate((self._covariances, measurement.covariances))
        self._ages = np.concatenate((self._ages, np.zeros(len(new))))
        self._labels = np.concatenate((self._labels, labels))

    def _keep(self, kept: BoolArray) -> None:
        self._positions, self._covariances = self._positions[kept], self._covariances[kept]
        self._ages, self._labels = self._ages[kept], self._labels[kept]

    def estimate(self) -> Estimate:
        """Every reading that is kept."""
        return Estimate(
            time=self._time,
            positions=self._positions.copy(),
            covariances=self._covariances.copy(),
            weights=np.ones(len(self._ages)),
            ages=self._ages.copy(),
            labels=self._labels.copy(),
        )
