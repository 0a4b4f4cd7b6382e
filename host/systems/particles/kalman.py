"""The extended Kalman filter that Lee 2012 holds the particles against, on the same distances.

Distances that cannot be right are left out; where most are, it has lost the thing and restarts.
"""

import numpy as np

from host.messages import FloatArray
from host.systems.particles.particle_filter import ParticleSettings
from host.systems.particles.start import trilaterate

_START_SIGMA_M = 0.5
_GATE = 9.0
_LOST_STEPS = 3  # in a row in which fewer than half of the distances fit


class RangeKalman:
    """Position and velocity (4,) of one thing; same model of motion as the particles."""

    def __init__(self, start: FloatArray, settings: ParticleSettings) -> None:
        self._settings = settings
        self._misfits = 0
        self._start(start)

    def _start(self, position: FloatArray) -> None:
        self._state = np.array([*position, 0.0, 0.0])
        spread = (_START_SIGMA_M**2, self._settings.speed_mps**2)
        self._covariance = np.diag(np.repeat(spread, 2))

    def step(
        self, interval: float, places: FloatArray, ranges: FloatArray, sigma: float
    ) -> FloatArray:
        """As `ParticleFilter.step`."""
        kept = float(np.exp(-interval / self._settings.settle_s))
        move = np.eye(4)
        move[0, 2] = move[1, 3] = interval
        move[2, 2] = move[3, 3] = kept
        noise = np.diag(np.repeat((0.0, self._settings.speed_mps**2 * (1.0 - kept**2)), 2))
        self._state = move @ self._state
        self._covariance = move @ self._covariance @ move.T + noise
        pairs = zip(places, ranges, strict=True)
        fitting = sum(self._take(place, float(distance), sigma) for place, distance in pairs)
        self._misfits = self._misfits + 1 if 2 * fitting < len(ranges) else 0
        found = trilaterate(places, ranges) if self._misfits == _LOST_STEPS else None
        if found is not None:
            self._start(found)
            self._misfits = 0
        return self._state[:2].copy()

    def _take(self, place: FloatArray, distance: float, sigma: float) -> bool:
        arm = self._state[:2] - place
        expected = max(float(np.hypot(*arm)), 1e-6)
        slope = np.array([*(arm / expected), 0.0, 0.0])
        gain = self._covariance @ slope
        spread = float(slope @ gain) + sigma**2
        if (distance - expected) ** 2 > _GATE * spread:
            return False
        self._state = self._state + gain * (distance - expected) / spread
        self._covariance = self._covariance - np.outer(gain, gain) / spread
        return True
