"""Gaussians of position and velocity, as columns of one array, and their Kalman steps.

`rows` is (ROWS, ..., n): one column a Gaussian, one row a quantity, so that a step is a few numpy
calls whatever n is. The state is (x, y, vx, vy) in the robot's frame, the velocity that over the
floor. A covariance is kept as its ten distinct entries.
"""

import math

import numpy as np

from host.messages import Displacement, FloatArray, IntArray

X, Y, VX, VY = range(4)  # m, m/s
PXX, PXY, PYY, PXVX, PXVY, PYVX, PYVY, PVXVX, PVXVY, PVYVY = range(4, 14)
WEIGHT = 14
ROWS = 15
MEAN, COVARIANCE, VELOCITY = slice(0, 4), slice(4, 14), slice(2, 4)
# Row and column of each distinct entry, and the entry of each row and column.
FIRST = np.array([0, 0, 1, 0, 0, 1, 1, 2, 2, 3])
SECOND = np.array([0, 1, 1, 2, 3, 2, 3, 2, 3, 3])
ENTRY = np.array([[0, 1, 3, 4], [1, 2, 5, 6], [3, 5, 7, 8], [4, 6, 8, 9]])

# For P' = G P G^T: entry (a, b) of P' is the sum over entries (c, d) of G_ac G_bd + G_ad G_bc,
# once where c = d. Each is an index into the sixteen elements of G.
_AC = 4 * FIRST[:, None] + FIRST
_BD = 4 * SECOND[:, None] + SECOND
_AD = 4 * FIRST[:, None] + SECOND
_BC = 4 * SECOND[:, None] + FIRST
_MIXED = (FIRST != SECOND).astype(np.float64)

_LEAST_WEIGHT = 1e-20  # keeps the moments of a mode that is ruled out finite


def congruence(matrices: FloatArray) -> FloatArray:
    """The matrices (k, 10, 10) that take the entries of P to those of G P G^T, for G (k, 4, 4)."""
    flat = matrices.reshape(-1, 16)
    straight = flat.take(_AC, axis=1) * flat.take(_BD, axis=1)
    return np.asarray(straight + _MIXED * flat.take(_AD, axis=1) * flat.take(_BC, axis=1))


def propagate(rows: FloatArray, transitions: FloatArray, noise: FloatArray) -> None:
    """Kalman prediction of Gaussians (ROWS, k, n), in place: m' = F m, P' = F P F^T + Q.

    transitions (k, 4, 4), noise (10, k): the entries of Q, one for each of the k modes.
    """
    by_mode = rows.transpose(1, 0, 2)
    by_mode[:, MEAN] = transitions @ by_mode[:, MEAN]
    by_mode[:, COVARIANCE] = congruence(transitions) @ by_mode[:, COVARIANCE]
    rows[COVARIANCE] += noise[:, :, None]


def add_odometry_noise(rows: FloatArray, motion: Displacement) -> None:
    """Widen Gaussians in the robot's new frame, in place, by the noise of its own motion.

    A heading error moves everything across the ray: along (-y, x), and velocities likewise.
    """
    rows[PXX] += motion.translation_variance
    rows[PYY] += motion.translation_variance
    lever = rows.take((Y, X, VY, VX), axis=0)
    lever[::2] *= -1.0
    rows[COVARIANCE] += motion.heading_variance * lever.take(FIRST, 0) * lever.take(SECOND, 0)


def into_frame(motion: Displacement) -> FloatArray:
    """The matrix (4, 4) that rotates a state into the robot's new frame: R(dpsi)^T."""
    c, s = math.cos(motion.dpsi), math.sin(motion.dpsi)
    return np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, c, s], [0, 0, -s, c]])


def places_then(rows: FloatArray, lags: FloatArray | float) -> FloatArray:
    """Positions (2, ..., n) of Gaussians `lags` s ago, at which a reading of them was made."""
    return np.asarray(rows[: Y + 1] - lags * rows[VELOCITY])


def update_along(
    rows: FloatArray,
    directions: FloatArray,
    innovations: FloatArray,
    variances: FloatArray,
    lags: FloatArray | float,
    share: FloatArray | float = 1.0,
) -> FloatArray:
    """Kalman update by one scalar reading of the position along a direction, in place.

    rows (ROWS, ..., p); directions u (2, ..., p) of length 1; innovations in m, their readings made
    `lags` s ago: H = (u, -lag u). share: of independent evidence in a reading; the Gaussian is
    moved as by one of variance / share. Returns N(innovation; 0, S) (..., p) of the whole reading,
    1/m.
    """
    h = np.concatenate((directions, -lags * directions))
    entries = rows[COVARIANCE]
    gain = (entries.take(ENTRY, axis=0) * h).sum(axis=1)
    own = (gain * h).sum(axis=0)
    spread = own + variances
    scaled = gain / (own + variances / share)
    rows[MEAN] += scaled * innovations
    entries -= scaled.take(FIRST, axis=0) * gain.take(SECOND, axis=0)
    density = np.exp(-0.5 * innovations * innovations / spread)
    return np.asarray(density / np.sqrt(2.0 * math.pi * spread))


def moments(rows: FloatArray, centres: FloatArray) -> FloatArray:
    """Weight, first and second moments of Gaussians (ROWS, ..., n), about centres (2, n) m.

    Moments of mixtures add up; the centres lie near the Gaussians, so that nothing is lost to
    cancellation.
    """
    sums = rows.copy()
    sums[: Y + 1] -= centres
    mean = sums[MEAN]
    sums[COVARIANCE] += mean.take(FIRST, axis=0) * mean.take(SECOND, axis=0)
    sums[WEIGHT] = np.maximum(sums[WEIGHT], _LEAST_WEIGHT)
    sums[:WEIGHT] *= sums[WEIGHT]
    return sums


def from_moments(sums: FloatArray, centres: FloatArray) -> FloatArray:
    """The Gaussians (ROWS, ..., n) of these moments: the inverse of `moments`; overwrites them."""
    sums[:WEIGHT] /= sums[WEIGHT]
    mean = sums[MEAN]
    sums[COVARIANCE] -= mean.take(FIRST, axis=0) * mean.take(SECOND, axis=0)
    sums[: Y + 1] += centres
    return sums


def match_moments(rows: FloatArray, into: IntArray, centres: FloatArray) -> FloatArray:
    """Merge Gaussians (ROWS, ..., N) into k of the same weight, mean and covariance.

    into (N,): which one each goes to; centres (2, k) m: a point near those that go to each.
    """
    k = centres.shape[1]
    sums = moments(rows, centres.take(into, axis=1)[:, None])
    flat = sums.reshape(math.prod(sums.shape[:-1]), len(into))
    bins = into + k * np.arange(len(flat))[:, None]
    totals = np.bincount(bins.ravel(), flat.ravel(), k * len(flat))
    merged = np.asarray(totals, dtype=np.float64).reshape(*rows.shape[:-1], k)
    return from_moments(merged, centres[:, None])
