"""How a teammate drives: modes of motion that it switches between, and Kalman steps under all.

The interacting multiple model (IMM) algorithm of Blom and Bar-Shalom, "The interacting multiple
model algorithm for systems with Markovian switching coefficients", IEEE Trans. Automatic Control
33(8), 1988. The state is x, y (m), vx, vy (m/s) in the robot's frame. n teammates under k modes are
means (n, k, 4), covariances (n, k, 4, 4) and the shares (n, k) of the modes.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from host.geometry import into_new_frame
from host.messages import BoolArray, Displacement, FloatArray


@dataclass(frozen=True, slots=True)
class MotionModes:
    """Modes of motion: in each, velocity fades with a correlation time and is driven by noise.

    accelerations (k,) m²/s³: power spectral density of the noise, per axis. correlations_s (k,):
    0 for a mode that stands still. rates (k, k) 1/s: of switching from the row's mode to the
    column's; the diagonal does not count. shares (k,): of the modes when a teammate is first seen.
    speed_mps: standard deviation of the velocity then and after standing, per axis. drift
    m²/s: random walk of the position, whatever the mode.
    """

    accelerations: tuple[float, ...]
    correlations_s: tuple[float, ...]
    rates: tuple[tuple[float, ...], ...]
    shares: tuple[float, ...]
    speed_mps: float
    drift: float

    @property
    def moving(self) -> FloatArray:
        """1 for each mode (k,) that moves, 0 for one that stands still."""
        return np.array([float(seconds > 0.0) for seconds in self.correlations_s])

    def switching(self, dt: float) -> FloatArray:
        """Probabilities (k, k) of being in the column's mode dt seconds after the row's."""
        rates = np.array(self.rates)
        np.fill_diagonal(rates, 0.0)
        np.fill_diagonal(rates, -rates.sum(axis=1))
        return np.asarray(expm(rates * dt))

    def dynamics(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """F and Q (k, 4, 4) of dt seconds: the integrated Ornstein-Uhlenbeck process.

        A mode that stands still keeps its position; its velocity is the one with which it may
        start at any time, independent of what it was.
        """
        still, q = 1.0 - self.moving, np.array(self.accelerations)
        tau = np.maximum(np.array(self.correlations_s), 1e-9)
        kept, moved = np.exp(-dt / tau), -tau * np.expm1(-dt / tau)
        forgotten = -0.5 * tau * np.expm1(-2.0 * dt / tau)
        of_position = q * tau**2 * (dt - 2.0 * moved + forgotten)
        of_velocity = q * forgotten + still * self.speed_mps**2
        of_both = 0.5 * q * moved**2
        plane, one = np.eye(2), np.ones_like(kept)
        transition = np.kron(_matrices(one, moved, 0.0 * one, kept), plane)
        noise = _matrices(of_position + self.drift * dt, of_both, of_both, of_velocity)
        return np.asarray(transition), np.asarray(np.kron(noise, plane))


def _matrices(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """((a, b), (c, d)) for each mode: (k, 2, 2)."""
    return np.stack((a, b, c, d), axis=1).reshape(-1, 2, 2)


class MovingTeammates:
    """Teammates that switch between modes of motion, in the robot's frame."""

    def __init__(self, modes: MotionModes) -> None:
        self._modes = modes
        count = len(modes.shares)
        self._means = np.zeros((0, count, 4))
        self._covariances = np.zeros((0, count, 4, 4))
        self._shares = np.zeros((0, count))

    def keep(self, kept: BoolArray) -> None:
        """Forget the others; kept (n,)."""
        self._means, self._covariances = self._means[kept], self._covariances[kept]
        self._shares = self._shares[kept]

    def begin(self, position: FloatArray, covariance: FloatArray, lag: float) -> None:
        """A new teammate that was at `position` (2,) m `lag` seconds ago; it comes last."""
        modes = self._modes
        velocity = modes.speed_mps**2 * np.eye(2)
        since = (lag * modes.moving)[:, None, None]
        covariances = np.zeros((len(modes.shares), 4, 4))
        covariances[:, :2, :2] = covariance + since**2 * velocity + lag * modes.drift * np.eye(2)
        covariances[:, :2, 2:] = covariances[:, 2:, :2] = since * velocity
        covariances[:, 2:, 2:] = velocity
        means = np.zeros((len(modes.shares), 4))
        means[:, :2] = position
        self._means = np.concatenate((self._means, means[None]))
        self._covariances = np.concatenate((self._covariances, covariances[None]))
        self._shares = np.concatenate((self._shares, np.array(modes.shares)[None]))

    def predict(self, motion: Displacement) -> None:
        """Mix the modes, let every teammate move, and go into the robot's new frame."""
        self._mix(self._modes.switching(motion.interval))
        transition, noise = self._modes.dynamics(motion.interval)
        means = (transition @ self._means[..., None])[..., 0]
        covariances = transition @ self._covariances @ transition.swapaxes(1, 2) + noise
        self._means, self._covariances = into_new_frame(means, covariances, motion)

    def _mix(self, switching: FloatArray) -> None:
        """Start each mode with the moments of all that may have led to it (IMM, step 1)."""
        joint = self._shares[:, :, None] * switching
        self._shares = joint.sum(axis=1)
        share = joint / np.maximum(self._shares, 1e-300)[:, None]
        means = np.einsum("nij,nia->nja", share, self._means)
        off = self._means[:, :, None] - means[:, None]
        self._covariances = np.einsum("nij,niab->njab", share, self._covariances)
        self._covariances += np.einsum("nij,nija,nijb->njab", share, off, off)
        self._means = means

    def positions_before(self, teammate: int, lag: float) -> tuple[FloatArray, FloatArray]:
        """Where each mode has a teammate `lag` seconds ago: (k, 2) m, and its H (k, 2, 4)."""
        since = lag * self._modes.moving
        jacobian = np.kron(np.stack((np.ones_like(since), -since), axis=1)[:, None], np.eye(2))
        positions = jacobian @ self._means[teammate][..., None]
        return np.asarray(positions[..., 0]), np.asarray(jacobian)

    def update(
        self, teammate: int, innovation: FloatArray, jacobian: FloatArray, noise: FloatArray
    ) -> None:
        """Kalman update of every mode of one teammate, and of their shares (IMM, steps 2 and 3).

        innovation (k, m), jacobian H (k, m, 4), noise R (m, m).
        """
        prior, transposed = self._covariances[teammate], jacobian.swapaxes(1, 2)
        spread = jacobian @ prior @ transposed + noise  # S
        gain = np.linalg.solve(spread, jacobian @ prior).swapaxes(1, 2)
        self._means[teammate] += (gain @ innovation[..., None])[..., 0]
        posterior = prior - gain @ spread @ gain.swapaxes(1, 2)
        self._covariances[teammate] = 0.5 * (posterior + posterior.swapaxes(1, 2))
        square = np.sum(innovation * np.linalg.solve(spread, innovation[..., None])[..., 0], axis=1)
        logarithm = -0.5 * (square + np.log(np.linalg.det(spread)))
        logarithm += np.log(np.maximum(self._shares[teammate], 1e-300))
        share = np.exp(logarithm - logarithm.max())
        self._shares[teammate] = share / share.sum()

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Positions (n, 2) m and their covariances (n, 2, 2) m² over all modes (IMM, step 4)."""
        positions = np.einsum("ni,nia->na", self._shares, self._means[..., :2])
        off = self._means[..., :2] - positions[:, None]
        covariances = np.einsum("ni,niab->nab", self._shares, self._covariances[..., :2, :2])
        covariances += np.einsum("ni,nia,nib->nab", self._shares, off, off)
        return np.asarray(positions), np.asarray(covariances)
