"""Kalman filters that know which reading is whose: the limit of what any filter can reach.

Only for evaluation. It takes readings' `identities`; those of nobody (-1) it leaves out.
"""

import numpy as np

from host.geometry import rotation, wrap
from host.messages import Bearings, Displacement, Estimate, FloatArray, Positions


def predict_positions(
    positions: FloatArray, covariances: FloatArray, motion: Displacement, process_noise: float
) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) and covariances (n, 2, 2) in the robot's new frame.

    m' = R(dpsi)^T (m - d);  P' = R^T (P + v I) R + (J m')(J m')^T h + q dt I, with v and h the
    variances of the odometry, J m' = (-y', x') the lever arm of its heading and q, process_noise,
    in m²/s the random walk of a teammate. (Perera 2021 eq. 7-8, counter-clockwise positive.)
    """
    rotated = rotation(motion.dpsi)
    moved = (positions - np.array([motion.dx, motion.dy])) @ rotated
    lever = moved[:, ::-1] * np.array([-1.0, 1.0])
    spread = rotated.T @ (covariances + motion.translation_variance * np.eye(2)) @ rotated
    spread = spread + motion.heading_variance * lever[:, :, None] * lever[:, None, :]
    return moved, spread + process_noise * motion.interval * np.eye(2)


class Clairvoyant:
    """One Kalman filter per identity, position as a random walk.

    process_noise: m²/s per axis. forget_s: a teammate without a position for longer is forgotten.
    A teammate is known from its first position on: a bearing alone does not tell how far it is.
    """

    def __init__(self, process_noise: float = 0.0121, forget_s: float = 1.5) -> None:
        self._process_noise = process_noise
        self._forget_s = forget_s
        self._time = 0.0
        self._identities = np.zeros(0, dtype=np.int64)
        self._positions = np.zeros((0, 2))
        self._covariances = np.zeros((0, 2, 2))
        self._ages = np.zeros(0)

    def predict(self, motion: Displacement) -> None:
        """Carry every teammate into the robot's new frame; forget those unseen for too long."""
        self._time = motion.time
        self._positions, self._covariances = predict_positions(
            self._positions, self._covariances, motion, self._process_noise
        )
        self._ages = self._ages + motion.interval
        known = self._ages < self._forget_s
        self._identities, self._ages = self._identities[known], self._ages[known]
        self._positions, self._covariances = self._positions[known], self._covariances[known]

    def update(self, measurement: Positions | Bearings) -> None:
        """Take in the readings that have an identity. Raises ValueError where none are given."""
        self._time = measurement.time
        if measurement.identities is None:
            raise ValueError("the clairvoyant filter needs the identity of each reading")
        for reading in np.flatnonzero(measurement.identities >= 0):
            identity = int(measurement.identities[reading])
            found = np.flatnonzero(self._identities == identity)
            track = int(found[0]) if len(found) else None
            if isinstance(measurement, Positions):
                self._use_position(measurement, int(reading), identity, track)
            elif track is not None:
                self._use_bearing(measurement, int(reading), track)

    def _use_position(
        self, measured: Positions, reading: int, identity: int, track: int | None
    ) -> None:
        """Kalman update, H = I: S = P + R, K = P S^-1. A lag adds to R: the teammate moved on."""
        position = measured.positions[reading]
        lag = 0.0 if measured.lags is None else float(measured.lags[reading])
        noise = measured.covariances[reading] + self._process_noise * lag * np.eye(2)
        if track is None:
            self._begin(identity, position, noise)
            return
        prior = self._covariances[track]
        gain = np.linalg.solve(prior + noise, prior).T
        self._positions[track] += gain @ (position - self._positions[track])
        self._covariances[track] = _symmetric(prior - gain @ prior)
        self._ages[track] = 0.0

    def _use_bearing(self, measured: Bearings, reading: int, track: int) -> None:
        """Extended Kalman update, H = (-y, x) / r² (Perera 2021 eq. 25-28, repaired)."""
        bearing, variance = float(measured.bearings[reading]), float(measured.variances[reading])
        x, y = self._positions[track] - np.array(measured.origin)
        squared = float(x * x + y * y)
        if squared < 1e-6:
            return  # a teammate at the rays' origin: its direction says nothing
        jacobian = np.array([-y, x]) / squared
        prior = self._covariances[track]
        variance += self._process_noise * measured.lag / squared
        gain = prior @ jacobian / (jacobian @ prior @ jacobian + variance)
        self._positions[track] += gain * float(wrap(bearing - np.arctan2(y, x)))
        self._covariances[track] = _symmetric(prior - np.outer(gain, jacobian @ prior))

    def _begin(self, identity: int, position: FloatArray, covariance: FloatArray) -> None:
        self._identities = np.append(self._identities, identity)
        self._positions = np.concatenate((self._positions, position[None]))
        self._covariances = np.concatenate((self._covariances, covariance[None]))
        self._ages = np.append(self._ages, 0.0)

    def estimate(self) -> Estimate:
        """Every teammate placed in the last forget_s; labels are the identities."""
        return Estimate(
            time=self._time,
            positions=self._positions.copy(),
            covariances=self._covariances.copy(),
            weights=np.ones(len(self._ages)),
            ages=self._ages.copy(),
            labels=self._identities.copy(),
        )


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray((matrix + matrix.T) / 2.0)
