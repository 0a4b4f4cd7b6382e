"""What the errors of strips are made of, and how they are made independent of each other.

Motion capture's noise in the heading of the robot's own body, and an exposure's error of time while
the robot rotates, move all strips seen at one instant, in both cameras, by one angle. For strips
of one instant that is most of their error; taken for independent, it hides how exactly the strips
lie relative to each other.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.model import Pairs, errors, rotated
from host.calibration.robust.statistics import block_sums, normal_sigma, plane_sigma
from host.messages import BoolArray, FloatArray

_LEAST_STRIP = 0.03
_LEAST_INSTANTS = 12  # with more than one strip, to measure what these have in common


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of strips' errors.

    strip: of each by itself, in units of the pairs' sigmas. rotation_rad: of the angle that all
    strips of one instant have in common.
    """

    strip: float
    rotation_rad: float = 0.0

    def of_each(self, values: FloatArray, pairs: Pairs) -> FloatArray:
        """Standard deviations (n,) of both together, in units of the pairs' sigmas."""
        moved = np.hypot(*rotated(values, pairs).T) / pairs.sigmas
        return np.asarray(np.hypot(self.strip, self.rotation_rad * moved))


class Whitening:
    """Makes errors of the strips `used` (n,) independent of each other, with a variance of 1.

    With the strips' own noise divided out, the errors of an instant have the covariance I + h h',
    where h is what one standard deviation of the common rotation changes in them. Its inverse root
    is I - (1 - 1 / sqrt(1 + |h|^2)) h h' / |h|^2.
    """

    def __init__(self, values: FloatArray, pairs: Pairs, used: BoolArray, noise: Noise) -> None:
        self._scale = noise.strip * pairs.sigmas[used]
        turned = rotated(values, pairs)[used] / self._scale[:, None]
        self._instants = np.unique(pairs.strips.times[used], return_inverse=True)[1].reshape(-1)
        # Of a whole instant: radians by one radian's worth of information.
        self._information = block_sums(np.sum(turned**2, axis=1), self._instants)
        squared = noise.rotation_rad**2 * self._information
        self._share = (1.0 - 1.0 / np.sqrt(1.0 + squared)) / self._information
        self._turned = turned

    def __call__(self, rows: FloatArray) -> FloatArray:
        """Errors (k, 2) of the k strips used, or their derivatives (k, 2, p), made independent."""
        scaled = (rows.T / self._scale).T
        common = self._angles(scaled) * self._share.reshape(-1, *[1] * (rows.ndim - 2))
        return np.asarray(
            scaled - np.einsum("ni,n...->ni...", self._turned, common[self._instants])
        )

    def _angles(self, scaled: FloatArray) -> FloatArray:
        return block_sums(np.einsum("ni,ni...->n...", self._turned, scaled), self._instants)

    def rotation_sigma(self, off: FloatArray) -> float:
        """Std (rad) of the common rotation by errors (k, 2), in instants with more than one strip.

        What their angles scatter about a common one, alone, moves it too.
        """
        count = np.bincount(self._instants)
        many = count > 1
        if np.count_nonzero(many) < _LEAST_INSTANTS:
            return 0.0
        scaled = (off.T / self._scale).T
        angles = self._angles(scaled) / self._information
        apart = scaled - self._turned * angles[self._instants][:, None]
        along = np.einsum("ni,ni->n", self._turned, apart) / np.hypot(*self._turned.T)
        along *= np.sqrt(count / np.maximum(count - 1.0, 1.0))[self._instants]
        own = normal_sigma(along[many[self._instants]]) ** 2 / self._information[many]
        return math.sqrt(max(normal_sigma(angles[many]) ** 2 - float(np.median(own)), 0.0))


def measured(
    values: FloatArray, pairs: Pairs, used: BoolArray, free: BoolArray, before: Noise
) -> Noise:
    """The noise of the pairs `used` (n,), to which the values `free` (p,) are fitted."""
    off = errors(values, pairs)[used]
    fitted = np.count_nonzero(free)
    # Each value fitted takes a little of the noise with it.
    left = max(2.0 * len(off) - fitted, 0.5 * len(off)) / (2.0 * len(off))
    lengths = np.hypot(*Whitening(values, pairs, used, before)(off).T)
    strip = max(before.strip * plane_sigma(lengths) / math.sqrt(left), _LEAST_STRIP)
    alone = Noise(strip)
    return Noise(strip, Whitening(values, pairs, used, alone).rotation_sigma(off))
