"""What a thing is and how it moves: obstacle, or teammate that stands, moves or cruises.

A Markov chain over discrete modes, mixed as in the interacting multiple model filter (Blom and
Bar-Shalom 1988). Whatever stands is in the same place, so there are three Gaussians of position and
velocity: of the modes that stand still, of moving, of cruising. The velocity is an
Ornstein-Uhlenbeck process: it is kept for a while and forgotten.
"""

import math

import numpy as np

from host.config import PmbSettings
from host.estimator.gaussians.moving_gaussians import (
    PLACE,
    PXVX,
    PXX,
    PYVY,
    PYY,
    ROWS,
    VELOCITY,
    VELOCITY_VARIANCES,
    Y,
    add_odometry_noise,
    into_frame,
    mix,
    propagate,
)
from host.messages import Displacement, FloatArray

OBSTACLE, PARKED, STANDING, MOVING, CRUISING = range(5)
MODES = 5
TEAMMATE = slice(1, 5)
STILL, MANOEUVRE, CRUISE = range(3)  # the Gaussians
MOTIONS = 3
MOTION_OF = np.array([STILL, STILL, STILL, MANOEUVRE, CRUISE])  # of each mode

_IN_MOTION = (np.arange(MOTIONS)[:, None] == MOTION_OF).astype(np.float64)
_OF_GAUSSIANS = np.concatenate((_IN_MOTION, _IN_MOTION * (np.arange(MODES) != OBSTACLE)))

# From mode to mode, 1/s. The chain has neighbours only, so its eigenvalues are real. A parked
# robot stands for minutes, as an obstacle does for ever: lest standing long speak for an obstacle.
_RATES = np.array(
    [
        [0.0, 1e-4, 0.0, 0.0, 0.0],
        [1e-5, 0.0, 0.01, 0.0, 0.0],
        [0.0, 0.01, 0.0, 0.7, 0.0],
        [0.0, 0.0, 0.7, 0.0, 3.0],
        [0.0, 0.0, 0.0, 0.4, 0.0],
    ]
)
_AT_BIRTH = np.array([0.1, 0.1, 0.33, 0.47])  # of teammates, the share in each of their modes
# Of each motion: acceleration noise m²/s³ and correlation time s of the velocity.
_NOISE, _TIMES = (0.0, 0.03, 0.0003), (1.0, 3.0, 20.0)
_STAYS = np.tile(np.diag([1.0, 1.0, 0.0, 0.0]), (MOTIONS, 1, 1))  # F of what stands still
_LEAST_FLOW = 1e-30  # keeps the Gaussian of a motion that is ruled out


class ThingModes:
    """The chain of modes and the motion in each.

    n things are their Gaussians, rows (ROWS, MOTIONS, n), and the weights (MODES, n) of their
    modes: the probability that the thing is there and in that mode.
    """

    def __init__(self, settings: PmbSettings) -> None:
        self._speed_variance = settings.speed_mps**2
        self._noise = [q * (settings.speed_mps / 0.2) ** 2 for q in _NOISE]
        generator = _RATES - np.diag(_RATES.sum(axis=1))
        self._eigenvalues, vectors = np.linalg.eig(generator)
        # Over dt, as sums over exp(eigenvalue dt): the chances to be in each mode afterwards, and
        # of those what flows from motion to motion; each by the mode that it comes from.
        chances = np.einsum("ae,eb->bae", vectors, np.linalg.inv(vectors))
        flows = np.einsum("ia,jb,bae->ijae", _IN_MOTION, _IN_MOTION, chances)
        self._changes = np.concatenate((flows.reshape(-1, MODES), chances.reshape(-1, MODES)))

    def predict(
        self, rows: FloatArray, weights: FloatArray, motion: Displacement
    ) -> tuple[FloatArray, FloatArray]:
        """Mix the modes, move each on, and take all into the robot's new frame: rows, weights."""
        rows, weights = self._mixed(rows, weights, motion.interval)
        transitions, noise = self._steps(motion.interval)
        rows[: Y + 1] -= np.array([motion.dx, motion.dy])[:, None, None]
        propagate(rows, into_frame(motion) @ transitions, noise)
        add_odometry_noise(rows, motion)
        return rows, weights

    def _mixed(
        self, rows: FloatArray, weights: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Interaction: each motion becomes the mixture of what may have changed into it.

        What starts to move has any velocity of the usual size; what stops has none. What ends to
        cruise may brake or swerve at once: its velocity changes by the usual size.
        """
        changes = np.maximum(self._changes @ np.exp(self._eigenvalues * dt), 0.0)
        after = changes.reshape(-1, MODES) @ weights
        flows, weights = after[: MOTIONS**2], after[MOTIONS**2 :]
        flows[:: MOTIONS + 1] += _LEAST_FLOW
        shares = flows.reshape(MOTIONS, MOTIONS, -1)
        shares /= shares.sum(axis=0)
        rows[VELOCITY_VARIANCES, STILL] = self._speed_variance
        mixed = mix(rows, shares)
        mixed[VELOCITY_VARIANCES, MANOEUVRE] += self._speed_variance * shares[CRUISE, MANOEUVRE]
        mixed[VELOCITY, STILL] = 0.0
        mixed[PXVX:, STILL] = 0.0
        return mixed, weights

    def _steps(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """F (MOTIONS, 4, 4) and the entries of Q (10, MOTIONS) over dt s."""
        transitions, noise = _STAYS.copy(), np.zeros((10, MOTIONS))
        for motion in range(1, MOTIONS):
            time, q = _TIMES[motion], self._noise[motion]
            kept = math.exp(-dt / time)
            moved = time * (1.0 - kept)
            half = 0.5 * time * (1.0 - kept * kept)
            transitions[motion] = [
                [1, 0, moved, 0],
                [0, 1, 0, moved],
                [0, 0, kept, 0],
                [0, 0, 0, kept],
            ]
            place, both, velocity = (
                q * time**2 * (dt - 2.0 * moved + half),
                0.5 * q * moved**2,
                q * half,
            )
            noise[:, motion] = [place, 0, place, both, 0, 0, both, velocity, 0, velocity]
        return transitions, noise

    def born(
        self,
        positions: FloatArray,
        covariances: FloatArray,
        lags: FloatArray | float,
        teammate: FloatArray,
        obstacle: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Things that were at positions (m, 2) `lags` s ago: rows, weights.

        teammate, obstacle (m,): weights of either class. What moves may have any velocity.
        """
        rows = np.zeros((ROWS, MOTIONS, len(positions)))
        rows[: Y + 1] = positions.T[:, None]
        rows[PXX : PYY + 1] = covariances.reshape(-1, 4).T.take((0, 1, 3), axis=0)[:, None]
        variance = self._speed_variance
        rows[PXX : PYY + 1 : PYY - PXX, MANOEUVRE:] += lags * lags * variance
        rows[PXVX : PYVY + 1 : PYVY - PXVX, MANOEUVRE:] = lags * variance
        rows[VELOCITY_VARIANCES, MANOEUVRE:] = variance
        weights = np.empty((MODES, len(positions)))
        weights[OBSTACLE] = obstacle
        weights[TEAMMATE] = _AT_BIRTH[:, None] * teammate
        return rows, weights


def by_motion(weights: FloatArray) -> FloatArray:
    """Weights (2, MOTIONS, n) of the Gaussians, from those of the modes: of all, of TEAMMATE."""
    return np.asarray((_OF_GAUSSIANS @ weights).reshape(2, MOTIONS, -1))


def moments(rows: FloatArray) -> FloatArray:
    """First and second moments of positions (5, MOTIONS, n), for `mixture`: x, y, xx, xy, yy."""
    places = rows.take(PLACE, axis=0)
    places[2:] += places.take((0, 0, 1), axis=0) * places.take((0, 1, 1), axis=0)
    return np.asarray(places)


def mixtures(of_motions: FloatArray, weights: FloatArray) -> FloatArray:
    """Positions of mixtures over all motions: (6, c, n), rows as in `gaussian_mixture`.

    of_motions: their `moments` (5, MOTIONS, n). weights (c, MOTIONS, n), for each of c mixtures.
    """
    total = weights.sum(axis=1)
    mixed = np.empty((6, *total.shape))
    shares = weights / np.maximum(total, 1e-300)[:, None]
    np.einsum("rkn,ckn->rcn", of_motions, shares, out=mixed[:5])
    mixed[2:5] -= mixed.take((0, 0, 1), axis=0) * mixed.take((0, 1, 1), axis=0)
    mixed[5] = total
    return mixed
