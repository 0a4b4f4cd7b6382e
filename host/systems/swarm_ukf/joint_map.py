"""One unscented Kalman filter over the poses of all robots (Miller 2019, section III-B).

Miller runs a filter for each robot, and takes the others where their filters say for known
landmarks. Two robots that see each other then confirm each other's error, again and again. Here
the covariance of all poses is one matrix, so that a neighbour's uncertainty counts and what two
robots have in common is not new to either; `neighbours="exact"` is his form.

Nothing measures where the swarm as a whole stands and points: its frame is free. `lay_frame` takes
the free part out of the covariance, which then is that of the errors that remain when the swarm is
laid on the truth with least squares. So it is scored (section III-A).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from host.geometry import to_frame, wrap
from host.messages import Displacement, FloatArray, IntArray

Neighbours = Literal["joint", "exact"]

_SIZE = 5  # of a robot's state: x, y, heading, gains of distance and rotation
_GATE = 16.0  # squared, of two dimensions: a right reading is refused once in 3,000
_LEAST_VARIANCE = 1e-12  # keeps a matrix positive definite through rounding


@dataclass(frozen=True, slots=True)
class Reading:
    """Robot `observer` sees robot `seen` at `position` (2,) m of its own frame, covariance (2, 2).

    Range and bearing are taken as a position, so that no angle has to be wrapped.
    """

    observer: int
    seen: int
    position: FloatArray
    covariance: FloatArray


class JointMap:
    """Poses (n, 3) of n robots, x, y (m) and heading (rad), in one frame of their own.

    poses (n, 3) and covariance (3n, 3n): where they start. gain_sigmas: how wrong, as shares, each
    robot's odometry may be in distance and in rotation; learnt with the poses. neighbours: "joint",
    or "exact" for a filter a robot, as published.
    """

    def __init__(
        self,
        poses: FloatArray,
        covariance: FloatArray,
        gain_sigmas: tuple[float, float] = (0.0, 0.0),
        neighbours: Neighbours = "joint",
    ) -> None:
        count = len(poses)
        self._state = np.hstack((poses, np.ones((count, 2)))).ravel()
        self._pose_rows = (np.arange(count)[:, None] * _SIZE + np.arange(3)).ravel()
        self._covariance = np.diag(np.tile((0.0, 0.0, 0.0, *np.square(gain_sigmas)), count))
        self._covariance[np.ix_(self._pose_rows, self._pose_rows)] = covariance
        self._exact = neighbours == "exact"
        self.accepted = 0
        self.refused = 0
        if self._exact:
            self._covariance *= np.kron(np.eye(count), np.ones((_SIZE, _SIZE)))

    @property
    def poses(self) -> FloatArray:
        """(n, 3): x, y (m), heading (rad, not wrapped)."""
        return self._state.reshape(-1, _SIZE)[:, :3].copy()

    @property
    def gains(self) -> FloatArray:
        """(n, 2): true distance and rotation for each that the odometry reports."""
        return self._state.reshape(-1, _SIZE)[:, 3:].copy()

    @property
    def covariance(self) -> FloatArray:
        """(3n, 3n) of the poses, once the swarm is laid on the truth."""
        own = self._covariance[np.ix_(self._pose_rows, self._pose_rows)]
        remains = aligned_with_truth(self.poses)
        return np.asarray(remains @ own @ remains.T)

    def predict(self, robot: int, step: Displacement) -> None:
        """Robot `robot` (0 to n-1) has moved, as its own odometry reports it.

        Section III-B's differential drive, over the whole interval as one rigid motion.
        """
        own = slice(_SIZE * robot, _SIZE * (robot + 1))

        def moved(states: FloatArray) -> FloatArray:
            _, _, heading, distance, rotated = states.T
            heading = heading + (rotated - 1.0) * step.dpsi / 2.0  # the chord's, not the start's
            c, s = np.cos(heading), np.sin(heading)
            along, across = distance * step.dx, distance * step.dy
            shift = (c * along - s * across, s * along + c * across, rotated * step.dpsi)
            return np.asarray(states + np.stack((*shift, 0.0 * c, 0.0 * c), axis=1))

        mean, gain, left = _linearized(moved, self._state[own], self._covariance[own, own])
        self._state[own] = mean
        self._covariance[own] = gain @ self._covariance[own]
        self._covariance[:, own] = self._covariance[:, own] @ gain.T
        noise = (step.translation_variance, step.translation_variance, step.heading_variance)
        self._covariance[own, own] += left + np.diag((*noise, 0.0, 0.0))

    def update(self, reading: Reading) -> bool:
        """Take a reading in, eq. 4 in Cartesian form. False where it is refused as impossible.

        Only the two poses go through the unscented transform; the others follow by regression,
        for the reading does not depend on them.
        """
        index = _rows(reading.observer)
        if not self._exact:
            index = np.concatenate((index, _rows(reading.seen)))
        landmark = self._state[_rows(reading.seen)[:2]]

        def seen(poses: FloatArray) -> FloatArray:
            points = landmark if self._exact else poses[:, _SIZE : _SIZE + 2]
            return to_frame(np.broadcast_to(points, (len(poses), 2)), poses[:, :3])

        pair = np.ix_(index, index)
        mean, slope, left = _linearized(seen, self._state[index], self._covariance[pair])
        innovation = reading.position - mean
        spread = slope @ self._covariance[pair] @ slope.T + left + reading.covariance
        if innovation @ np.linalg.solve(spread, innovation) > _GATE:
            self.refused += 1
            return False
        rows = index if self._exact else np.arange(len(self._state))
        cross = self._covariance[np.ix_(rows, index)] @ slope.T
        gain = np.linalg.solve(spread, cross.T).T
        self._state[rows] += gain @ innovation
        if self._exact:
            self._covariance[pair] -= gain @ cross.T
        else:
            self._covariance -= gain @ cross.T
        self.accepted += 1
        return True

    def lay_frame(self) -> None:
        """Project out of the covariance what moves the swarm as a whole; before it has grown."""
        if self._exact:
            return
        remains = np.eye(len(self._state))
        remains[np.ix_(self._pose_rows, self._pose_rows)] = aligned_with_truth(self.poses)
        laid = remains @ self._covariance @ remains.T
        self._covariance = (laid + laid.T) / 2.0


def aligned_with_truth(poses: FloatArray) -> FloatArray:
    """(3n, 3n): errors of poses (n, 3) to those left once the positions are laid on the truth.

    The first order of Kabsch's alignment: the mean shift is taken away, and the rotation about the
    centroid that explains positions best, from headings as well.
    """
    count = len(poses)
    arms = poses[:, :2] - poses[:, :2].mean(axis=0)
    free = np.zeros((count, 3, 3))  # what a shift in x, in y, a rotation do to each pose
    free[:, 0, 0] = free[:, 1, 1] = free[:, 2, 2] = 1.0
    free[:, 0, 2], free[:, 1, 2] = -arms[:, 1], arms[:, 0]
    columns = free.reshape(3 * count, 3)
    positions = columns * np.tile((1.0, 1.0, 0.0), count)[:, None]
    weight = positions.T @ columns
    return np.asarray(np.eye(3 * count) - columns @ np.linalg.solve(weight, positions.T))


def relative(poses: FloatArray, origin: int) -> FloatArray:
    """Poses (n, 3) as robot `origin` has them in its own frame; headings in [-pi, pi)."""
    own = poses[origin]
    points = to_frame(poses[:, :2], own)
    return np.column_stack((points, wrap(poses[:, 2] - own[2])))


def _rows(robot: int) -> IntArray:
    return np.arange(_SIZE * robot, _SIZE * (robot + 1))


def _linearized(
    function: Callable[[FloatArray], FloatArray], mean: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A function of a Gaussian as a line: its mean, slope, and the covariance of what is left.

    Statistical linear regression through the 2n points of the third-degree spherical-radial rule
    (Arasaratnam & Haykin 2009): the unscented transform with alpha = 1, beta = kappa = 0, which
    has no negative weight. Miller's alpha = 1e-5 gives the centre a weight of -1e10.
    """
    size = len(mean)
    root = np.linalg.cholesky(covariance + _LEAST_VARIANCE * np.eye(size))
    offsets = math.sqrt(size) * np.concatenate((root.T, -root.T))
    values = function(mean + offsets)
    value = values.mean(axis=0)
    spread = values - value
    cross = spread.T @ offsets / (2 * size)
    slope = np.linalg.solve(root.T, np.linalg.solve(root, cross.T)).T
    left = spread.T @ spread / (2 * size) - slope @ root @ root.T @ slope.T
    return value, slope, left
