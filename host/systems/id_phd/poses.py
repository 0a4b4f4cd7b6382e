"""Gaussians over a teammate's pose in the observer's frame, moved by what its odometry reports.

A state has x, y (m), heading (rad), and three gains: true for reported distance and rotation of the
teammate, and rotation of the observer. Stegagno's x_i (section IV) is the first three.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.geometry import wrap
from host.messages import BoolArray, Displacement, FloatArray, IntArray

SIZE = 6
_X, _Y, _HEADING, _DISTANCE, _ROTATION, _OWN = range(SIZE)


@dataclass(frozen=True, slots=True)
class Poses:
    """k Gaussians: means (k, 6), covariances (k, 6, 6)."""

    means: FloatArray
    covariances: FloatArray

    def __len__(self) -> int:
        return len(self.means)

    def take(self, rows: IntArray) -> "Poses":
        """Those of `rows`."""
        return Poses(self.means[rows], self.covariances[rows])


def no_poses() -> Poses:
    """None at all."""
    return Poses(np.zeros((0, SIZE)), np.zeros((0, SIZE, SIZE)))


def joined(parts: list[Poses]) -> Poses:
    """All of them, in order."""
    means = np.concatenate([part.means for part in parts])
    return Poses(means, np.concatenate([part.covariances for part in parts]))


def born(
    position: FloatArray, covariance: FloatArray, headings: int, gain_sigmas: FloatArray
) -> Poses:
    """At a reading (2,), (2, 2), in each of `headings` directions all around: the bank.

    gain_sigmas (3,): of the gains, around 1.
    """
    means = np.ones((headings, SIZE))
    means[:, :2] = position
    means[:, _HEADING] = (np.arange(headings) + 0.5) * (2.0 * math.pi / headings) - math.pi
    covariances = np.zeros((headings, SIZE, SIZE))
    covariances[:, :2, :2] = covariance
    # Of a uniform density over the bank's spacing; a little more, so that they overlap.
    covariances[:, _HEADING, _HEADING] = (2.0 * math.pi / headings) ** 2 / 6.0
    gains = np.arange(_DISTANCE, SIZE)
    covariances[:, gains, gains] = np.square(gain_sigmas)
    return Poses(means, covariances)


def moved(poses: Poses, steps: FloatArray) -> Poses:
    """The teammates' part of eq. 18 and 19. steps (k, 5): dq_i of each one's odometry.

    A step is dx, dy, dpsi, and the variances of translation and heading.
    """
    x, y, heading, distance, rotation, _ = poses.means.T
    dx, dy, dpsi, translation, turning = steps.T
    chord = heading + (rotation - 1.0) * dpsi / 2.0
    c, s = np.cos(chord), np.sin(chord)
    along, across = c * dx - s * dy, s * dx + c * dy
    means = poses.means.copy()
    means[:, _X], means[:, _Y] = x + distance * along, y + distance * across
    means[:, _HEADING] = heading + rotation * dpsi
    slope = np.tile(np.eye(SIZE), (len(poses), 1, 1))
    slope[:, _X, _HEADING], slope[:, _Y, _HEADING] = -distance * across, distance * along
    slope[:, _X, _DISTANCE], slope[:, _Y, _DISTANCE] = along, across
    slope[:, :2, _ROTATION] = slope[:, :2, _HEADING] * (dpsi / 2.0)[:, None]
    slope[:, _HEADING, _ROTATION] = dpsi
    covariances = slope @ poses.covariances @ np.swapaxes(slope, 1, 2)
    covariances[:, _X, _X] += translation
    covariances[:, _Y, _Y] += translation
    covariances[:, _HEADING, _HEADING] += turning
    return Poses(means, covariances)


def seen_after(poses: Poses, own: Displacement) -> Poses:
    """The observer's part of eq. 18 and 19: the same poses once it has moved by `own` (dq_0)."""
    angle = poses.means[:, _OWN] * own.dpsi
    c, s = np.cos(angle), np.sin(angle)
    x, y = poses.means[:, _X] - own.dx, poses.means[:, _Y] - own.dy
    means = poses.means.copy()
    means[:, _X], means[:, _Y] = c * x + s * y, c * y - s * x
    means[:, _HEADING] -= angle
    slope = np.tile(np.eye(SIZE), (len(poses), 1, 1))
    slope[:, _X, _X] = slope[:, _Y, _Y] = c
    slope[:, _X, _Y], slope[:, _Y, _X] = s, -s
    by_angle = np.zeros((len(poses), SIZE))
    by_angle[:, _X], by_angle[:, _Y], by_angle[:, _HEADING] = means[:, _Y], -means[:, _X], -1.0
    slope[:, :, _OWN] += by_angle * own.dpsi
    covariances = slope @ poses.covariances @ np.swapaxes(slope, 1, 2)
    covariances += own.heading_variance * by_angle[:, :, None] * by_angle[:, None, :]
    covariances[:, _X, _X] += own.translation_variance
    covariances[:, _Y, _Y] += own.translation_variance
    return Poses(means, covariances)


def log_likelihoods(poses: Poses, positions: FloatArray, covariances: FloatArray) -> FloatArray:
    """log g(z | x) of eq. 12, (k, m), of readings (m, 2), (m, 2, 2): Gaussian in z - Hx."""
    innovation = positions - poses.means[:, None, :2]
    spread = poses.covariances[:, None, :2, :2] + covariances
    xx, yy, xy = spread[..., 0, 0], spread[..., 1, 1], spread[..., 0, 1]
    determinant = xx * yy - xy**2
    dx, dy = innovation[..., 0], innovation[..., 1]
    squared = (yy * dx**2 - 2.0 * xy * dx * dy + xx * dy**2) / determinant
    return np.asarray(-0.5 * (squared + np.log(determinant)) - math.log(2.0 * math.pi))


def updated(poses: Poses, positions: FloatArray, covariances: FloatArray) -> Poses:
    """Each pose after its own reading, (k, 2) and (k, 2, 2): eq. 20 and 21."""
    cross = poses.covariances[:, :, :2]
    spread = poses.covariances[:, :2, :2] + covariances
    gain = np.swapaxes(np.linalg.solve(spread, np.swapaxes(cross, 1, 2)), 1, 2)
    innovation = positions - poses.means[:, :2]
    means = poses.means + np.einsum("kab,kb->ka", gain, innovation)
    after = poses.covariances - gain @ np.swapaxes(cross, 1, 2)
    return Poses(means, (after + np.swapaxes(after, 1, 2)) / 2.0)


def summed(
    poses: Poses, log_weights: FloatArray, groups: IntArray, leaders: IntArray
) -> tuple[Poses, FloatArray]:
    """Each group of components as one Gaussian, and its log weight.

    groups (k,): which one a component belongs to, all from 0 on. leaders (g,): the component of
    each whose heading the others' are taken near.
    """
    shares = np.exp(log_weights)
    totals = np.bincount(groups, shares)
    shares = shares / totals[groups]
    means = poses.means.copy()
    reference = means[leaders[groups], _HEADING]
    means[:, _HEADING] = reference + wrap(means[:, _HEADING] - reference)
    mean = _added(groups, shares[:, None] * means)
    off = means - mean[groups]
    spread = poses.covariances + off[:, :, None] * off[:, None, :]
    return Poses(mean, _added(groups, shares[:, None, None] * spread)), np.log(totals)


def _added(groups: IntArray, values: FloatArray) -> FloatArray:
    total = np.zeros((int(groups.max(initial=-1)) + 1, *values.shape[1:]))
    np.add.at(total, groups, values)
    return total


def apart(poses: Poses, first: IntArray, second: IntArray) -> FloatArray:
    """Squared distances (p,) of pairs of poses in sigmas of both, axis by axis."""
    off = poses.means[first, :3] - poses.means[second, :3]
    off[:, _HEADING] = wrap(off[:, _HEADING])
    variances = np.diagonal(poses.covariances, axis1=1, axis2=2)[:, :3]
    return np.asarray((off**2 / (variances[first] + variances[second])).sum(axis=1))


def alike(poses: Poses, kinds: IntArray, most: float) -> BoolArray:
    """(k, k): which poses of one kind (k,) are nearer than `most`, see `apart`."""
    found = kinds[:, None] == kinds
    first, second = np.nonzero(found)
    found[first, second] = apart(poses, first, second) < most
    return np.asarray(found)
