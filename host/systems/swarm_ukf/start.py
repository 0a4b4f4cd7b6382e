"""Where the robots are, from nothing but recent readings (Miller 2019, section III-A).

Miller minimizes eq. 2 over one sweep of every robot, from zero, and may end in a local minimum.
Here the readings of the last seconds serve, each carried to the present by the odometry of both
robots, and the start is global: with every heading as a complex number of any length, eq. 2 is
linear, and its smallest eigenvector is the answer up to noise (angular synchronization, Singer
2011). A robust least-squares fit follows. The answer comes with its covariance, or with the reason
why there is none yet.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, minimize

from host.geometry import Path, rotation, to_frame, to_parent
from host.messages import Displacement, FloatArray, IntArray
from host.systems.swarm_ukf.joint_map import Reading, aligned_with_truth

MOST_SIGMA_M = 0.5  # worse known, a robot counts as not observable
_MOST_COST = 4.0  # robust, a degree of freedom: above it the readings contradict each other
_FREE = 3  # shift and rotation of the whole swarm
_NO_INFORMATION = 1e-9  # of the largest eigenvalue


@dataclass(frozen=True, slots=True)
class TimedReading:
    """A reading and when it was made, s."""

    time: float
    reading: Reading


@dataclass(frozen=True, slots=True)
class Start:
    """Poses (n, 3) in a frame of their own and their covariance (3n, 3n)."""

    poses: FloatArray
    covariance: FloatArray


def find_start(
    readings: Sequence[TimedReading],
    paths: Mapping[int, Path],
    time: float,
    gain_sigmas: tuple[float, float] = (0.0, 0.0),
) -> Start | str:
    """The poses of robots 0 to n-1 at `time` (s), or in words why they cannot be known yet.

    paths: each robot's odometry, as shares wrong by gain_sigmas in distance and in rotation. What
    it needs: eq. 3, every robot linked to the others, and each
    position known to MOST_SIGMA_M.
    """
    missing = _missing(readings, len(paths))
    if missing:
        return missing
    sight = carried(readings, paths, time, gain_sigmas)
    poses, cost = sight.fitted(sight.embedded())
    if cost > _MOST_COST:
        return "the readings contradict each other: no map fits them"
    covariance = sight.covariance(poses)
    if covariance is None:
        return "the readings leave a robot free to move or rotate: more are needed"
    sigmas = np.sqrt(np.diagonal(covariance).reshape(-1, 3)[:, :2].max(axis=1))
    worst = int(np.argmax(sigmas))
    if sigmas[worst] > MOST_SIGMA_M:
        return f"robot {worst + 1} is known to {sigmas[worst]:.1f} m only: more readings are needed"
    return Start(poses, covariance)


def _missing(readings: Sequence[TimedReading], count: int) -> str:
    """Why so few readings cannot place all robots; "" where nothing is known against it."""
    if count < 2:
        return "one robot alone has nothing to be placed by"
    groups = np.arange(count)
    for timed in readings:
        groups[groups == groups[timed.reading.seen]] = groups[timed.reading.observer]
    names, sizes = np.unique(groups, return_counts=True)
    if len(names) > 1:
        apart = np.flatnonzero(groups == names[np.argmin(sizes)]) + 1
        return f"no reading links robot {' and '.join(map(str, apart))} to the others"
    if 2 * len(readings) < _FREE * count - _FREE:
        return f"{len(readings)} readings are too few for {count} robots (eq. 3)"
    return ""


@dataclass(frozen=True, slots=True)
class CarriedReadings:
    """Readings of a window as if robots stood still: eq. 2 with weights.

    observers, seen (m,): robots 0 to n-1. points (m, 2) m: what was seen, in the observer's present
    frame; places (m, 2) m: where the seen robot was, in its own present frame. roots (m, 2, 2):
    of the inverse covariances of their difference in the observer's frame.
    """

    count: int
    observers: IntArray
    seen: IntArray
    points: FloatArray
    places: FloatArray
    roots: FloatArray

    def embedded(self) -> FloatArray:
        """Poses (n, 3) that fit best with headings of any length: no start is needed."""
        rows = np.arange(len(self.points))
        weights = np.linalg.norm(self.roots, axis=(1, 2))
        gaps = np.zeros((len(rows), 2 * self.count), dtype=complex)  # of positions, of headings
        gaps[rows, self.seen] += weights
        gaps[rows, self.observers] -= weights
        gaps[rows, self.count + self.seen] += weights * (self.places @ (1.0, 1.0j))
        gaps[rows, self.count + self.observers] -= weights * (self.points @ (1.0, 1.0j))
        positions, headings = gaps[:, : self.count], gaps[:, self.count :]
        solved = np.linalg.pinv(positions) @ headings
        left = headings - positions @ solved
        smallest = np.linalg.eigh(left.conj().T @ left)[1][:, 0]
        smallest *= np.sqrt(self.count)
        places = -solved @ smallest
        return np.column_stack((places.real, places.imag, np.angle(smallest)))

    def fitted(self, poses: FloatArray) -> tuple[FloatArray, float]:
        """The poses (n, 3) of least robust error near `poses`; that error a degree of freedom."""
        found = least_squares(
            self.residuals, poses.ravel(), jac=self.jacobian, loss="soft_l1", x_scale="jac"
        )
        freedom = max(1, 2 * len(self.points) - _FREE * (self.count - 1))
        return found.x.reshape(-1, 3), 2.0 * float(found.cost) / freedom

    def covariance(self, poses: FloatArray) -> FloatArray | None:
        """(3n, 3n) of `poses` once they are laid on the truth; None where they are not all held."""
        slopes = self.jacobian(poses.ravel())
        values, vectors = np.linalg.eigh(slopes.T @ slopes)
        if values[_FREE] < _NO_INFORMATION * values[-1]:
            return None
        held = vectors[:, _FREE:] / np.sqrt(values[_FREE:])
        remains = aligned_with_truth(poses) @ held
        return np.asarray(remains @ remains.T)

    def residuals(self, flat: FloatArray) -> FloatArray:
        """(2m,) standard deviations from where the observer saw it to where it says it was."""
        poses = flat.reshape(-1, 3)
        places = to_parent(self.places, poses[self.seen])
        gaps = to_frame(places, poses[self.observers]) - self.points
        return np.asarray(np.einsum("mij,mj->mi", self.roots, gaps).ravel())

    def jacobian(self, flat: FloatArray) -> FloatArray:
        """(2m, 3n): of `residuals`."""
        poses = flat.reshape(-1, 3)
        observers, seen = poses[self.observers], poses[self.seen]
        places = to_frame(to_parent(self.places, seen), observers)
        c, s = np.cos(observers[:, 2]), np.sin(observers[:, 2])
        turned = np.stack((np.stack((c, s), axis=1), np.stack((-s, c), axis=1)), axis=1)
        arms = to_parent(self.places, seen) - seen[:, :2]
        slopes = np.zeros((len(self.points), 2, self.count, 3))
        rows = np.arange(len(self.points))
        slopes[rows, :, self.observers, :2] = -turned
        slopes[rows, :, self.observers, 2] = places[:, ::-1] * (1.0, -1.0)
        slopes[rows, :, self.seen, :2] = turned
        slopes[rows, :, self.seen, 2] = np.einsum("mij,mj->mi", turned, arms[:, ::-1] * (-1.0, 1.0))
        return np.asarray(
            np.einsum("mij,mjnk->mink", self.roots, slopes).reshape(2 * len(rows), 3 * self.count)
        )


def carried(
    readings: Sequence[TimedReading],
    paths: Mapping[int, Path],
    time: float,
    gain_sigmas: tuple[float, float] = (0.0, 0.0),
) -> CarriedReadings:
    """Readings of several times at `time` (s), with the noise of the odometry that carries them."""
    points, places, roots = [], [], []
    for timed in readings:
        reading = timed.reading
        observer = paths[reading.observer].between(time, timed.time)
        seen = paths[reading.seen].between(time, timed.time)
        turned = rotation(observer.dpsi)
        points.append((observer.dx, observer.dy) + turned @ reading.position)
        places.append((seen.dx, seen.dy))
        arm = math.hypot(*reading.position)
        noise = _carry_variance(observer, arm, gain_sigmas) + _carry_variance(
            seen, math.hypot(seen.dx, seen.dy), gain_sigmas
        )
        covariance = turned @ reading.covariance @ turned.T + noise * np.eye(2)
        roots.append(np.linalg.cholesky(np.linalg.inv(covariance)).T)
    return CarriedReadings(
        len(paths),
        np.array([timed.reading.observer for timed in readings], dtype=np.int64),
        np.array([timed.reading.seen for timed in readings], dtype=np.int64),
        np.array(points).reshape(-1, 2),
        np.array(places).reshape(-1, 2),
        np.array(roots).reshape(-1, 2, 2),
    )


def _carry_variance(moved: Displacement, arm: float, gain_sigmas: tuple[float, float]) -> float:
    """m² that a motion between reading and present adds to a point `arm` m from its centre."""
    distance = gain_sigmas[0] * math.hypot(moved.dx, moved.dy)
    rotation_variance = moved.heading_variance + (gain_sigmas[1] * moved.dpsi) ** 2
    return moved.translation_variance + distance**2 + rotation_variance * arm**2


def direct_estimate(sight: CarriedReadings) -> FloatArray:
    """Poses (n, 3) as published: eq. 2 without weights by SLSQP, from zero."""
    plain = CarriedReadings(
        sight.count,
        sight.observers,
        sight.seen,
        sight.points,
        sight.places,
        np.broadcast_to(np.eye(2), sight.roots.shape),
    )
    found = minimize(
        lambda flat: float(plain.residuals(flat) @ plain.residuals(flat)),
        np.zeros(3 * sight.count),
        jac=lambda flat: 2.0 * plain.jacobian(flat).T @ plain.residuals(flat),
        method="SLSQP",
    )
    return np.asarray(found.x.reshape(-1, 3))
