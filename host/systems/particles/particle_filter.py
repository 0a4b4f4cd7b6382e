"""The particle filter of Lee 2012, section III, for the place of one thing.

The paper takes its state and likelihood (eq. 3-6) from the recognition of hand gestures; a thing
that moves has position and velocity, and a distance is Gaussian: the square and the sigma that
eq. 6 lacks are there. What is his: a damped constant velocity, resampling 90 % of the particles by
weight and spreading the others again, diffusion, and a bounding box to start from.
"""

from dataclasses import dataclass

import numpy as np

from host.messages import FloatArray
from host.systems.particles.start import bounding_box

_WIDER_M = 0.5  # than the bounding box, each way: where particles are spread


@dataclass(frozen=True, slots=True)
class ParticleSettings:
    """count: particles. resampled: share chosen by weight, the others are spread again.

    speed_mps: typical. settle_s: over which a velocity is forgotten. outlier: share of distances
    that have nothing to do with it.
    """

    count: int = 1000
    resampled: float = 0.9
    speed_mps: float = 0.15
    settle_s: float = 5.0
    outlier: float = 0.02


class ParticleFilter:
    """Position and velocity of one thing as particles (n, 4): x, y m, and their rates m/s."""

    def __init__(self, settings: ParticleSettings, seed: int = 0) -> None:
        self._settings = settings
        self._random = np.random.default_rng(seed)
        self._particles = np.zeros((0, 4))
        self._weights = np.zeros(0)

    @property
    def position(self) -> FloatArray:
        """The mean (2,) m."""
        return np.asarray(self._weights @ self._particles[:, :2])

    @property
    def covariance(self) -> FloatArray:
        """Of the position, (2, 2) m²."""
        left = self._particles[:, :2] - self.position
        return np.asarray((self._weights[:, None] * left).T @ left)

    def step(
        self, interval: float, places: FloatArray, ranges: FloatArray, sigma: float
    ) -> FloatArray:
        """Take in ranges (n,) m with `sigma` m, measured by robots at places (n, 2) m.

        interval s: since the step before. The position (2,) m that follows.
        """
        low, high = bounding_box(places, ranges)
        low, high = low - _WIDER_M, high + _WIDER_M
        if not len(self._particles):
            self._particles = self._spread(self._settings.count, low, high)
        else:
            self._drift_and_diffuse(interval)
            self._replace_some(low, high)
        self._weigh(places, ranges, sigma)
        position = self.position
        self._resample()
        return position

    def _spread(self, count: int, low: FloatArray, high: FloatArray) -> FloatArray:
        places = self._random.uniform(low, high, (count, 2))
        return np.hstack((places, self._random.normal(0.0, self._settings.speed_mps, (count, 2))))

    def _drift_and_diffuse(self, interval: float) -> None:
        """Steps 1 and 4: velocities settle, and are renewed so that their spread stays."""
        kept = float(np.exp(-interval / self._settings.settle_s))
        velocity = self._particles[:, 2:]
        renewed = self._settings.speed_mps * np.sqrt(1.0 - kept**2)
        self._particles[:, :2] += interval * velocity
        self._particles[:, 2:] = kept * velocity + self._random.normal(0.0, renewed, velocity.shape)

    def _replace_some(self, low: FloatArray, high: FloatArray) -> None:
        """The other 10 % of step 3: where they have been wrong, these find it again."""
        count = round((1.0 - self._settings.resampled) * len(self._particles))
        if count:
            self._particles[-count:] = self._spread(count, low, high)

    def _weigh(self, places: FloatArray, ranges: FloatArray, sigma: float) -> None:
        """Step 2, eq. 5-6: each distance is Gaussian, or nothing but an outlier."""
        arms = self._particles[:, None, :2] - places
        errors = (np.hypot(arms[..., 0], arms[..., 1]) - ranges) / sigma
        outlier = self._settings.outlier
        fit = np.logaddexp(np.log1p(-outlier) - errors**2 / 2.0, np.log(max(outlier, 1e-300)) - 4.5)
        total = fit.sum(axis=1)
        weights = np.exp(total - total.max())
        self._weights = weights / weights.sum()

    def _resample(self) -> None:
        """Step 3, systematically: one random number, so that equal weights keep every particle."""
        count = len(self._particles)
        ladder = (np.arange(count) + self._random.uniform()) / count
        chosen = np.searchsorted(np.cumsum(self._weights), ladder)
        self._particles = self._particles[self._random.permutation(np.minimum(chosen, count - 1))]
        self._weights = np.full(count, 1.0 / count)
