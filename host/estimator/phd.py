"""The sound Gaussian-mixture PHD filter over position and kind: teammate or obstacle.

The recursion is Vo and Ma 2006 with the sensors of Perera 2021 and what the thesis leaves out:
clutter, the innovation covariance, birth from readings, merging, and a memory of what was
reported. A component is of one kind: teammates move and show a red strip to the cameras, obstacles
do neither, and both look alike to the lidar; so motion and cameras tell the kind. Every step is
linear in the number of components. docs/filters.md derives it and lists the settings.
"""

import numpy as np

from host.config import Camera, Filter, Lidar
from host.estimator.gaussian_mixture import (
    CONFIRMED,
    LABEL,
    PXX,
    PXY,
    PYY,
    ROBOT,
    ROWS,
    SEEN,
    WEIGHT,
    X,
    Y,
    carry,
    empty,
    merge,
    pair_bearings,
    pair_positions,
)
from host.estimator.sensor_models import CameraModel, LidarModel, clearance_of
from host.messages import Bearings, Displacement, Estimate, FloatArray, IntArray, Positions

_FADE_S = 1.0  # mean survival beyond the survival range
_BELIEVED = 0.5  # from this weight on a component can hide another


class PhdFilter:
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    def __init__(
        self,
        settings: Filter | None = None,
        lidar: Lidar | None = None,
        camera: Camera | None = None,
    ) -> None:
        self._settings = settings or Filter()
        self._lidar = LidarModel(lidar or Lidar())
        self._camera = CameraModel(camera or Camera())
        self._width = (lidar or Lidar()).target_diameter_m
        self._rows = empty()
        self._time = 0.0
        self._next_label = 1

    def predict(self, motion: Displacement) -> None:
        """Eq. 7–10 repaired: carry, spread teammates (not obstacles), fade what is far."""
        rows, settings, dt = self._rows, self._settings, motion.interval
        self._time = motion.time
        if not rows.shape[1]:
            return
        carry(rows, motion, settings.motion_noise_m**2 * dt * rows[ROBOT])
        far = rows[X] ** 2 + rows[Y] ** 2 > settings.survival_range_m**2
        rows[WEIGHT] *= np.exp(np.where(far, -dt / _FADE_S, -dt / settings.survival_s))

    def update(self, measurement: Positions | Bearings) -> None:
        """Eq. 6 with clutter; lidar positions or camera bearings, in any order."""
        if isinstance(measurement, Positions):
            self._update_positions(measurement)
        else:
            self._update_bearings(measurement)

    def _update_positions(self, measured: Positions) -> None:
        rows, settings = self._rows, self._settings
        n, m = rows.shape[1], len(measured.positions)
        bearing, distance, clearance = self._surroundings(measured.clearance)
        detected = self._lidar.detection(
            bearing, distance, clearance, measured.clearance is not None
        )
        lags = np.zeros(m) if measured.lags is None else measured.lags
        pairs = pair_positions(rows, measured, settings.motion_noise_m**2 * lags, settings.gate)
        i, j = pairs.component, pairs.reading
        mass = detected[i] * rows[WEIGHT, i] * pairs.likelihood
        total = np.bincount(j, mass, m) + (self._lidar.clutter + settings.birth_per_m2)
        pairs.updated[WEIGHT] = mass / total[j]
        pairs.updated[SEEN] = measured.time
        born = self._born(measured, np.asarray(settings.birth_per_m2 / total))
        missed = rows
        missed[WEIGHT] *= 1.0 - detected
        # Same reading, same kind: one group. What was missed joins the group of its likeliest
        # reading, unless that reading is unlikely to be its own.
        reading = 2 * j + pairs.updated[ROBOT].astype(np.int64)
        home = 2 * m + np.arange(n)
        order = np.argsort(pairs.updated[WEIGHT])
        likely = order[pairs.updated[WEIGHT, order] > 0.1 * missed[WEIGHT, i[order]]]
        home[i[likely]] = reading[likely]
        births = 2 * np.tile(np.arange(m), 2) + born[ROBOT].astype(np.int64)
        self._replace(
            np.concatenate((missed, pairs.updated, born), axis=1),
            np.concatenate((np.arange(n), i, np.full(born.shape[1], -1))),
            np.concatenate((home, reading, births)),
        )

    def _update_bearings(self, measured: Bearings) -> None:
        rows, settings = self._rows, self._settings
        n, m = rows.shape[1], len(measured.bearings)
        if not n:
            return
        bearing, distance, clearance = self._surroundings(None)
        detected = rows[ROBOT] * self._camera.detection(bearing, distance, clearance)
        lag = settings.motion_noise_m**2 * measured.lag
        pairs = pair_bearings(rows, measured, lag, settings.gate)
        i, j = pairs.component, pairs.reading
        mass = detected[i] * rows[WEIGHT, i] * pairs.likelihood
        total = np.bincount(j, mass, m) + self._camera.clutter
        pairs.updated[WEIGHT] = mass / total[j]
        pairs.updated[SEEN] = measured.time
        rows[WEIGHT] *= 1.0 - detected
        # A bearing moves a component little: its family stays together unless it is torn apart.
        parent = np.concatenate((np.arange(n), i))
        self._replace(np.concatenate((rows, pairs.updated), axis=1), parent, parent)

    def _surroundings(
        self, clearance: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bearing and distance of each component, and how far one sees in every sector."""
        x, y = self._rows[X], self._rows[Y]
        bearing, distance = np.arctan2(y, x), np.hypot(x, y)
        if clearance is None:
            believed = self._rows[WEIGHT] > _BELIEVED
            clearance = clearance_of(bearing, distance, believed, self._width)
        return bearing, distance, clearance

    def _born(self, measured: Positions, weight: FloatArray) -> FloatArray:
        """Two components a reading, an obstacle and a teammate: birth where something was seen."""
        m = len(weight)
        born = np.zeros((ROWS, 2, m))
        born[X], born[Y] = measured.positions.T
        covariances = measured.covariances
        born[PXX], born[PXY] = covariances[:, 0, 0], covariances[:, 0, 1]
        born[PYY] = covariances[:, 1, 1]
        share = self._settings.obstacle_share
        born[WEIGHT, 0], born[WEIGHT, 1] = share * weight, (1.0 - share) * weight
        born[ROBOT, 1] = 1.0
        born[SEEN] = measured.time
        return born.reshape(ROWS, 2 * m)

    def _replace(self, rows: FloatArray, parent: IntArray, group: IntArray) -> None:
        """Prune, merge, keep labels and the memory of what was reported with the heaviest heir."""
        settings = self._settings
        keep = np.flatnonzero(rows[WEIGHT] > settings.prune_weight)
        rows, kept = merge(rows[:, keep], group[keep], settings.merge_distance)
        parent = parent[keep[kept]]
        order = np.argsort(rows[WEIGHT], kind="stable")
        if len(order) > settings.capacity:
            order = order[-settings.capacity :]
            rows, parent = rows[:, order], parent[order]
            order = np.arange(len(order))
        heir = np.zeros(int(parent.max(initial=-1)) + 2, dtype=np.int64)
        heir[parent[order]] = order
        new = np.flatnonzero((parent < 0) | (heir[parent] != np.arange(len(parent))))
        rows[LABEL, new] = np.arange(self._next_label, self._next_label + len(new))
        self._next_label += len(new)
        rows[CONFIRMED, new] = 0.0
        needed = np.where(rows[CONFIRMED] > 0.0, settings.forget_weight, settings.report_weight)
        rows[CONFIRMED] = rows[WEIGHT] > needed
        self._rows = rows

    def estimate(self) -> Estimate:
        """Teammates reported: once above report_weight, until below forget_weight."""
        rows = self._rows[:, (self._rows[CONFIRMED] * self._rows[ROBOT]) > 0.0]
        covariances = rows[[PXX, PXY, PXY, PYY]].T.reshape(-1, 2, 2)
        return Estimate(
            time=self._time,
            positions=rows[[X, Y]].T,
            covariances=covariances,
            weights=rows[WEIGHT],
            ages=self._time - rows[SEEN],
            labels=rows[LABEL].astype(np.int64),
        )
