"""The sound Gaussian-mixture PHD filter over position and kind: teammate or obstacle.

The recursion is Vo and Ma 2006 with the sensors of Perera 2021 and what the thesis leaves out:
clutter, the innovation covariance, birth from readings, merging, and a memory of what was
reported. A component is a thing that stands somewhere, under two hypotheses of what it is: a
teammate moves and shows a red strip to the cameras, an obstacle does neither; to the lidar they
look alike. So the lidar tells that something is there, and motion and cameras tell what it is.
Every step is linear in the number of components. docs/filters.md derives it.
"""

import numpy as np

from host.config import Camera, Filter, Lidar
from host.estimator.gaussian_mixture import (
    PXX,
    PXY,
    PYY,
    ROWS,
    WEIGHT,
    X,
    Y,
    carry,
    match_moments,
    near,
    update_by_bearings,
    update_by_positions,
)
from host.estimator.sensor_models import CameraModel, LidarModel, clearance_of
from host.messages import Bearings, Displacement, Estimate, FloatArray, IntArray, Positions

TEAMMATE, OBSTACLE = 0, 1
SEEN, CONFIRMED, LABEL = range(3)  # tags: s of the last reading, whether reported, a number
_FADE_S = 1.0  # mean survival beyond the survival range
_BELIEVED = 0.5  # from this weight on a component can hide another
_STANDING = 0.5  # share of the time in which a teammate does not move
_LEAST_SHARE = 0.01  # neither kind is ever ruled out: a standing robot drives off again


class PhdFilter:
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    def __init__(
        self,
        settings: Filter | None = None,
        lidar: Lidar | None = None,
        camera: Camera | None = None,
    ) -> None:
        self._settings = settings or Filter()
        self._lidar = LidarModel(lidar or Lidar())
        self._camera = CameraModel(camera or Camera())
        self._width = (lidar or Lidar()).target_diameter_m
        self._rows = np.zeros((ROWS, 2, 0))
        self._tags = np.zeros((3, 0))
        self._time = 0.0
        self._next_label = 1

    def predict(self, motion: Displacement) -> None:
        """Eq. 7–10 repaired: carry, spread teammates (not obstacles), fade what is far."""
        rows, settings, dt = self._rows, self._settings, motion.interval
        self._time = motion.time
        spread = np.array([[settings.motion_noise_m**2 * dt], [0.0]])
        carry(rows, motion, spread)
        x, y = rows[X, TEAMMATE], rows[Y, TEAMMATE]
        far = x * x + y * y > settings.survival_range_m**2
        rows[WEIGHT] *= np.exp(-dt / settings.survival_s - far * (dt / _FADE_S))

    def update(self, measurement: Positions | Bearings) -> None:
        """Eq. 6 with clutter; lidar positions or camera bearings, in any order."""
        if isinstance(measurement, Positions):
            self._update_positions(measurement)
        elif self._rows.shape[2]:
            self._update_bearings(measurement)

    def _update_positions(self, measured: Positions) -> None:
        rows, tags, settings = self._rows, self._tags, self._settings
        n, m = rows.shape[2], len(measured.positions)
        bearing, distance, clearance = self._surroundings(measured.clearance)
        detected = self._lidar.detection(
            bearing, distance, clearance, measured.clearance is not None
        )
        i, j = near(rows[:, TEAMMATE], measured.positions, measured.covariances, settings.gate)
        noise = measured.covariances.reshape(-1, 4).T[[0, 1, 3]]
        updated, likelihood = update_by_positions(
            rows[:, :, i], measured.positions[j], self._with_lag(noise, measured.lags)[:, :, j]
        )
        # A teammate may stand still; an obstacle never moves.
        likelihood[TEAMMATE] += _STANDING * (likelihood[OBSTACLE] - likelihood[TEAMMATE])
        updated[WEIGHT] *= detected[i] * likelihood
        mass = updated[WEIGHT].sum(axis=0)
        total = np.bincount(j, mass, m) + (self._lidar.clutter + settings.birth_per_m2)
        updated[WEIGHT] /= total[j]
        born = np.empty((ROWS, 2, m))
        born[X], born[Y] = measured.positions.T
        born[PXX:WEIGHT] = noise[:, None]
        share = settings.obstacle_share
        born[WEIGHT] = np.array([[1.0 - share], [share]]) * (settings.birth_per_m2 / total)
        rows[WEIGHT] *= 1.0 - detected

        # One group a reading. What was missed joins that of its likeliest reading, unless that
        # reading is hardly its own.
        weight = rows[WEIGHT].sum(axis=0)
        mass /= total[j]
        home = m + np.arange(n)
        order = mass.argsort()
        order = order[mass[order] > 0.1 * weight[i[order]]]
        home[i[order]] = j[order]
        seen = np.full(m, measured.time)
        self._replace(
            np.concatenate((rows, updated, born), axis=2),
            np.concatenate((home, j, np.arange(m))),
            np.concatenate((np.arange(n), i, np.full(m, n))),
            np.concatenate((tags[SEEN], seen[j], seen)),
        )

    def _with_lag(self, noise: FloatArray, lags: FloatArray | None) -> FloatArray:
        """Noise (3, 2, m) by kind: a teammate has moved on since the reading was made."""
        both = np.stack((noise, noise), axis=1)
        if lags is not None:
            both[::2, TEAMMATE] += self._settings.motion_noise_m**2 * lags
        return both

    def _update_bearings(self, measured: Bearings) -> None:
        """The cameras: Bayes' rule for the kind of each component, and where it stands.

        Of a blob that several may have caused, the others count as clutter for each.
        """
        rows, settings = self._rows, self._settings
        prior = rows[:, TEAMMATE]
        n, m = prior.shape[1], len(measured.bearings)
        bearing, distance, clearance = self._surroundings(None)
        detected = self._camera.detection(bearing, distance, clearance)
        lag = settings.motion_noise_m**2 * measured.lag
        pairs = update_by_bearings(prior, measured, lag, settings.gate)
        i, j = pairs.component, pairs.reading
        support = detected[i] * pairs.likelihood
        mass = support * prior[WEIGHT, i]
        # Blobs beyond what is expected come from teammates that the lidar has not shown yet.
        unknown = max(0.0, m - float(detected @ prior[WEIGHT])) / (2.0 * np.pi)
        clutter = self._camera.clutter + unknown
        others = np.bincount(j, mass, m)[j] - mass + clutter
        family = np.concatenate((prior, pairs.updated), axis=1)
        family[WEIGHT, :n] *= 1.0 - detected
        family[WEIGHT, n:] *= support / others
        total = rows[WEIGHT].sum(axis=0)
        rows[:, TEAMMATE] = match_moments(
            family, np.concatenate((np.arange(n), i)), prior[: Y + 1].copy()
        )
        rows[WEIGHT] *= total / rows[WEIGHT].sum(axis=0)
        self._tags[SEEN, i[support > others]] = measured.time
        self._confirm()

    def _surroundings(
        self, clearance: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bearing and distance of each component, and how far one sees in every sector."""
        x, y = self._rows[X, TEAMMATE], self._rows[Y, TEAMMATE]
        bearing, distance = np.arctan2(y, x), np.sqrt(x * x + y * y)
        if clearance is None:
            believed = self._rows[WEIGHT].sum(axis=0) > _BELIEVED
            clearance = clearance_of(bearing, distance, believed, self._width)
        return bearing, distance, clearance

    def _replace(
        self, rows: FloatArray, group: IntArray, parent: IntArray, seen: FloatArray
    ) -> None:
        """Merge each group into its heaviest, prune, and keep the tags with the heaviest heir.

        rows (ROWS, 2, N); group (N,); parent (N,): index of the old component, or n for a birth.
        Members further from the heaviest than merge_distance stay by themselves.
        """
        settings = self._settings
        weight = rows[WEIGHT].sum(axis=0)
        keep = (weight > settings.prune_weight).nonzero()[0]
        if len(keep) > settings.capacity:
            keep = keep[np.sort(np.argsort(-weight[keep], kind="stable")[: settings.capacity])]
        rows, group, parent, seen = rows[:, :, keep], group[keep], parent[keep], seen[keep]
        order = weight[keep].argsort()
        into, leader = _gather(rows[:, TEAMMATE], group, order, settings.merge_distance)
        size = len(leader)
        both = np.concatenate((into, into + size))
        about = rows[: Y + 1, :, leader].reshape(2, 2 * size)
        rows[WEIGHT] += 1e-12
        merged = match_moments(rows.reshape(ROWS, -1), both, about).reshape(ROWS, 2, size)
        total = merged[WEIGHT].sum(axis=0)
        # Two things cannot stand in one place.
        merged[WEIGHT] /= np.maximum(total, 1.0)

        parent = parent[leader]
        tags = np.concatenate((self._tags, np.zeros((3, 1))), axis=1)[:, parent]
        tags[SEEN] = seen[leader]
        heir = np.empty(self._tags.shape[1] + 1, dtype=np.int64)
        order = total.argsort()
        heir[parent[order]] = order
        heir[-1] = -1
        new = (heir[parent] != np.arange(size)).nonzero()[0]
        tags[CONFIRMED, new] = 0.0
        tags[LABEL, new] = self._next_label + np.arange(len(new))
        self._next_label += len(new)
        self._rows, self._tags = merged, tags
        self._confirm()

    def _confirm(self) -> None:
        """Report from report_weight on, until below forget_weight; rule no kind out."""
        settings, weight = self._settings, self._rows[WEIGHT]
        np.maximum(weight, _LEAST_SHARE * weight.sum(axis=0), out=weight)
        confirmed = self._tags[CONFIRMED]
        drop = settings.report_weight - settings.forget_weight
        confirmed[:] = weight[TEAMMATE] > settings.report_weight - drop * confirmed

    def estimate(self) -> Estimate:
        """Teammates reported: once above report_weight, until below forget_weight."""
        spread = self._rows[PXX, TEAMMATE] + self._rows[PYY, TEAMMATE]
        known = spread < 2.0 * self._settings.report_sigma_m**2
        index = (known * self._tags[CONFIRMED]).nonzero()[0]
        rows, tags = self._rows[:, TEAMMATE, index], self._tags[:, index]
        return Estimate(
            time=self._time,
            positions=rows[[X, Y]].T,
            covariances=rows[[PXX, PXY, PXY, PYY]].T.reshape(-1, 2, 2),
            weights=rows[WEIGHT],
            ages=self._time - tags[SEEN],
            labels=tags[LABEL].astype(np.int64),
        )


def _gather(
    rows: FloatArray, group: IntArray, order: IntArray, limit: float
) -> tuple[IntArray, IntArray]:
    """Which component each of rows (ROWS, N) merges into, and the heaviest of each of those.

    order (N,): by rising weight. A member further than `limit` (squared Mahalanobis distance, in
    the sum of both covariances) from its group's heaviest stays by itself.
    """
    n = rows.shape[1]
    heaviest = np.zeros(int(group.max(initial=-1)) + 1, dtype=np.int64)
    heaviest[group[order]] = order
    leader = heaviest[group]
    x, y, pxx, pxy, pyy = rows[: PYY + 1]
    dx, dy = x - x[leader], y - y[leader]
    sxx, sxy, syy = pxx + pxx[leader], pxy + pxy[leader], pyy + pyy[leader]
    square = syy * dx * dx - 2.0 * sxy * dx * dy + sxx * dy * dy
    itself = np.arange(n)
    leader = np.where(square > limit * (sxx * syy - sxy * sxy), itself, leader)
    kept = (leader == itself).nonzero()[0]
    itself[kept] = np.arange(len(kept))
    return itself[leader], kept
