"""What a thing is and how it moves: obstacle, or teammate that stands, moves or cruises.

A Markov chain over discrete modes, each with its own Gaussian of position and velocity, mixed as in
the interacting multiple model filter (Blom and Bar-Shalom 1988). The velocity is an
Ornstein-Uhlenbeck process: it is kept for a while and forgotten.
"""

import numpy as np

from host.config import PmbSettings
from host.estimator.moving_gaussians import (
    PVXVX,
    PVYVY,
    PXVX,
    PXX,
    PYVY,
    PYY,
    ROWS,
    VX,
    WEIGHT,
    Y,
    add_odometry_noise,
    from_moments,
    into_frame,
    moments,
    propagate,
)
from host.messages import Displacement, FloatArray

OBSTACLE, PARKED, STANDING, MOVING, CRUISING = range(5)
MODES = 5
STATIC, DYNAMIC, TEAMMATE = slice(0, 3), slice(3, 5), slice(1, 5)

# From mode to mode, 1/s. The chain has neighbours only, so its eigenvalues are real. A parked
# robot stands for minutes, as an obstacle does for ever: lest standing long speak for an obstacle.
_RATES = np.array(
    [
        [0.0, 1e-4, 0.0, 0.0, 0.0],
        [1e-5, 0.0, 0.01, 0.0, 0.0],
        [0.0, 0.01, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 1.0],
        [0.0, 0.0, 0.0, 0.7, 0.0],
    ]
)
_AT_BIRTH = np.array([0.1, 0.1, 0.33, 0.47])  # of teammates, the share in each of their modes
# Acceleration noise m²/s³ and correlation time s of the velocity.
_NOISE = np.array([0.0, 0.0, 0.0, 0.1, 0.002])
_TIMES = np.array([1.0, 1.0, 1.0, 3.0, 20.0])
_MOVES = np.array([0.0, 0.0, 0.0, 1.0, 1.0])


class ThingModes:
    """The chain of modes and the motion in each; rows are (ROWS, MODES, n)."""

    def __init__(self, settings: PmbSettings) -> None:
        self._speed_variance = settings.speed_mps**2
        self._noise = _NOISE * (settings.speed_mps / 0.2) ** 2
        generator = _RATES - np.diag(_RATES.sum(axis=1))
        self._eigenvalues, self._vectors = np.linalg.eig(generator)
        self._inverse = np.linalg.inv(self._vectors)

    def predict(self, rows: FloatArray, motion: Displacement) -> FloatArray:
        """Mix the modes, move each on, and take all into the robot's new frame (ROWS, MODES, n)."""
        rows = self._mixed(rows, motion.interval)
        transitions, noise = self._steps(motion.interval)
        rows[: Y + 1] -= np.array([motion.dx, motion.dy])[:, None, None]
        propagate(rows, into_frame(motion) @ transitions, noise)
        add_odometry_noise(rows, motion)
        return rows

    def _mixed(self, rows: FloatArray, dt: float) -> FloatArray:
        """Interaction: each mode becomes the mixture of what may have changed into it.

        What starts to move has any velocity of the usual size; what stops has none.
        """
        centres = rows[: Y + 1, TEAMMATE].mean(axis=1)[:, None]
        sums = moments(rows, centres)
        for entry in (PVXVX, PVYVY):
            sums[entry, STATIC] = self._speed_variance * sums[WEIGHT, STATIC]
        chances = (self._vectors * np.exp(self._eigenvalues * dt)) @ self._inverse
        mixed = from_moments(chances.T @ sums, centres)
        _stop(mixed)
        return mixed

    def _steps(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """F (MODES, 4, 4) and the entries of Q (10, MODES) over dt s."""
        kept = np.exp(-dt / _TIMES)
        transitions = np.zeros((MODES, 4, 4))
        transitions[:, (0, 1), (0, 1)] = 1.0
        transitions[:, (0, 1), (2, 3)] = (_MOVES * _TIMES * (1.0 - kept))[:, None]
        transitions[:, (2, 3), (2, 3)] = (_MOVES * kept)[:, None]
        noise = np.zeros((10, MODES))
        gone = 1.0 - kept
        half = 0.5 * (1.0 - kept * kept)
        noise[[0, 2]] = self._noise * _TIMES**2 * (dt - 2.0 * _TIMES * gone + _TIMES * half)
        noise[[3, 6]] = self._noise * 0.5 * (_TIMES * gone) ** 2
        noise[[7, 9]] = self._noise * _TIMES * half
        return transitions, noise

    def born(
        self,
        positions: FloatArray,
        covariances: FloatArray,
        lags: FloatArray | float,
        teammate: FloatArray,
        obstacle: FloatArray,
    ) -> FloatArray:
        """Things that were at positions (m, 2) `lags` s ago: (ROWS, MODES, m).

        teammate, obstacle (m,): weights of either class. What moves may have any velocity.
        """
        rows = np.zeros((ROWS, MODES, len(positions)))
        rows[: Y + 1] = positions.T[:, None]
        rows[PXX : PYY + 1] = covariances.reshape(-1, 4).T.take((0, 1, 3), axis=0)[:, None]
        variance = self._speed_variance
        for place, both, velocity in ((PXX, PXVX, PVXVX), (PYY, PYVY, PVYVY)):
            rows[place, DYNAMIC] += lags * lags * variance
            rows[both, DYNAMIC] = lags * variance
            rows[velocity, DYNAMIC] = variance
        rows[WEIGHT, OBSTACLE] = obstacle
        rows[WEIGHT, TEAMMATE] = _AT_BIRTH[:, None] * teammate
        return rows


def _stop(rows: FloatArray) -> None:
    """Take the velocity from the static modes, in place."""
    rows[VX : VX + 2, STATIC] = 0.0
    rows[PXX + 3 : WEIGHT, STATIC] = 0.0


def mixture(rows: FloatArray) -> FloatArray:
    """Position of the mixture over all modes: (6, n), rows as in `gaussian_mixture`."""
    weights = rows[WEIGHT]
    total = weights.sum(axis=0)
    shares = weights / np.maximum(total, 1e-300)
    positions = rows[: Y + 1]
    mean = (shares * positions).sum(axis=1)
    off = positions - mean[:, None]
    spread = rows[PXX : PXX + 3] + off.take((0, 0, 1), axis=0) * off.take((0, 1, 1), axis=0)
    return np.concatenate((mean, (shares * spread).sum(axis=1), total[None]))
