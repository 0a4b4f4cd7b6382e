"""Gaussians of position and velocity, as columns of one array, and their Kalman steps.

`rows` is (ROWS, ..., n): one column a Gaussian, one row a quantity, so that a step is a few numpy
calls whatever n is. The state is (x, y, vx, vy) in the robot's frame, the velocity that over the
floor. A covariance is kept as its ten distinct entries.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.messages import Displacement, FloatArray, IntArray

X, Y, VX, VY = range(4)  # m, m/s
PXX, PXY, PYY, PXVX, PXVY, PYVX, PYVY, PVXVX, PVXVY, PVYVY = range(4, 14)
ROWS = 14
PLACE = [X, Y, PXX, PXY, PYY]  # the rows of `gaussian_mixture` but for the weight
MEAN, COVARIANCE, VELOCITY = slice(0, 4), slice(4, 14), slice(2, 4)
VELOCITY_VARIANCES = slice(PVXVX, PVYVY + 1, PVYVY - PVXVX)
# Row and column of each distinct entry, and the entry of each row and column.
FIRST = np.array([0, 0, 1, 0, 0, 1, 1, 2, 2, 3])
SECOND = np.array([0, 1, 1, 2, 3, 2, 3, 2, 3, 3])
ENTRY = np.array([[0, 1, 3, 4], [1, 2, 5, 6], [3, 5, 7, 8], [4, 6, 8, 9]])
# P's columns of the position and of the velocity, and below each the mean.
_OF_POSITION = np.concatenate((PXX + ENTRY[:, :2], [[X, Y]])).T.copy()
_OF_VELOCITY = np.concatenate((PXX + ENTRY[:, 2:], [[VX, VY]])).T.copy()

# For P' = G P G^T: entry (a, b) of P' is the sum over entries (c, d) of G_ac G_bd + G_ad G_bc,
# once where c = d. Each is an index into the sixteen elements of G.
_AC = 4 * FIRST[:, None] + FIRST
_BD = 4 * SECOND[:, None] + SECOND
_AD = 4 * FIRST[:, None] + SECOND
_BC = 4 * SECOND[:, None] + FIRST
_MIXED = (FIRST != SECOND).astype(np.float64)


def congruence(matrices: FloatArray) -> FloatArray:
    """The matrices (k, 10, 10) that take the entries of P to those of G P G^T, for G (k, 4, 4)."""
    flat = matrices.reshape(-1, 16)
    straight = flat.take(_AC, axis=1) * flat.take(_BD, axis=1)
    return np.asarray(straight + _MIXED * flat.take(_AD, axis=1) * flat.take(_BC, axis=1))


def propagate(rows: FloatArray, transitions: FloatArray, noise: FloatArray) -> None:
    """Kalman prediction of Gaussians (ROWS, k, n), in place: m' = F m, P' = F P F^T + Q.

    transitions (k, 4, 4), noise (10, k): the entries of Q, one for each of the k motions.
    """
    by_motion = rows.transpose(1, 0, 2)
    by_motion[:, MEAN] = transitions @ by_motion[:, MEAN]
    by_motion[:, COVARIANCE] = congruence(transitions) @ by_motion[:, COVARIANCE]
    rows[COVARIANCE] += noise[:, :, None]


def add_odometry_noise(rows: FloatArray, motion: Displacement) -> None:
    """Widen Gaussians in the robot's new frame, in place, by the noise of its own motion.

    A heading error moves everything across the ray: along (-y, x), and velocities likewise.
    """
    rows[PXX] += motion.translation_variance
    rows[PYY] += motion.translation_variance
    lever = rows.take((Y, X, VY, VX), axis=0)
    lever[::2] *= -1.0
    spread = outer(lever)
    spread *= motion.heading_variance
    rows[COVARIANCE] += spread


def into_frame(motion: Displacement) -> FloatArray:
    """The matrix (4, 4) that rotates a state into the robot's new frame: R(dpsi)^T."""
    c, s = math.cos(motion.dpsi), math.sin(motion.dpsi)
    return np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, c, s], [0, 0, -s, c]])


def outer(vectors: FloatArray) -> FloatArray:
    """The distinct entries (10, ...) of v v^T, for vectors (4, ...)."""
    products = vectors.take(FIRST, axis=0)
    products *= vectors.take(SECOND, axis=0)
    return products


def places_then(rows: FloatArray, lags: FloatArray | float) -> FloatArray:
    """Positions (2, ..., n) of Gaussians `lags` s ago, at which a reading of them was made."""
    return np.asarray(rows[: Y + 1] - lags * rows[VELOCITY])


@dataclass(frozen=True, slots=True)
class Innovations:
    """What position readings say of Gaussians (ROWS, ..., p), one each.

    squares (..., p): nu^T S^-1 nu. likelihood (..., p): N(nu; 0, S), 1/m². steps (3, 4, ..., p):
    by how much the mean moves, and the two columns of P H^T L with S^-1 = L L^T.
    """

    squares: FloatArray
    likelihood: FloatArray
    steps: FloatArray

    def changes(self, chosen: IntArray) -> FloatArray:
        """By the update of those chosen (q,): (ROWS, ..., q), as `absorb` takes them."""
        moves, first, second = self.steps.take(chosen, axis=-1)
        lost = outer(first)
        lost += outer(second)
        lost -= outer(moves)
        return np.concatenate((moves, lost))


def innovations(
    rows: FloatArray, places: FloatArray, noise: FloatArray, lags: FloatArray | float
) -> Innovations:
    """Of position readings: H = [I, -lag I]; rows (ROWS, ..., p).

    places (2, ..., p) m, noise (p, 2, 2) m²; both made `lags` s ago.
    """
    crossed = rows.take(_OF_POSITION, axis=0)
    crossed -= lags * rows.take(_OF_VELOCITY, axis=0)
    (sxx, sxy), (_, syy) = crossed[:, :2] - lags * crossed[:, 2:4]
    sxx, sxy, syy = sxx + noise[:, 0, 0], sxy + noise[:, 0, 1], syy + noise[:, 1, 1]
    np.subtract(places, crossed[:, 4], out=crossed[:, 4])
    x, y = crossed  # of each the column of P H^T and, below it, nu
    slope = sxy / syy
    of_x, of_y = 1.0 / np.sqrt(sxx - slope * sxy), 1.0 / np.sqrt(syy)
    steps = np.empty((3, *x.shape))
    both, first, second = steps
    np.multiply(x - slope * y, of_x, out=first)
    np.multiply(y, of_y, out=second)
    np.multiply(first, first[4], out=both)
    both += second * second[4]
    squares = both[4]  # nu^T L L^T nu
    likelihood = np.exp(-0.5 * squares) * (of_x * of_y * (0.5 / math.pi))
    return Innovations(squares, likelihood, steps[:, :4])


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


def change(before: FloatArray, after: FloatArray) -> FloatArray:
    """The change (ROWS, ...) from one Gaussian to another, as `absorb` takes it."""
    by = after - before
    by[COVARIANCE] = -by[COVARIANCE] - outer(by[MEAN])
    return np.asarray(by)


def absorb(rows: FloatArray, changes: FloatArray, into: IntArray, shares: FloatArray) -> None:
    """Gaussians (ROWS, k, n) become what they may have become, matched in moments, in place.

    changes (ROWS, k, p): the Gaussian `into` (p,) moves by nu' and loses (P - P') - nu' nu'^T, with
    the probability `shares` (k, p); with what is left of 1 it stays. (The update of probabilistic
    data association: Bar-Shalom, Willett & Tian 2011, section 3.4.2.)
    """
    sums = summed(shares * changes, into, rows.shape[2])
    rows[MEAN] += sums[MEAN]
    rows[COVARIANCE] -= sums[COVARIANCE] + outer(sums[MEAN])


def summed(values: FloatArray, into: IntArray, n: int) -> FloatArray:
    """The sums (..., n) of the values (..., p) that go into each of n."""
    flat = values.reshape(math.prod(values.shape[:-1]), len(into))
    bins = into + n * np.arange(len(flat))[:, None]
    sums = np.bincount(bins.ravel(), flat.ravel(), n * len(flat))
    return np.asarray(sums.reshape(*values.shape[:-1], n))


def mix(rows: FloatArray, shares: FloatArray) -> FloatArray:
    """Gaussians (ROWS, k, n) as mixtures of them: shares (k, k, n), from the first to the second.

    Interaction of Blom & Bar-Shalom 1988; moments are taken about the last of the k, so that
    nothing is lost to cancellation.
    """
    sums, centres = rows.copy(), rows[: Y + 1, -1:]
    sums[: Y + 1] -= centres
    sums[COVARIANCE] += outer(sums[MEAN])
    mixed = np.einsum("rin,ijn->rjn", sums, shares)
    mixed[COVARIANCE] -= outer(mixed[MEAN])
    mixed[: Y + 1] += centres
    return np.asarray(mixed)
