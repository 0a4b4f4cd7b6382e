"""Which mounting of the lidar brings turrets that it saw onto teammates, at any one delay.

Who is who is not known, and the lidar may be rotated by any angle: all angles are tried, by how
many turrets come to lie near a teammate, and the best are fitted to the nearest teammate.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.gathered import Tracks
from host.calibration.robust.rigid_alignment import align, align_robustly
from host.config import Lidar
from host.errors import UserError
from host.geometry import Path, to_parent
from host.messages import FloatArray, IntArray, Scan
from host.perception.turrets import turrets

NEAR_M = 0.1  # a teammate's turret lies no farther from the truth, once the mounting is right
_HEADINGS = np.radians(np.arange(-180.0, 180.0, 10.0))
_TRIED = 2  # of the headings, at each delay
_COARSE_M, _ERRORS_M = 0.4, (0.3, 0.2, NEAR_M)  # the same, before it is
_SCORED = 250  # turrets that the cost at a heading is of
_LEAST_PAIRS = 30
_SEED = 20240601


@dataclass(frozen=True, slots=True)
class Turrets:
    """What may be teammates: points (n, 2) m in the lidar's frame, stamped times (n,) s.

    sigmas (n,) m: their std per axis, by the fit of the circle.
    """

    times: FloatArray
    points: FloatArray
    sigmas: FloatArray

    def some(self, count: int) -> "Turrets":
        """At most `count` of them, in order."""
        # Drawn, since every n-th might be the same post in every revolution.
        drawn = np.sort(np.random.default_rng(_SEED).permutation(len(self.times))[:count])
        return Turrets(self.times[drawn], self.points[drawn], self.sigmas[drawn])


def find_turrets(scans: list[Scan], lidar: Lidar) -> Turrets:
    """All candidates in the lidar's own frame: each at its own time, not carried.

    The delay that is configured is taken out of their times, so that the whole of it is found.
    """
    bare = lidar.model_copy(update={"x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0})
    stay = Path()
    found = [turrets.find(scan, bare, stay) for scan in scans]
    times = [p.time - (p.lags if p.lags is not None else np.zeros(len(p.positions))) for p in found]
    if sum(len(t) for t in times) < _LEAST_PAIRS:
        raise UserError(
            "the lidar saw no turrets",
            f"{sum(len(t) for t in times)} in {len(scans)} revolutions",
            "put a teammate 0.5 to 2 m away in plain view; its turret's width is "
            f"lidar.target_diameter_m ({lidar.target_diameter_m} m)",
        )
    covariances = np.concatenate([p.covariances for p in found])
    return Turrets(
        np.concatenate(times) + lidar.delay_s,
        np.concatenate([p.positions for p in found]),
        np.sqrt(0.5 * np.trace(covariances, axis1=1, axis2=2)),
    )


def truths_at(tracks: Tracks, times: FloatArray) -> FloatArray:
    """Positions (n, m, 2) of all teammates in the robot frame; far away where not known."""
    return np.nan_to_num(tracks.teammates(times), nan=1e6)


def nearest(placed: FloatArray, truths: FloatArray) -> tuple[IntArray, FloatArray]:
    """Of the teammates (n, m, 2) the one nearest to each point (n, 2): which, how far (m)."""
    distance = np.hypot(*np.moveaxis(placed[:, None] - truths, -1, 0))
    who = np.argmin(distance, axis=1)
    return who, distance[np.arange(len(who)), who]


def recognised(seen: Turrets, tracks: Tracks, values: FloatArray) -> IntArray:
    """Who (n,) each candidate is, by a mounting and delay (4 or more,): an identity, or -1."""
    index, distance = nearest(
        to_parent(seen.points, values[:3]), truths_at(tracks, seen.times - values[3])
    )
    return np.where(distance < NEAR_M, tracks.identities[index], -1)


def places_of(tracks: Tracks, who: IntArray, times: FloatArray) -> FloatArray:
    """Positions (n, 2) in the robot frame of the teammates `who` (n,), each at its own time."""
    found = np.full((len(times), 2), math.nan)
    for identity in tracks.identities.tolist():
        member = who == identity
        found[member] = tracks.relative(identity, times[member])
    return found


def fit_at(delay: float, seen: Turrets, tracks: Tracks) -> tuple[FloatArray, float]:
    """The best pose (3,) of the lidar at a delay (s), and its cost.

    The cost is the mean of squared distances to the nearest teammate, each cut off at 0.1 m: 0.01
    where nothing fits.
    """
    truths = truths_at(tracks, seen.times - delay)
    best, least = np.zeros(3), NEAR_M**2
    for heading in _likely_headings(seen.points, truths):
        try:
            pose = _settle(seen.points, truths, np.array([0.0, 0.0, heading]))
        except UserError:
            continue  # from this heading on, no three pairs agree
        distance = nearest(to_parent(seen.points, pose), truths)[1]
        cost = float(np.mean(np.minimum(distance, NEAR_M) ** 2))
        if cost < least:
            best, least = pose, cost
    return best, least


def _likely_headings(points: FloatArray, truths: FloatArray) -> list[float]:
    """The few headings (rad) at which points come nearest to teammates, without a translation."""
    each = slice(None, None, max(len(points) // _SCORED, 1))
    beams, targets = (p[each, ..., 0] + 1j * p[each, ..., 1] for p in (points, truths))
    placed = np.exp(1j * _HEADINGS)[:, None] * beams
    distance = np.abs(placed[:, :, None] - targets).min(axis=2)
    costs = np.mean(np.minimum(distance, _COARSE_M) ** 2, axis=1)
    return [float(_HEADINGS[k]) for k in np.argsort(costs)[:_TRIED]]


def _settle(points: FloatArray, truths: FloatArray, pose: FloatArray) -> FloatArray:
    """The pose (3,) that pairs agree on, of points and the teammates then nearest to them."""
    for error in _ERRORS_M:
        who, distance = nearest(to_parent(points, pose), truths)
        partners = truths[np.arange(len(who)), who]
        pose = align(points, partners, (distance <= error).astype(float)).pose
    return align_robustly(points, partners, _ERRORS_M[-1], pose).pose
