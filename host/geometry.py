"""Planar rigid motions, angles, and the robot's own path by its odometry."""

import copy
import math

import numpy as np

from host.messages import Displacement, FloatArray, IntArray

SECTORS = 360  # of a clearance profile (see `messages.Positions`)


def wrap(angle: FloatArray | float) -> FloatArray:
    """The same angle (rad) in [-pi, pi), rounded: just below -pi it is pi itself; any shape."""
    return np.asarray((np.asarray(angle) + math.pi) % (2.0 * math.pi) - math.pi)


def sector(bearing: FloatArray) -> IntArray:
    """Index (n,) of the clearance sector that a bearing (n,) rad in [-pi, pi] falls into."""
    index = ((bearing + math.pi) * (SECTORS / (2.0 * math.pi))).astype(np.int64)
    return np.minimum(index, SECTORS - 1)


def rotation(angle: float) -> FloatArray:
    """R(phi) of Perera 2021 eq. 1: (2, 2), rotates a vector counter-clockwise by `angle` rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


# Old numpy computes cos and sin of strided arrays in one of two ways, by where they lie in memory;
# of contiguous ones always alike. Estimates have to be bit-identical, so arguments are made so.


def to_parent(points: FloatArray, poses: FloatArray) -> FloatArray:
    """Points (n, 2) given in frames at `poses` (n, 3) or (3,): x, y, heading; in the parent."""
    x, y, psi = np.ascontiguousarray(np.asarray(poses).T)
    c, s = np.cos(psi), np.sin(psi)
    px, py = points.T
    return columns(x + c * px - s * py, y + s * px + c * py)


def to_frame(points: FloatArray, poses: FloatArray) -> FloatArray:
    """Points (n, 2) of the parent frame, seen from frames at `poses` (n, 3) or (3,)."""
    x, y, psi = np.ascontiguousarray(np.asarray(poses).T)
    c, s = np.cos(psi), np.sin(psi)
    px, py = points[..., 0] - x, points[..., 1] - y
    return columns(c * px + s * py, c * py - s * px)


def columns(x: FloatArray, y: FloatArray) -> FloatArray:
    """Points (..., 2) of coordinates of one shape; as np.stack, which takes three times as long."""
    points = np.empty((*np.shape(x), 2))
    points[..., 0], points[..., 1] = x, y
    return points


def into_new_frame(
    means: FloatArray, covariances: FloatArray, motion: Displacement
) -> tuple[FloatArray, FloatArray]:
    """Gaussians in the robot's frame before a motion, in that after it: means and covariances.

    Over positions, (..., 2) and (..., 2, 2), or positions and velocities, (..., 4), (..., 4, 4).
    m' = R(dpsi)^T (m - d);  P' = R^T P R + v I + h (J m')(J m')^T, with v and h the variances of
    the odometry, v of positions alone, and J m' = (-y', x') the lever arm of its heading. (Perera
    2021 eq. 7-8, counter-clockwise positive.)
    """
    parts = means.shape[-1] // 2
    rotated = np.kron(np.eye(parts), rotation(motion.dpsi).T)
    shift, unknown = np.zeros((2, 2 * parts))
    shift[:2], unknown[:2] = (motion.dx, motion.dy), motion.translation_variance
    moved = (means - shift) @ rotated.T
    lever = moved @ np.kron(np.eye(parts), [[0.0, 1.0], [-1.0, 0.0]])
    spread = rotated @ covariances @ rotated.T + np.diag(unknown)
    spread += motion.heading_variance * lever[..., :, None] * lever[..., None, :]
    return moved, spread


def along_rays(origin: tuple[float, float], bearings: FloatArray, ranges: FloatArray) -> FloatArray:
    """Positions (k, 2) m at bearings (k,) rad and ranges (k,) m from `origin`."""
    return columns(origin[0] + ranges * np.cos(bearings), origin[1] + ranges * np.sin(bearings))


def polar(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ranges (k,) m and bearings (k,) rad of points (k, 2) m from the origin."""
    x, y = points.T
    return np.hypot(x, y), np.arctan2(y, x)


def on_rays(
    origin: tuple[float, float],
    bearings: FloatArray,
    ranges: FloatArray,
    across: FloatArray,
    along: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 2) m of bearings and ranges (k,) from `origin`, and covariances (k, 2, 2) m².

    across, along (k,) m²: variances across each ray and along it.
    """
    ray = np.stack((np.cos(bearings), np.sin(bearings)))
    covariances = np.einsum("ak,bk,k->kab", ray, ray, along - across)
    covariances += across[:, None, None] * np.eye(2)
    return along_rays(origin, bearings, ranges), covariances


# Where no odometry says how the robot drives: m² (per axis) and rad² a second. As a robot does that
# wanders at 0.3 m/s.
_LOST_TRANSLATION, _LOST_HEADING = 0.015, 0.1
# Then neither place nor heading are known at all: m² per axis, rad².
_MOST_TRANSLATION, _MOST_HEADING = 1e4, 10.0
_FARTHEST_M, _FARTHEST_RAD = 1e3, 1e3  # in one displacement, as `message_checks` has it
_COAST_S = 0.3  # odometry is late by less, unless it has ended
_LAST_S = 0.1  # over which a robot's speed is taken
_HOLE_S = 0.01  # a shorter gap between displacements is a matter of clocks


class Path:
    """The robot's recent poses, integrated from its displacements.

    The frame is that of the first displacement's start. Poses between two displacements are
    interpolated; before the first and after the last the robot is taken to stand still. In a hole
    of the odometry, and after its end, where it stands is known less by the second.
    """

    def __init__(self, keep_seconds: float = 5.0) -> None:
        self._keep = keep_seconds
        # Columns: time, x, y, heading (not wrapped), summed translation and heading variance.
        self._rows = np.zeros((256, 6))
        self._count = 0

    @property
    def end(self) -> float:
        """Time up to which the odometry is known, s; -inf before the first displacement."""
        return float(self._rows[self._count - 1, 0]) if self._count else -math.inf

    @property
    def last(self) -> FloatArray:
        """The pose (3,) at `end`: x, y (m), heading (rad, not wrapped)."""
        return self._rows[max(self._count - 1, 0), 1:4]

    def append(self, step: Displacement) -> None:
        """Add the motion of one interval. One that ends no later than the last is ignored."""
        if step.time <= self.end:
            return
        if not self._count:
            self._rows[0] = (step.time - step.interval, 0.0, 0.0, 0.0, 0.0, 0.0)
            self._count = 1
        end, x, y, psi, translation, heading = self._rows[self._count - 1]
        hole = step.time - step.interval - end
        if hole > _HOLE_S:
            translation += hole * _LOST_TRANSLATION
            heading += hole * _LOST_HEADING
        c, s = math.cos(psi), math.sin(psi)
        if self._count == len(self._rows):
            self._forget(step.time - self._keep)
        self._rows[self._count] = (
            step.time,
            x + c * step.dx - s * step.dy,
            y + s * step.dx + c * step.dy,
            psi + step.dpsi,
            translation + step.translation_variance,
            heading + step.heading_variance,
        )
        self._count += 1

    def _forget(self, before: float) -> None:
        first = int(np.searchsorted(self._rows[: self._count, 0], before))
        kept = self._rows[max(0, first - 1) : self._count]
        size = max(256, 2 * len(kept))
        rows = np.zeros((size, 6))
        rows[: len(kept)] = kept
        self._rows, self._count = rows, len(kept)

    def poses(self, times: FloatArray) -> FloatArray:
        """Poses (n, 3): x, y (m), heading (rad, not wrapped) at `times` (n,)."""
        return self._interpolated(np.asarray(times, dtype=float), 3)

    def _interpolated(self, times: FloatArray, count: int) -> FloatArray:
        """The first `count` of x, y, heading and the summed variances, (n, count)."""
        known = np.zeros((len(times), count))
        if self._count:
            rows = np.ascontiguousarray(self._rows[: self._count, : count + 1].T)
            for k in range(count):
                known[:, k] = np.interp(times, rows[0], rows[k + 1])
        return known

    def between(self, start: float, end: float) -> Displacement:
        """How the robot moved from `start` to `end` (s), with the odometry's noise."""
        times = np.array([start, end])
        first, last = known = self._interpolated(times, 5)
        if self._count:
            after = np.maximum(times - self.end, 0.0)
            known[:, 3:] += after[:, None] * (_LOST_TRANSLATION, _LOST_HEADING)
        dx, dy = np.clip(to_frame(last[:2], first[:3]), -_FARTHEST_M, _FARTHEST_M)
        return Displacement(
            time=end,
            interval=end - start,
            dx=float(dx),
            dy=float(dy),
            dpsi=min(max(float(last[2] - first[2]), -_FARTHEST_RAD), _FARTHEST_RAD),
            translation_variance=min(abs(float(last[3] - first[3])), _MOST_TRANSLATION),
            heading_variance=min(abs(float(last[4] - first[4])), _MOST_HEADING),
        )

    def extended(self, time: float) -> "Path":
        """A copy that goes on to `time` (s) as the robot last drove; for at most _COAST_S."""
        longer = copy.copy(self)
        longer._rows = self._rows.copy()
        coast = min(time - self.end, _COAST_S)
        if self._count and coast > 0.0:
            last = self.between(self.end - _LAST_S, self.end)
            share = coast / _LAST_S
            longer.append(
                Displacement(
                    time=self.end + coast,
                    interval=coast,
                    dx=share * last.dx,
                    dy=share * last.dy,
                    dpsi=share * last.dpsi,
                    translation_variance=coast * _LOST_TRANSLATION,
                    heading_variance=coast * _LOST_HEADING,
                )
            )
        return longer

    def carry(self, points: FloatArray, times: FloatArray, to_time: float) -> FloatArray:
        """Points (n, 2) seen in the robot frame at `times` (n,), in the robot frame at `to_time`.

        The points stand still; only the robot moves.
        """
        if not self._count:
            return points
        (reference,) = self.poses(np.array([to_time]))
        return to_frame(to_parent(points, self.poses(times)), reference)
