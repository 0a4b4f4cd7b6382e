"""What the errors of strips are made of, and how they are made independent of each other.

Motion capture's noise in the heading of the robot's own body, and an exposure's error of time while
the robot rotates, move all strips seen at one instant, in both cameras, by one angle. For strips
of one instant that is most of their error; taken for independent, it hides how exactly the strips
lie relative to each other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.model import Pairs, errors, off_by, rotated
from host.calibration.robust.statistics import block_sums, normal_sigma, plane_sigma
from host.messages import BoolArray, FloatArray

GATE_SIGMAS = 4.0  # of a pair that is right
_LEAST_STRIP = 0.03
_LEAST_INSTANTS = 12  # with more than one strip, to measure what these have in common

Weighing = Callable[[FloatArray], FloatArray]  # of errors (k, 2) and of their derivatives


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
        self._by_rotation = rotated(values, pairs)[used] / self._scale[:, None]
        self._instants = np.unique(pairs.strips.times[used], return_inverse=True)[1].reshape(-1)
        # On the common rotation of each instant, 1/rad².
        known = block_sums(np.sum(self._by_rotation**2, axis=1), self._instants)
        self._information = np.maximum(known, 1e-12)
        squared = noise.rotation_rad**2 * self._information
        self._share = (1.0 - 1.0 / np.sqrt(1.0 + squared)) / self._information

    def __call__(self, rows: FloatArray) -> FloatArray:
        """Errors (k, 2) of the k strips used, or their derivatives (k, 2, p), made independent."""
        scaled = (rows.T / self._scale).T
        common = self._angles(scaled) * self._share.reshape(-1, *[1] * (rows.ndim - 2))
        return np.asarray(
            scaled - np.einsum("ni,n...->ni...", self._by_rotation, common[self._instants])
        )

    def _angles(self, scaled: FloatArray) -> FloatArray:
        return block_sums(np.einsum("ni,ni...->n...", self._by_rotation, scaled), self._instants)

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
        apart = scaled - self._by_rotation * angles[self._instants][:, None]
        along = np.einsum("ni,ni->n", self._by_rotation, apart) / np.hypot(*self._by_rotation.T)
        along *= np.sqrt(count / np.maximum(count - 1.0, 1.0))[self._instants]
        own = normal_sigma(along[many[self._instants]]) ** 2 / self._information[many]
        return math.sqrt(max(normal_sigma(angles[many]) ** 2 - float(np.median(own)), 0.0))


def likely(values: FloatArray, pairs: Pairs, noise: Noise) -> BoolArray:
    """Which pairs (n,) are right: by themselves, then relative to the others of their instant.

    A strip that is hidden in part may be off by less than the rotation that all have in common.
    """
    near = off_by(values, pairs) < GATE_SIGMAS * noise.of_each(values, pairs)
    used = np.asarray(pairs.paired & near)
    off = Whitening(values, pairs, used, noise)(errors(values, pairs)[used])
    used[used] = np.hypot(*off.T) < GATE_SIGMAS
    return used


def softened(values: FloatArray, pairs: Pairs, gate: float) -> tuple[BoolArray, Weighing]:
    """Which pairs (n,) are off by less than `gate` of their sigmas, and Cauchy's weights of these.

    For a fit that is not near yet.
    """
    soft, off = gate / GATE_SIGMAS, off_by(values, pairs)
    used = np.asarray(pairs.paired & (off < gate))
    scale = soft * np.sqrt(1.0 + (off / soft) ** 2)[used] * pairs.sigmas[used]
    return used, lambda rows: np.asarray((rows.T / scale).T)


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
    return Noise(strip, Whitening(values, pairs, used, Noise(strip)).rotation_sigma(off))
