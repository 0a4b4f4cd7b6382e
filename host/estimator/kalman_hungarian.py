"""Kalman filters matched by the Hungarian algorithm (Belaroussi 2024, sections 4.1 and 5.2.1).

The camera decides who is there; the lidar's position joins where it matches. One of four ways of
matching is his lidar detection: on its own, within the bounding box (partially assisted), next to
the camera's position (fully assisted), or within the box and without the camera's distance
(complementary). Here a lidar "cluster" is a candidate of our turret finder.

What had to be repaired: his R = diag((x e)^2, (y e)^2) is zero on an axis, here it is (d e)^2 all
around; P0 has variances; steps last as long as they last, and filters that find no match are
predicted, too; a lidar reading is used once; the robot's own motion is taken out, and pictures have
the delay that they have. Where no camera is at work, the lidar decides.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from host.geometry import along_rays, rotation, wrap
from host.message_checks import check
from host.messages import (
    Bearings,
    BoolArray,
    Displacement,
    Estimate,
    FloatArray,
    IntArray,
    Positions,
)

Matching = Literal["standalone", "partial", "full", "complementary"]

_GATE_M = 0.5  # section 5.2.1, last paragraph but one
_FULL_GATE_M = 0.15  # section 5.3.3: slightly larger than the robot
_BOX_RAD = math.radians(10.0)  # the bounding box's half width
_ROUNDS_UNMATCHED = 10  # step 6
_ACCELERATION = 1e-4  # q of section 4.1.2
_START_VARIANCES = (0.01, 0.01, 0.04, 0.04)  # m², (m/s)²
_NO_CAMERA_S = 1.0  # without pictures for so long the lidar decides


@dataclass(frozen=True, slots=True)
class Errors:
    """Divisors of the sensors' stated errors: 1 as in the data sheets, more in the improved form.

    matched_only: a camera's position counts only where the lidar has one, too.
    """

    camera: float = 1.0
    lidar: float = 1.0
    matched_only: bool = False


IMPROVED = Errors(camera=10.0, lidar=20.0, matched_only=True)


class KalmanHungarian:
    """One constant-velocity filter a teammate, in the robot's frame: x, y (m), velocities (m/s)."""

    def __init__(
        self,
        matching: Matching = "standalone",
        errors: Errors = Errors(),
        *,
        delays: bool = True,
    ) -> None:
        """delays: whether a reading counts as of when it was made, or as of now."""
        self._delays = delays
        self._matching = matching
        self._errors = errors
        self._time = 0.0
        self._states = np.zeros((0, 4))
        self._covariances = np.zeros((0, 4, 4))
        self._ages = np.zeros(0)
        self._unmatched = np.zeros(0, dtype=np.int64)
        self._labels = np.zeros(0, dtype=np.int64)
        self._next_label = 0
        self._lidar = np.zeros((0, 2))  # not used yet
        self._lidar_lags = np.zeros(0)
        self._picture_time = -math.inf

    def predict(self, motion: Displacement) -> None:
        """F and Q of section 4.1.2 over the interval, then into the robot's new frame."""
        check(motion)
        self._time = motion.time
        interval, turned = motion.interval, rotation(motion.dpsi)
        forward = np.eye(4)
        forward[0, 2] = forward[1, 3] = interval
        noise = np.repeat((interval**2 / 2.0, interval), 2) * _ACCELERATION
        noise[:2] += motion.translation_variance
        into = np.kron(np.eye(2), turned.T)
        shift = np.array([motion.dx, motion.dy, 0.0, 0.0])
        self._states = (self._states @ forward.T - shift) @ into.T
        carried = into @ (forward @ self._covariances @ forward.T + np.diag(noise)) @ into.T
        lever = np.zeros_like(self._states)
        lever[:, 0], lever[:, 1] = -self._states[:, 1], self._states[:, 0]
        self._covariances = carried + motion.heading_variance * lever[:, :, None] * lever[:, None]
        self._lidar = (self._lidar - shift[:2]) @ turned
        self._lidar_lags = self._lidar_lags + (interval if self._delays else 0.0)
        self._ages = self._ages + interval

    def update(self, measurement: Positions | Bearings) -> None:
        """A picture is a round of section 5.2.1; a scan waits for it, or is one itself."""
        check(measurement)
        self._time = measurement.time
        if isinstance(measurement, Positions):
            self._lidar = measurement.positions
            lags, now = measurement.lags, np.zeros(len(self._lidar))
            self._lidar_lags = lags if lags is not None and self._delays else now
            if self._time - self._picture_time > _NO_CAMERA_S:
                nobody = np.full(len(self._lidar), -1)
                self._round(self._lidar, self._lidar_lags, nobody, "lidar")
            return
        self._picture_time = self._time
        if measurement.ranges is None:
            return
        seen = along_rays(measurement.origin, measurement.bearings, measurement.ranges)
        lags = np.full(len(seen), measurement.lag if self._delays else 0.0)
        self._round(seen, lags, self._lidar_of(seen), "camera")

    def estimate(self) -> Estimate:
        """Every filter that is alive."""
        return Estimate(
            time=self._time,
            positions=self._states[:, :2].copy(),
            covariances=self._covariances[:, :2, :2].copy(),
            weights=np.ones(len(self._states)),
            ages=self._ages.copy(),
            labels=self._labels.copy(),
        )

    def _lidar_of(self, seen: FloatArray) -> IntArray:
        """Step 3: the lidar's reading of each camera position (n,), -1 for none."""
        if self._matching == "standalone":
            return _matched(seen, self._lidar, _GATE_M)
        if self._matching == "full":
            return _nearest(np.linalg.norm(seen[:, None] - self._lidar, axis=2), _FULL_GATE_M)
        directions = np.arctan2(self._lidar[:, 1], self._lidar[:, 0])
        aside = np.abs(wrap(np.arctan2(seen[:, 1], seen[:, 0])[:, None] - directions))
        return _nearest(aside, _BOX_RAD)

    def _round(self, seen: FloatArray, lags: FloatArray, lidar: IntArray, sensor: str) -> None:
        """Steps 4 to 6: positions to filters, start, correct, and give up who was not matched."""
        kept = np.ones(len(seen), dtype=bool)
        if sensor == "camera" and (self._errors.matched_only or self._matching == "complementary"):
            kept = lidar >= 0
        seen, lags, lidar = seen[kept], lags[kept], lidar[kept]
        then = self._states[:, :2] - (lags.mean() if len(lags) else 0.0) * self._states[:, 2:]
        chosen = _matched(seen, then, _GATE_M)
        self._unmatched += 1
        for position, lag, reading, row in zip(seen, lags, lidar, chosen, strict=True):
            if row < 0:
                row = self._start(position if reading < 0 else self._lidar[reading])
            if sensor == "lidar" or self._matching != "complementary":
                self._correct(row, position, self._sigma(position, sensor), lag)
            if reading >= 0:
                at = self._lidar[reading]
                self._correct(row, at, self._sigma(at, "lidar"), self._lidar_lags[reading])
            self._unmatched[row], self._ages[row] = 0, 0.0
        used = lidar[lidar >= 0]
        self._lidar = np.delete(self._lidar, used, axis=0)
        self._lidar_lags = np.delete(self._lidar_lags, used)
        self._keep(self._unmatched <= _ROUNDS_UNMATCHED)

    def _sigma(self, position: FloatArray, sensor: str) -> float:
        """The stated error, m, at this distance (section 4.1.2)."""
        distance = float(np.hypot(*position))
        if sensor == "lidar":
            return (0.02 if distance < 1.0 else 0.035 * distance) / self._errors.lidar
        share = 0.02 if distance < 4.0 else 0.04 if distance < 7.0 else 0.06
        return max(share * distance, 1e-3) / self._errors.camera

    def _start(self, position: FloatArray) -> int:
        self._states = np.vstack((self._states, (*position, 0.0, 0.0)))
        self._covariances = np.concatenate((self._covariances, np.diag(_START_VARIANCES)[None]))
        self._ages, self._unmatched = np.append(self._ages, 0.0), np.append(self._unmatched, 0)
        self._labels = np.append(self._labels, self._next_label)
        self._next_label += 1
        return len(self._states) - 1

    def _correct(self, row: int, position: FloatArray, sigma: float, lag: float) -> None:
        """K, state and covariance of section 4.1.1 for a position measured `lag` s ago.

        Then the teammate was where its velocity took it from since: H = (I, -lag I).
        """
        covariance = self._covariances[row]
        measures = np.hstack((np.eye(2), -lag * np.eye(2)))
        spread = measures @ covariance @ measures.T + sigma**2 * np.eye(2)
        gain = np.linalg.solve(spread, measures @ covariance).T
        self._states[row] += gain @ (position - measures @ self._states[row])
        left = covariance - gain @ measures @ covariance
        self._covariances[row] = (left + left.T) / 2.0

    def _keep(self, kept: BoolArray) -> None:
        self._states, self._covariances = self._states[kept], self._covariances[kept]
        self._ages, self._labels = self._ages[kept], self._labels[kept]
        self._unmatched = self._unmatched[kept]


def _matched(positions: FloatArray, others: FloatArray, gate_m: float) -> IntArray:
    """The partner (n,) among `others` of each position by the Hungarian algorithm; -1 for none."""
    apart = np.linalg.norm(positions[:, None] - others, axis=2)
    rows, columns = linear_sum_assignment(np.minimum(apart, 10.0 * gate_m))
    partners = np.full(len(positions), -1)
    near = apart[rows, columns] < gate_m
    partners[rows[near]] = columns[near]
    return partners


def _nearest(apart: FloatArray, gate: float) -> IntArray:
    """The nearest (n,) by a table (n, k), each given once; -1 where none is nearer than `gate`."""
    partners = np.full(len(apart), -1)
    for row, column in np.column_stack(np.unravel_index(np.argsort(apart, axis=None), apart.shape)):
        if apart[row, column] >= gate:
            break
        if partners[row] < 0 and column not in partners:
            partners[row] = column
    return partners
