"""The Gaussian-mixture PHD filter over position and kind: teammate or obstacle.

The recursion is that of Vo and Ma 2006 (eq. 15, 16; propositions 1, 2) with the sensors of Perera
2021 and what the thesis leaves out: clutter, the innovation covariance, birth from readings,
merging, and a memory of what was reported. A component is a thing that stands somewhere, under two
hypotheses of what it is: a teammate moves and shows a red strip to the cameras, an obstacle does
neither; to the lidar they look alike. So the lidar shows that something is there, and motion and
cameras show what it is. Every step is linear in the number of components. docs/filters.md derives
it. The steps: predict; for each set of readings detection, association, update, merge, confirm;
report.
"""

import math

import numpy as np

from host.config import Cameras, FilterSettings, Lidar
from host.estimator.evidence import likeness
from host.estimator.gaussians.gaussian_mixture import (
    PXX,
    PXY,
    PYY,
    ROWS,
    WEIGHT,
    Y,
    gated_pairs,
    match_moments,
    predict_mixture,
    range_support,
    update_by_bearings,
    update_by_positions,
)
from host.estimator.gaussians.reduction import groups_by_reading, merge, pass_on_labels
from host.estimator.learnt_lidar import LearntLidar
from host.estimator.sensor_models import CameraModel, surroundings, survival
from host.estimator.things.kinds import (
    CONFIRMED,
    LABEL,
    MIXTURE,
    OBSTACLE,
    PARENT,
    SEEN,
    STATE,
    TEAMMATE,
    born_at,
    existence,
    rows_of,
)
from host.message_checks import check
from host.messages import Bearings, Displacement, Estimate, FloatArray, IntArray, Positions

_DOUBTED = 0.15  # below this share a reported teammate is one no longer
_LONGEST_S = 1.0  # without a scan, of which more says nothing
_NARROWEST_RAD = 1e-3  # half width of a view that shows nothing
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
        self._lidar = self.learnt = LearntLidar(lidar or Lidar())
        camera = camera or Cameras()
        self._camera = CameraModel(camera)
        self._use_ranges, self._camera_reach_m = camera.use_ranges, camera.max_range_m
        self._width = (lidar or Lidar()).target_diameter_m
        self._state = np.zeros((STATE, 0))
        self._time, self._scanned = 0.0, -math.inf
        self._next_label = 1

    def predict(self, motion: Displacement) -> None:
        """Vo & Ma prop. 1 in the moving frame of Perera eq. 7–10 (repaired).

        w' = p_S w,  m' = R(dpsi)^T (m - d),  P' = R^T P R + Q; births wait for readings.
        """
        check(motion)
        rows = rows_of(self._state)
        self._time = motion.time
        predict_mixture(rows, motion, self._motion_noise(motion.interval))
        x, y = rows[: Y + 1, TEAMMATE]
        rows[WEIGHT] *= survival(x, y, motion.interval, self._settings)

    def _motion_noise(self, dt: float) -> FloatArray:
        """Q of each kind and component (2, n), m² per axis: q² dt (1 + g a), 0 for obstacles.

        a: time since the lidar last placed it, in the middle of the interval. A robot keeps its
        direction for a while, so unseen it is known less well than a random walk says.
        """
        settings = self._settings
        unseen = np.maximum(self._time - 0.5 * dt - self._state[SEEN], 0.0)
        rate = settings.motion_noise_m**2 * (1.0 + settings.motion_growth_per_s * unseen)
        noise = np.zeros((2, len(rate)))
        noise[TEAMMATE] = rate * dt
        return noise

    def update(self, measurement: Positions | Bearings) -> None:
        """Vo & Ma eq. 16 for lidar positions or camera bearings, in any order."""
        check(measurement)
        if isinstance(measurement, Positions):
            self._update_by_lidar(measurement)
        elif self._state.shape[1]:
            self._update_by_cameras(measurement)

    def _update_by_lidar(self, measured: Positions) -> None:
        """Vo & Ma prop. 2: what was missed, what was seen, what is born; then merged."""
        state, settings, m = self._state, self._settings, len(measured.positions)
        rows, n = rows_of(state), state.shape[1]
        detected = self._lidar_detection(measured.clearance)
        i, j = gated_pairs(
            rows[:, TEAMMATE], measured.positions, measured.covariances, settings.gate
        )
        born = born_at(measured, settings, parent=n)
        seen, likelihood = self._kalman_updates(measured, born, i, j)
        clutter = self._lidar.clutter / likeness(measured)
        mass = self._weigh(rows_of(seen), rows_of(born), detected.take(i) * likelihood, j, clutter)
        self._learn(measured, detected, i, mass)
        # What was seen of a thing was not missed as well: it gives one reading a revolution.
        rows[WEIGHT] *= (1.0 - detected) * np.maximum(1.0 - np.bincount(i, mass, n), 0.0)
        state[PARENT] = np.arange(n)
        group = groups_by_reading(i, j, mass, existence(rows), m)
        self._state = merge(np.concatenate((state, seen, born), axis=1), group, settings)
        pass_on_labels(self._state, parents=n)
        self._confirm()

    def _learn(
        self, measured: Positions, detected: FloatArray, i: IntArray, mass: FloatArray
    ) -> None:
        """How the lidar does, by the components' P_D (n,) and the weights of the pairs (p,)."""
        rows, elapsed = rows_of(self._state), min(measured.time - self._scanned, _LONGEST_S)
        self._scanned = measured.time
        found = np.asarray(np.bincount(i, mass, len(detected)), dtype=np.float64)
        self._lidar.learn(rows[WEIGHT, TEAMMATE], detected, found, elapsed)
        explained = mass * np.minimum(existence(rows), 1.0).take(i)
        unexplained = len(measured.positions) - float(explained.sum())
        self._lidar.learn_clutter(unexplained, measured.clearance, elapsed)

    def _lidar_detection(self, measured_clearance: FloatArray | None) -> FloatArray:
        """P_D (n,) of each component (Perera eq. 18)."""
        bearing, distance, clearance = self._surroundings(measured_clearance)
        return self._lidar.detection(bearing, distance, clearance, measured_clearance is not None)

    def _kalman_updates(
        self, measured: Positions, born: FloatArray, i: IntArray, j: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Component i updated by reading j, for all pairs (p,): its state, and q(z) of each kind.

        Perera eq. 13, 14, 16, and 15 with the innovation's covariance S = P + R. Returns states
        (STATE, p), weights as before, and N(z; m, S) (2, p) in 1/m².
        """
        noise = rows_of(born)[PXX:WEIGHT]
        if measured.lags is not None:  # teammates have moved since
            noise = noise.copy()
            noise[::2, TEAMMATE] += self._settings.motion_noise_m**2 * measured.lags
        updated = self._state.take(i, axis=1)
        rows, likelihood = update_by_positions(
            rows_of(updated), measured.positions.take(j, axis=0).T[:, None], noise.take(j, axis=2)
        )
        # A teammate may stand still; an obstacle never moves.
        likelihood[TEAMMATE] += _STANDING * (likelihood[OBSTACLE] - likelihood[TEAMMATE])
        updated[MIXTURE] = rows.reshape(2 * ROWS, -1)
        updated[SEEN], updated[PARENT] = measured.time, i
        return updated, likelihood

    def _weigh(
        self,
        seen: FloatArray,
        born: FloatArray,
        factor: FloatArray,
        j: IntArray,
        clutter: FloatArray,
    ) -> FloatArray:
        """Weights of what was seen and born, in place; returns those of the pairs (p,).

        w'(i, z) = P_D(i) w(i) q(i, z) / (kappa + beta + sum over k of P_D(k) w(k) q(k, z))
        (Vo & Ma prop. 2 with births beta from the readings); factor (2, p): P_D(i) q(i, z);
        clutter kappa (m,): 1/m², more where a reading looks less like a turret.
        """
        seen[WEIGHT] *= factor
        mass = existence(seen)
        background = clutter + self._settings.birth_per_m2
        share = 1.0 / (np.bincount(j, mass, born.shape[2]) + background)
        scale = share.take(j)
        mass *= scale
        seen[WEIGHT] *= scale
        born[WEIGHT] *= share
        return mass

    def _update_by_cameras(self, measured: Bearings) -> None:
        """Bayes' rule for the kind of each component, and where it stands (docs/filters.md)."""
        rows = rows_of(self._state)
        before = rows[WEIGHT].copy()
        terms, parent = self._likelihood_terms(measured)
        rows[:, TEAMMATE] = match_moments(terms, parent, rows[: Y + 1, TEAMMATE].copy())
        likelihood_ratio = rows[WEIGHT, TEAMMATE] / before[TEAMMATE]
        rows[WEIGHT, TEAMMATE] = before[TEAMMATE] * likelihood_ratio**_PICTURE_POWER
        # Only the kind is new, not how surely something is there.
        rows[WEIGHT] *= before.sum(axis=0) / rows[WEIGHT].sum(axis=0)
        self._confirm()

    def _likelihood_terms(self, measured: Bearings) -> tuple[FloatArray, IntArray]:
        """The terms of each teammate's L(i) as Gaussians (ROWS, n + p), and their i (n + p,).

        L(i) = 1 - P_D(i) + sum over z of P_D(i) N(z; h(m), S) / (kappa + sum over k != i of P_D(k)
        w(k) N(z; h(m(k)), S(k))): of a blob that several may have caused, the others count as
        clutter for each. N is that of Perera eq. 27 with S, and by the strip's size.
        """
        prior, settings = rows_of(self._state)[:, TEAMMATE], self._settings
        n, m = prior.shape[1], len(measured.bearings)
        bearing, distance, clearance = self._surroundings(None)
        detected = self._camera.detection(bearing, distance, clearance, measured.view)
        lag_variance = settings.motion_noise_m**2 * measured.lag
        pairs = update_by_bearings(prior, measured, lag_variance, settings.gate)
        i, j = pairs.component, pairs.reading
        support = detected[i] * pairs.likelihood
        if self._use_ranges:
            support *= range_support(prior, measured, pairs, self._camera_reach_m)
        mass = support * prior[WEIGHT, i]
        # Blobs beyond what is expected come from teammates that the lidar has not shown yet.
        width = 2.0 * max(measured.view[1], _NARROWEST_RAD)
        unknown = max(0.0, m - float(detected @ prior[WEIGHT])) / width
        others = np.bincount(j, mass, m)[j] - mass + self._camera.clutter + unknown
        terms = np.concatenate((prior, pairs.updated), axis=1)
        terms[WEIGHT, :n] *= 1.0 - detected
        terms[WEIGHT, n:] *= support / others
        return terms, np.concatenate((np.arange(n), i))

    def _surroundings(
        self, clearance: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `sensor_models.surroundings`, of the components."""
        rows = rows_of(self._state)
        x, y = rows[: Y + 1, TEAMMATE]
        return surroundings(x, y, existence(rows), self._width, clearance)

    def _confirm(self) -> None:
        """Mark who is reported: from report_weight on, while there and likely a teammate.

        A PHD forgets: one miss takes a weight to 1 - P_D. So who was reported needs less.
        """
        state, settings = self._state, self._settings
        weight, total = rows_of(state)[WEIGHT], existence(rows_of(state))
        if settings.obstacle_share:
            weight *= 1.0 - 2.0 * _LEAST_SHARE
            weight += _LEAST_SHARE * total
        confirmed = (weight[TEAMMATE] > _DOUBTED * total) & (total > settings.forget_weight)
        confirmed &= state[CONFIRMED] > 0.0
        confirmed |= weight[TEAMMATE] > settings.report_weight
        state[CONFIRMED] = confirmed
        new = (confirmed > state[LABEL]).nonzero()[0]
        if len(new):
            state[LABEL, new] = np.arange(self._next_label, self._next_label + len(new))
            self._next_label += len(new)

    def estimate(self) -> Estimate:
        """Report the confirmed teammates (see `_confirm`) that are known to report_sigma_m."""
        rows, state = rows_of(self._state)[:, TEAMMATE], self._state
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
