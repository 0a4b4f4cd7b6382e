"""The filter of Perera 2021, equations 7–30, as its author ran it.

It stands beside `pmb` and `phd` to show what the thesis' filter does on the same data. As printed:
survival per update whatever its length (9, 10), birth on the observer at every update (11), no
clutter (6), the range curves (19, 30). Reported is what weighs more than 0.1 (ch. 6). What the
thesis leaves open is as in its author's public code (github.com/thiw1ka/
PHD_based_relative_localization): system noise, merging, pruning.

Repairs (docs/filters.md gives their reasons):
 1. eq. 7–8: R(dpsi) is right for the clockwise dpsi of eq. 32; ours is counter-clockwise.
 2. eq. 8: Q is not given; 0.01 m² per axis at 20 updates per second, by time.
 3. eq. 15, 27: the innovation's covariance S where the component's stands, and divided by the sum
    that eq. 6 has below the line.
 4. eq. 20–22: products over the pillars and robots where sums are printed (a sum of four gives
    P_D near 4; an empty one gives 0); eq. 23: the nearest null direction instead of a sum;
    kernels of unit peak; angles wrapped; weights at most 1; 2c² inside the exponent.
 5. eq. 25, 28: the innovation is the wrapped angle, H = (-y, x)/r², R = (5 deg)²; the newborn
    component on the observer has no bearing and is left out.
 6. P_D at most 0.98, so that no weight is lost at one miss.
 7. pruning below 0.001, then merging: from the heaviest on, each takes along what is within a
    Mahalanobis distance of 2 by its covariance, by matching moments.
"""

import math

import numpy as np

from host.config import Lidar
from host.estimator.gaussians.gaussian_mixture import (
    PXX,
    PXY,
    PYY,
    ROWS,
    WEIGHT,
    X,
    Y,
    match_moments,
    predict_mixture,
    update_by_bearings,
    update_by_positions,
)
from host.estimator.sensor_models import beside_sectors, in_view
from host.geometry import SECTORS, polar, wrap
from host.message_checks import check
from host.messages import Bearings, Displacement, Estimate, FloatArray, IntArray, Positions

_SYSTEM_NOISE_M2_PER_S = 0.01 * 20.0
_BIRTH_VARIANCE_M2, _BIRTH_WEIGHT = 4.0, 0.001  # eq. 11
_LIDAR_VARIANCE_M2 = 0.0025  # eq. 17
_BEARING_VARIANCE_RAD2 = math.radians(5.0) ** 2  # eq. 28
_OCCLUSION_RAD = math.radians(3.0)  # eq. 22
_INTERFERENCE_RAD = math.radians(3.0)  # c of eq. 23
_PRUNE_WEIGHT, _MERGE_DISTANCE = 0.001, 2.0
_REPORT_WEIGHT = 0.1
_MOST_DETECTION = 0.98  # repair 6


class Perera2021Filter:
    """The thesis' filter (see `host.estimator.interface.Filter`)."""

    def __init__(self, lidar: Lidar | None = None) -> None:
        sectors = (lidar or Lidar()).blind_sectors
        self._centres = np.array([s.centre_rad for s in sectors])
        self._half_widths = np.array([s.width_rad / 2.0 for s in sectors])
        self._rows = np.zeros((ROWS, 0))
        self._seen = np.zeros(0)
        self._time = 0.0

    def predict(self, motion: Displacement) -> None:
        """Eq. 7–11."""
        check(motion)
        rows = self._rows
        self._time = motion.time
        distance = np.hypot(rows[X], rows[Y])
        rows[WEIGHT] /= 1.05 + _exp(4.0 * (distance - 4.0))  # eq. 9, 10
        predict_mixture(rows, motion, _SYSTEM_NOISE_M2_PER_S * motion.interval)
        birth = np.zeros((ROWS, 1))
        birth[[PXX, PYY]], birth[WEIGHT] = _BIRTH_VARIANCE_M2, _BIRTH_WEIGHT
        self._rows = np.concatenate((rows, birth), axis=1)
        self._seen = np.append(self._seen, motion.time)

    def update(self, measurement: Positions | Bearings) -> None:
        """Eq. 12–23 for the lidar, eq. 24–30 for the cameras."""
        check(measurement)
        rows = self._rows
        n, m = rows.shape[1], len(_readings(measurement))
        i, j = np.repeat(np.arange(n), m), np.tile(np.arange(m), n)  # each with each: no gate
        prior = rows.take(i, axis=1)
        if isinstance(measurement, Positions):
            detected = self._lidar_detection(measurement)
            noise = _LIDAR_VARIANCE_M2 * np.array([[1.0], [0.0], [1.0]])
            updated, density = update_by_positions(prior, measurement.positions[j].T, noise)
        else:
            detected = self._camera_detection(measurement)
            updated, density = update_by_bearings(
                prior, measurement.bearings[j], _BEARING_VARIANCE_RAD2, measurement.origin
            )
        updated[WEIGHT] *= detected[i] * density
        total = np.bincount(j, updated[WEIGHT], m)
        updated[WEIGHT] /= np.maximum(total[j], 1e-300)
        rows[WEIGHT] *= 1.0 - detected
        self._reduce(updated)

    def _reduce(self, updated: FloatArray) -> None:
        """Merge what is missed and updated, from the heaviest on, and keep what weighs enough."""
        rows = np.concatenate((self._rows, updated), axis=1)
        seen = np.concatenate((self._seen, np.full(updated.shape[1], self._time)))
        kept = np.flatnonzero(rows[WEIGHT] > _PRUNE_WEIGHT)
        rows, seen = rows.take(kept, axis=1), seen[kept]
        into, leaders = _groups(rows)
        self._rows = match_moments(rows, into, rows[: Y + 1, leaders])
        self._seen = np.full(len(leaders), -math.inf)
        np.maximum.at(self._seen, into, seen)

    def _lidar_detection(self, measured: Positions) -> FloatArray:
        """P_D (n,) of each component by the lidar, eq. 18: eq. 19 to 23."""
        distance, bearing = polar(self._rows[: Y + 1].T)
        detected = self._occlusion(bearing, distance)
        detected *= beside_sectors(bearing, self._centres, self._half_widths)  # eq. 20
        detected /= 1.02 + _exp(8.0 * (distance - 1.5))  # eq. 19
        if measured.clearance is not None:
            detected *= _interference(bearing, measured.clearance)
        return np.minimum(detected, _MOST_DETECTION)

    def _camera_detection(self, measured: Bearings) -> FloatArray:
        """P_D (n,) of each component by the cameras, eq. 29."""
        distance, bearing = polar(self._rows[: Y + 1].T)
        detected = self._occlusion(bearing, distance)
        detected /= 1.1 + _exp(5.0 * (distance - 4.0))  # eq. 30
        detected[distance < 1e-3] = 0.0  # repair 5
        detected *= in_view(bearing, measured.view)
        return np.minimum(detected, _MOST_DETECTION)

    def _occlusion(self, bearing: FloatArray, distance: FloatArray) -> FloatArray:
        """Eq. 21–22: every nearer component may hide this one."""
        offset = wrap(bearing[:, None] - bearing) / _OCCLUSION_RAD
        hiding = np.minimum(self._rows[WEIGHT], 1.0) * np.exp(-0.5 * offset**2)
        return np.asarray(
            np.prod(1.0 - np.where(distance < distance[:, None], hiding, 0.0), axis=1)
        )

    def estimate(self) -> Estimate:
        """Every component heavier than 0.1 (ch. 6); labels are their places in the mixture."""
        index = np.flatnonzero(self._rows[WEIGHT] > _REPORT_WEIGHT)
        rows = self._rows.take(index, axis=1)
        return Estimate(
            time=self._time,
            positions=rows[[X, Y]].T,
            covariances=rows[[PXX, PXY, PXY, PYY]].T.reshape(-1, 2, 2),
            weights=rows[WEIGHT],
            ages=self._time - self._seen[index],
            labels=index,
        )


def _readings(measurement: Positions | Bearings) -> FloatArray:
    return measurement.positions if isinstance(measurement, Positions) else measurement.bearings


def _exp(exponent: FloatArray) -> FloatArray:
    """The exponential, of what is not too large for it."""
    return np.exp(np.minimum(exponent, 500.0))


def _interference(bearing: FloatArray, clearance: FloatArray) -> FloatArray:
    """Eq. 23: less likely where nothing comes back; the nearest null direction counts."""
    null = np.flatnonzero(np.isinf(clearance))
    if not len(null):
        return np.ones_like(bearing)
    centre = -math.pi + (null + 0.5) * (2.0 * math.pi / SECTORS)
    nearest = np.min(np.abs(wrap(bearing[:, None] - centre)), axis=1)
    return np.asarray(1.0 - 0.6 * np.exp(-0.5 * (nearest / _INTERFERENCE_RAD) ** 2))


def _groups(rows: FloatArray) -> tuple[IntArray, IntArray]:
    """Which group each component (n,) merges into, and the heaviest (k,) of every group.

    From the heaviest on, each takes along what is left within _MERGE_DISTANCE by its covariance.
    """
    into, leaders = np.full(rows.shape[1], -1), list[int]()
    for heaviest in np.argsort(-rows[WEIGHT], kind="stable"):
        if into[heaviest] >= 0:
            continue
        dx, dy = rows[: Y + 1] - rows[: Y + 1, heaviest, None]
        pxx, pxy, pyy = rows[PXX : PYY + 1, heaviest]
        square = (pyy * dx * dx - 2.0 * pxy * dx * dy + pxx * dy * dy) / (pxx * pyy - pxy * pxy)
        into[(into < 0) & (square <= _MERGE_DISTANCE**2)] = len(leaders)
        leaders.append(int(heaviest))
    return into, np.array(leaders, dtype=np.int64)
