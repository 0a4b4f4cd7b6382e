"""The sound Gaussian-mixture PHD filter over position and kind: teammate or obstacle.

The recursion is Vo and Ma 2006 with the sensors of Perera 2021 and what the thesis leaves out:
clutter, the innovation covariance, birth from readings, merging, and a memory of what was
reported. A component is a thing that stands somewhere, under two hypotheses of what it is: a
teammate moves and shows a red strip to the cameras, an obstacle does neither; to the lidar they
look alike. So the lidar tells that something is there, and motion and cameras tell what it is.
Every step is linear in the number of components. docs/filters.md derives it.
"""

import numpy as np

from host.config import Cameras, FilterSettings, Lidar
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
    range_support,
    update_by_bearings,
    update_by_positions,
)
from host.estimator.sensor_models import CameraModel, LidarModel, clearance_of
from host.messages import Bearings, Displacement, Estimate, FloatArray, IntArray, Positions

TEAMMATE, OBSTACLE = 0, 1
_MIXTURE = slice(0, 2 * ROWS)  # of the state: the rows of both kinds, as (ROWS, 2, n)
# Then time of the last position reading (s), 1 if reported, a number to know it by (0 until it is
# reported), index of the parent.
SEEN, CONFIRMED, LABEL, PARENT = range(2 * ROWS, 2 * ROWS + 4)
_STATE = 2 * ROWS + 4
_FADE_S = 1.0  # mean survival beyond the survival range
_DOUBTED = 0.15  # below this share a reported teammate is one no longer
_WEIGHTLESS = 1e-12  # keeps the moments of a ruled-out kind finite
_NARROWEST_RAD = 1e-3  # half width of a view that shows nothing
_BELIEVED = 0.5  # from this weight on a component can hide another
_STANDING = 0.5  # share of the time in which a teammate does not move
# Successive pictures show the same scene: what they say of a kind counts as so much of independent
# evidence.
_PICTURE_POWER = 0.3
_LEAST_SHARE = 0.005  # neither kind is ever ruled out: a standing robot drives off again


class PhdFilter:
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    def __init__(
        self,
        settings: FilterSettings | None = None,
        lidar: Lidar | None = None,
        camera: Cameras | None = None,
    ) -> None:
        self._settings = settings or FilterSettings()
        self._lidar = LidarModel(lidar or Lidar())
        camera = camera or Cameras()
        self._camera = CameraModel(camera)
        self._use_ranges, self._camera_reach_m = camera.use_ranges, camera.max_range_m
        self._width = (lidar or Lidar()).target_diameter_m
        self._state = np.zeros((_STATE, 0))
        self._time = 0.0
        self._next_label = 1

    @property
    def _rows(self) -> FloatArray:
        """The mixture (ROWS, 2, n), a view: by quantity, kind and component."""
        return _rows_of(self._state)

    def predict(self, motion: Displacement) -> None:
        """Eq. 7–10 repaired: carry, spread teammates (not obstacles), fade what is far."""
        rows, settings, dt = self._rows, self._settings, motion.interval
        self._time = motion.time
        unseen = np.maximum(self._time - 0.5 * dt - self._state[SEEN], 0.0)  # in the middle
        rate = settings.motion_noise_m**2 * (1.0 + settings.motion_growth_per_s * unseen)
        noise = np.zeros((2, len(rate)))
        noise[TEAMMATE] = rate * dt
        carry(rows, motion, noise)
        far = np.hypot(rows[X, TEAMMATE], rows[Y, TEAMMATE]) > settings.survival_range_m
        rows[WEIGHT] *= np.exp(-dt / settings.survival_s - far * (dt / _FADE_S))

    def update(self, measurement: Positions | Bearings) -> None:
        """Eq. 6 with clutter; lidar positions or camera bearings, in any order."""
        if isinstance(measurement, Positions):
            self._update_positions(measurement)
        elif self._state.shape[1]:
            self._update_bearings(measurement)

    def _update_positions(self, measured: Positions) -> None:
        state, rows, settings = self._state, self._rows, self._settings
        n, m = state.shape[1], len(measured.positions)
        bearing, distance, clearance = self._surroundings(measured.clearance)
        detected = self._lidar.detection(
            bearing, distance, clearance, measured.clearance is not None
        )
        i, j = near(rows[:, TEAMMATE], measured.positions, measured.covariances, settings.gate)
        born = self._born(measured)
        noise = _rows_of(born)[PXX:WEIGHT]
        if measured.lags is not None:
            noise = noise.copy()
            noise[::2, TEAMMATE] += settings.motion_noise_m**2 * measured.lags
        prior = state.take(i, axis=1)
        updated, likelihood = update_by_positions(
            _rows_of(prior), measured.positions.take(j, axis=0).T[:, None], noise.take(j, axis=2)
        )
        # A teammate may stand still; an obstacle never moves.
        likelihood[TEAMMATE] += _STANDING * (likelihood[OBSTACLE] - likelihood[TEAMMATE])
        updated[WEIGHT] *= detected.take(i) * likelihood
        mass = updated[WEIGHT, TEAMMATE] + updated[WEIGHT, OBSTACLE]
        share = 1.0 / (np.bincount(j, mass, m) + (self._lidar.clutter + settings.birth_per_m2))
        scale = share.take(j)
        mass *= scale
        updated[WEIGHT] *= scale
        _rows_of(born)[WEIGHT] *= share
        prior[_MIXTURE] = updated.reshape(2 * ROWS, -1)
        prior[SEEN], prior[PARENT] = measured.time, i
        # What was seen of a thing was not missed as well: it gives one reading a turn.
        rows[WEIGHT] *= (1.0 - detected) * np.maximum(1.0 - np.bincount(i, mass, n), 0.0)
        state[PARENT] = np.arange(n)

        # One group a reading. What was missed joins that of its likeliest reading, unless that
        # reading is hardly its own.
        left = rows[WEIGHT, TEAMMATE] + rows[WEIGHT, OBSTACLE]
        home = np.arange(m, m + n)
        order = mass.argsort()
        order = order[mass.take(order) > 0.1 * left.take(i.take(order))]
        home[i.take(order)] = j.take(order)
        self._merge(
            np.concatenate((state, prior, born), axis=1),
            np.concatenate((home, j, np.arange(m))),
        )
        self._inherit(n)

    def _born(self, measured: Positions) -> FloatArray:
        """A component at each reading, of the intensity of birth: state (_STATE, m)."""
        born = np.zeros((_STATE, len(measured.positions)))
        rows = _rows_of(born)
        rows[X], rows[Y] = measured.positions.T
        rows[PXX:WEIGHT] = measured.covariances.reshape(-1, 4).T.take((0, 1, 3), axis=0)[:, None]
        settings = self._settings
        rows[WEIGHT, TEAMMATE] = settings.birth_per_m2 * (1.0 - settings.obstacle_share)
        rows[WEIGHT, OBSTACLE] = settings.birth_per_m2 * settings.obstacle_share
        born[SEEN], born[PARENT] = measured.time, self._state.shape[1]
        return born

    def _update_bearings(self, measured: Bearings) -> None:
        """The cameras: Bayes' rule for the kind of each component, and where it stands.

        Of a blob that several may have caused, the others count as clutter for each.
        """
        rows, settings = self._rows, self._settings
        prior = rows[:, TEAMMATE]
        n, m = prior.shape[1], len(measured.bearings)
        bearing, distance, clearance = self._surroundings(None)
        detected = self._camera.detection(bearing, distance, clearance, measured.view)
        lag = settings.motion_noise_m**2 * measured.lag
        pairs = update_by_bearings(prior, measured, lag, settings.gate)
        i, j = pairs.component, pairs.reading
        support = detected[i] * pairs.likelihood
        if self._use_ranges:
            support *= range_support(prior, measured, pairs, self._camera_reach_m)
        mass = support * prior[WEIGHT, i]
        # Blobs beyond what is expected come from teammates that the lidar has not shown yet.
        width = 2.0 * max(measured.view[1], _NARROWEST_RAD)
        unknown = max(0.0, m - float(detected @ prior[WEIGHT])) / width
        others = np.bincount(j, mass, m)[j] - mass + self._camera.clutter + unknown
        family = np.concatenate((prior, pairs.updated), axis=1)
        family[WEIGHT, :n] *= 1.0 - detected
        family[WEIGHT, n:] *= support / others
        parent = np.concatenate((np.arange(n), i))
        before = rows[WEIGHT].copy()
        rows[:, TEAMMATE] = match_moments(family, parent, prior[: Y + 1].copy())
        likelihood_ratio = rows[WEIGHT, TEAMMATE] / before[TEAMMATE]
        rows[WEIGHT, TEAMMATE] = before[TEAMMATE] * likelihood_ratio**_PICTURE_POWER
        # Only the kind is new, not how surely something is there.
        rows[WEIGHT] *= before.sum(axis=0) / rows[WEIGHT].sum(axis=0)
        self._confirm()

    def _surroundings(
        self, clearance: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bearing and distance of each component, and how far one sees in every sector."""
        rows = self._rows
        x, y = rows[X, TEAMMATE], rows[Y, TEAMMATE]
        bearing, distance = np.arctan2(y, x), np.hypot(x, y)
        if clearance is None:
            believed = rows[WEIGHT, TEAMMATE] + rows[WEIGHT, OBSTACLE] > _BELIEVED
            clearance = clearance_of(bearing, distance, believed, self._width)
        return bearing, distance, clearance

    def _merge(self, state: FloatArray, group: IntArray) -> None:
        """Merge each group of state (_STATE, N) into its heaviest, cap and prune.

        group (N,): whole numbers below N. Members whose squared distance from the heaviest is
        more than merge_distance times the mean variance of both stay by themselves.
        """
        rows = _rows_of(state)
        rows[WEIGHT] += _WEIGHTLESS
        order = (rows[WEIGHT, TEAMMATE] + rows[WEIGHT, OBSTACLE]).argsort()
        leader = np.empty(len(group), dtype=np.int64)
        leader[group.take(order)] = order  # the heaviest is written last
        leader = leader.take(group)
        x, y = rows[X, TEAMMATE], rows[Y, TEAMMATE]
        dx, dy = x - x.take(leader), y - y.take(leader)
        spread = rows[PXX, TEAMMATE] + rows[PYY, TEAMMATE]
        spread += spread.take(leader)
        far = (dx * dx + dy * dy > 0.5 * self._settings.merge_distance * spread).nonzero()[0]
        leader[far] = far
        place = np.arange(len(group))
        kept = (leader == place).nonzero()[0]
        place[kept] = np.arange(len(kept))
        merged = state.take(kept, axis=1)
        centres = _rows_of(merged)[: Y + 1]
        merged[_MIXTURE] = match_moments(rows, place.take(leader), centres).reshape(2 * ROWS, -1)
        weights = _rows_of(merged)[WEIGHT]
        total = weights[TEAMMATE] + weights[OBSTACLE]
        weights /= np.maximum(total, 1.0)  # what is merged is one thing
        keep = (total > self._settings.prune_weight).nonzero()[0]
        if len(keep) > self._settings.capacity:
            keep = np.argsort(-total, kind="stable")[: self._settings.capacity]
        self._state = merged.take(keep, axis=1)

    def _inherit(self, parents: int) -> None:
        """Leave label and memory of each parent to its heaviest heir; the others start without."""
        state, weights = self._state, self._rows[WEIGHT]
        parent = state[PARENT].astype(np.int64)
        order = (weights[TEAMMATE] + weights[OBSTACLE]).argsort()
        heir = np.empty(parents + 1, dtype=np.int64)
        heir[parent.take(order)] = order
        heir[parents] = -1
        own = heir.take(parent) == np.arange(len(parent))
        state[CONFIRMED] *= own
        state[LABEL] *= own
        self._confirm()

    def _confirm(self) -> None:
        """Rule no kind out; report from report_weight on, while there and likely a teammate."""
        settings, weight = self._settings, self._rows[WEIGHT]
        total = weight[TEAMMATE] + weight[OBSTACLE]
        if settings.obstacle_share:
            weight *= 1.0 - 2.0 * _LEAST_SHARE
            weight += _LEAST_SHARE * total
        confirmed = (weight[TEAMMATE] > _DOUBTED * total) & (total > settings.forget_weight)
        confirmed &= self._state[CONFIRMED] > 0.0
        confirmed |= weight[TEAMMATE] > settings.report_weight
        self._state[CONFIRMED] = confirmed
        new = (confirmed > self._state[LABEL]).nonzero()[0]
        if len(new):
            self._state[LABEL, new] = np.arange(self._next_label, self._next_label + len(new))
            self._next_label += len(new)

    def estimate(self) -> Estimate:
        """Teammates reported: see `_confirm`, and where they are known to report_sigma_m."""
        rows, state = self._rows[:, TEAMMATE], self._state
        known = rows[PXX] + rows[PYY] < 2.0 * self._settings.report_sigma_m**2
        known &= rows[WEIGHT] > _DOUBTED * self._settings.forget_weight
        index = (known * state[CONFIRMED]).nonzero()[0]
        rows, state = rows.take(index, axis=1), state.take(index, axis=1)
        return Estimate(
            time=self._time,
            positions=rows[: Y + 1].T,
            covariances=rows[[PXX, PXY, PXY, PYY]].T.reshape(-1, 2, 2),
            weights=rows[WEIGHT],
            ages=self._time - state[SEEN],
            labels=state[LABEL].astype(np.int64),
        )


def _rows_of(state: FloatArray) -> FloatArray:
    # A view only of contiguous memory: so columns are picked by take, never by an index array.
    return state[_MIXTURE].reshape(ROWS, 2, -1)
