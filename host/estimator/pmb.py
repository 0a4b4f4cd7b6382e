"""The Poisson multi-Bernoulli filter over position, velocity, motion mode and class.

The recursion is TOMB/P of Williams 2015 ("Marginal multi-Bernoulli filters: RFS derivation of MHT,
JIPDA and association-based MeMBer", IEEE Trans. Aerospace and Electronic Systems 51(3)), with the
association's marginals by loopy belief propagation (`association`). Each Bernoulli is one thing
that may be there: an obstacle, or a teammate that stands, moves or cruises (`thing_modes`). To the
lidar they look alike but for how they move; the cameras see teammates only. The steps: predict; for
each set of readings detection, pairs, association, mixture, birth; reduce; label; report.
docs/filters.md derives it.
"""

import math

import numpy as np

from host.config import Cameras, FilterSettings, Lidar
from host.estimator.association import associate
from host.estimator.duplicates import duplicates
from host.estimator.evidence import likeness, new_share
from host.estimator.gaussian_mixture import PXX, PXY, PYY
from host.estimator.gaussian_mixture import WEIGHT as TOTAL
from host.estimator.moving_gaussians import ROWS, WEIGHT, X, Y, match_moments
from host.estimator.pairing import Pairs, pair_bearings, pair_positions, with_ranges
from host.estimator.sensor_models import (
    CameraModel,
    LidarModel,
    in_view,
    surroundings,
    survival,
)
from host.estimator.static_world import StaticWorld
from host.estimator.thing_modes import (
    MODES,
    OBSTACLE,
    PARKED,
    STATIC,
    TEAMMATE,
    ThingModes,
    mixture,
)
from host.message_checks import check
from host.messages import Bearings, BoolArray, Displacement, Estimate, FloatArray, Positions

# What is kept of each Bernoulli beside its Gaussians: when the lidar last placed it (s) and with
# which variance (m²), when a picture last had it in view (s), its label (0 until it is reported).
SEEN, VARIANCE, PICTURED, LABEL = range(4)
_BELIEVED = 0.5  # from this existence on a thing is taken to be there
_NARROWEST_RAD = 1e-3  # half width of a view that shows nothing
# Correlation times: misses follow each other, and pictures show the same scene.
_SCANS_S, _PICTURES_S = 0.3, 0.3
_LIDAR_FLOOR_M2 = 0.002**2  # what differs in how a turret looks from place to place
_LEAST_EXISTENCE = 1e-3  # below this a thing is dropped
_LONGEST_S = 1.0  # things that appeared longer ago were seen before or have gone


class PmbFilter:
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    def __init__(
        self,
        settings: FilterSettings | None = None,
        lidar: Lidar | None = None,
        camera: Cameras | None = None,
    ) -> None:
        self._settings = settings or FilterSettings()
        self._modes = ThingModes(self._settings.pmb)
        self._world = StaticWorld(self._settings.gate)
        lidar, camera = lidar or Lidar(), camera or Cameras()
        self._lidar, self._camera = LidarModel(lidar), CameraModel(camera)
        self._use_ranges, self._camera_reach_m = camera.use_ranges, camera.max_range_m
        self._width = lidar.target_diameter_m
        # Weights are the probability that the thing is there and in that mode.
        self._rows = np.zeros((ROWS, MODES, 0))
        self._tracks = np.zeros((4, 0))
        self._time = 0.0
        self._scanned = -math.inf
        self._next_label = 1

    def predict(self, motion: Displacement) -> None:
        """Williams 2015 thm. 1: each Bernoulli moves on and survives with p_S."""
        check(motion)
        self._time = motion.time
        self._world.predict(motion)
        if not self._rows.shape[2]:
            return
        self._rows = self._modes.predict(self._rows, motion)
        whole = mixture(self._rows)
        self._rows[WEIGHT] *= survival(whole[X], whole[Y], motion.interval, self._settings)

    def update(self, measurement: Positions | Bearings) -> None:
        """Williams 2015 thm. 2 and TOMB/P for lidar positions or camera bearings, in any order."""
        check(measurement)
        if isinstance(measurement, Positions):
            self._update_by_lidar(measurement)
        elif self._rows.shape[2]:
            self._update_by_cameras(measurement)
        self._reduce()
        self._label()

    def _update_by_lidar(self, measured: Positions) -> None:
        """Readings of things whatever they are; a miss counts by the time since the last scan."""
        settings, rows, whole = self._settings, self._rows, mixture(self._rows)
        n, m = rows.shape[2], len(measured.positions)
        elapsed = min(measured.time - self._scanned, _LONGEST_S)
        self._scanned = measured.time
        noise = measured.covariances + _LIDAR_FLOOR_M2 * np.eye(2)
        detected = self._lidar_detection(rows, whole, measured.clearance)
        pairs = pair_positions(rows, whole, measured, noise, settings.gate)
        pairs.updated[WEIGHT] *= detected.take(pairs.target, axis=1)
        missing = (1.0 - detected) ** new_share(elapsed, _SCANS_S)
        absent = 1.0 - whole[TOTAL] + (rows[WEIGHT] * missing).sum(axis=0)
        birth = settings.pmb.appear_per_m2_s * elapsed
        remembered = self._remembered_detection(measured.clearance)
        known = self._world.intensity(measured, noise, remembered)
        background = self._lidar.clutter / likeness(measured) + birth + known.sum(axis=0)
        mass = pairs.mass()
        ratios = mass / (absent.take(pairs.target) * background.take(pairs.reading))
        found = associate(pairs.target, pairs.reading, ratios, n, m)
        rows[WEIGHT] *= found.missed * missing / absent
        pairs.updated[WEIGHT] *= found.pairs / np.maximum(mass, 1e-300)
        self._rows = _merged(rows, pairs, whole)
        placed = (found.pairs > 0.5).nonzero()[0]
        self._tracks[SEEN, pairs.target[placed]] = measured.time
        self._tracks[VARIANCE, pairs.target[placed]] = _per_axis(noise)[pairs.reading[placed]]
        new = found.unclaimed / background
        self._bear(measured, noise, new * birth, new * known)
        self._merge_duplicates()
        self._remember_obstacles(remembered, elapsed)

    def _lidar_detection(
        self, rows: FloatArray, whole: FloatArray, measured: FloatArray | None
    ) -> FloatArray:
        """P_D (MODES, n) of each thing (Perera eq. 18); measured: the scan's own clearance."""
        _, _, clearance = self._surroundings(whole, measured)
        x, y = rows[X].ravel(), rows[Y].ravel()
        bearing, distance = np.arctan2(y, x), np.hypot(x, y)
        found = self._lidar.detection(bearing, distance, clearance, measured is not None)
        return found.reshape(MODES, -1)

    def _remembered_detection(self, measured: FloatArray | None) -> FloatArray:
        """P_D (k,) of each obstacle that is remembered; measured: the scan's own clearance."""
        bearing, distance, clearance = self._surroundings(self._world.rows, measured)
        return self._lidar.detection(bearing, distance, clearance, measured is not None)

    def _bear(
        self, measured: Positions, noise: FloatArray, existence: FloatArray, known: FloatArray
    ) -> None:
        """A Bernoulli for each reading (m,), with the probability that it is a new thing.

        known (2, m): the probability that it is an obstacle, or stands, and is remembered.

        What does not look like a turret is rather an obstacle. That it does is no evidence for a
        teammate: what looks like one in this revolution, a post, does so in the next.
        """
        obstacle = self._settings.pmb.obstacle_share
        teammate = (1.0 - obstacle) * likeness(measured)
        lags = 0.0 if measured.lags is None else measured.lags
        born = self._modes.born(
            measured.positions, noise, lags, existence * teammate, existence * obstacle
        )
        born[WEIGHT, OBSTACLE] += known[0]
        born[WEIGHT, PARKED] += known[1]
        tracks = np.zeros((4, len(existence)))
        tracks[SEEN], tracks[PICTURED] = measured.time, -math.inf
        tracks[VARIANCE] = _per_axis(noise)
        self._rows = np.concatenate((self._rows, born), axis=2)
        self._tracks = np.concatenate((self._tracks, tracks), axis=1)

    def _remember_obstacles(self, remembered: FloatArray, elapsed: float) -> None:
        """Tell the static world what stands still; remembered (k,): P_D of what it holds."""
        standing = mixture(self._rows[:, STATIC])
        there = (standing[TOTAL] > _BELIEVED).nonzero()[0]
        weights = self._rows[WEIGHT].take(there, axis=1)
        obstacle = weights[OBSTACLE] / weights.sum(axis=0)
        self._world.learn(standing.take(there, axis=1), obstacle, remembered, elapsed)

    def _merge_duplicates(self) -> None:
        """Of two hypotheses of one thing the newer stays, with both weights and the older's label.

        They are exclusive: a reading belongs to one of them.
        """
        whole, tracks, weights = mixture(self._rows), self._tracks, self._rows[WEIGHT]
        gone, kept = duplicates(whole[: Y + 1], tracks[VARIANCE], tracks[SEEN], whole[TOTAL])
        there, n = np.maximum(whole[TOTAL], 1e-300), len(whole[TOTAL])
        both = np.minimum(there + np.bincount(kept, there.take(gone), n), 1.0)
        weights *= np.where(np.bincount(kept, minlength=n) > 0, both / there, 1.0)
        weights[:, gone] = 0.0
        labels = np.where(tracks[LABEL] > 0.0, tracks[LABEL], math.inf)
        np.minimum.at(labels, kept, labels.take(gone))
        tracks[LABEL] = np.where(labels < math.inf, labels, 0.0)

    def _update_by_cameras(self, measured: Bearings) -> None:
        """Readings of teammates only: what has no strip is an obstacle, or not there.

        L = 1 - P_D + sum over z of P_D N(z) nu(z) / kappa for each teammate mode, and 1 otherwise;
        it counts with the share of it that is new.
        """
        settings, whole = self._settings, mixture(self._rows)
        rows, teammates = self._rows, self._rows[:, TEAMMATE]
        n, m = rows.shape[2], len(measured.bearings)
        detected, share = self._camera_detection(whole, measured)
        pairs = pair_bearings(teammates, whole, measured, share, settings.gate)
        if self._use_ranges:
            pairs = with_ranges(pairs, measured, share, self._camera_reach_m)
        pairs.updated[WEIGHT] *= detected.take(pairs.target)
        expected = detected * teammates[WEIGHT].sum(axis=0)
        # Strips beyond what is expected are of teammates that the lidar has not shown yet.
        width = 2.0 * max(measured.view[1], _NARROWEST_RAD)
        clutter = self._camera.clutter + max(0.0, m - float(expected.sum())) / width
        ratios = pairs.mass() / ((1.0 - expected).take(pairs.target) * clutter)
        found = associate(pairs.target, pairs.reading, ratios, n, m)
        pairs.updated[WEIGHT] *= found.messages / clutter
        before = np.maximum(teammates[WEIGHT], 1e-20)
        teammates = teammates.copy()
        teammates[WEIGHT] *= 1.0 - detected
        after = _merged(teammates, pairs, whole)
        after[WEIGHT] = before * (after[WEIGHT] / before) ** share
        rows[WEIGHT] /= 1.0 - before.sum(axis=0) + after[WEIGHT].sum(axis=0)
        after[WEIGHT] /= 1.0 - before.sum(axis=0) + after[WEIGHT].sum(axis=0)
        rows[:, TEAMMATE] = after

    def _camera_detection(
        self, whole: FloatArray, measured: Bearings
    ) -> tuple[FloatArray, FloatArray]:
        """P_D (n,) of each thing if it is a teammate (eq. 29); share of evidence that is new."""
        bearing, distance, clearance = self._surroundings(whole, None)
        detected = self._camera.detection(bearing, distance, clearance, measured.view)
        pictured, taken = self._tracks[PICTURED], measured.time - measured.lag
        share = new_share(taken - pictured, _PICTURES_S)
        pictured[in_view(bearing, measured.view)] = taken
        return detected, np.maximum(share, 1e-6)

    def _surroundings(
        self, whole: FloatArray, clearance: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `sensor_models.surroundings`, of things as Gaussians (ROWS, n)."""
        return surroundings(whole[X], whole[Y], whole[TOTAL], self._width, clearance)

    def _reduce(self) -> None:
        """Drop what is hardly there."""
        there = self._rows[WEIGHT].sum(axis=0)
        kept = (there > _LEAST_EXISTENCE).nonzero()[0]
        self._rows, self._tracks = self._rows.take(kept, 2), self._tracks.take(kept, 1)

    def _label(self) -> None:
        """Number what is reported for the first time."""
        new = (self._reported(self._teammates()) & (self._tracks[LABEL] == 0.0)).nonzero()[0]
        self._tracks[LABEL, new] = np.arange(self._next_label, self._next_label + len(new))
        self._next_label += len(new)

    def _teammates(self) -> FloatArray:
        """Each thing as a teammate, as one Gaussian (6, n)."""
        return mixture(self._rows[:, TEAMMATE])

    def _reported(self, teammates: FloatArray) -> BoolArray:
        """Which Bernoullis (n,) lower the expected GOSPA (p = 2, cut-off c) by their report.

        Missed, a teammate costs c²/2; reported, its squared error, or c²/2 if it is none:
        w tr P + (1 - w) c²/2 < w c²/2.
        """
        half = 0.5 * self._settings.pmb.report_error_m**2
        error = teammates[PXX] + teammates[PYY]
        return np.asarray(teammates[TOTAL] * (2.0 * half - error) > half)

    def estimate(self) -> Estimate:
        """The teammates that are worth a report."""
        teammates = self._teammates()
        index = self._reported(teammates).nonzero()[0]
        teammates, tracks = teammates.take(index, 1), self._tracks.take(index, 1)
        places, spreads = self._world.believed()
        return Estimate(
            time=self._time,
            positions=teammates[: Y + 1].T,
            covariances=teammates[[PXX, PXY, PXY, PYY]].T.reshape(-1, 2, 2),
            weights=teammates[TOTAL],
            ages=self._time - tracks[SEEN],
            labels=tracks[LABEL].astype(np.int64),
            obstacles=places,
            obstacle_covariances=spreads,
        )


def _per_axis(covariances: FloatArray) -> FloatArray:
    """The mean variance (m,) over the axes of covariances (m, 2, 2)."""
    return np.asarray(0.5 * np.trace(covariances, axis1=1, axis2=2))


def _merged(missed: FloatArray, pairs: Pairs, whole: FloatArray) -> FloatArray:
    """Each Bernoulli (ROWS, k, n) as one Gaussian a mode, over missed and all its readings."""
    n = missed.shape[2]
    terms = np.concatenate((missed, pairs.updated), axis=2)
    into = np.concatenate((np.arange(n), pairs.target))
    return match_moments(terms, into, whole[: Y + 1])
