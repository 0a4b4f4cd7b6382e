"""What `pmb` and `phd` share: things with position, velocity, motion mode and class.

Each is one thing that may be there: an obstacle, or a teammate that stands, moves or cruises
(`thing_modes`). To the lidar they look alike but for how they move; the cameras see teammates only.
The steps: predict; for each set of readings detection, pairs, association, mixture, birth; reduce;
label; report. Whether a weight is a probability or a number is for `pmb` and `phd` to say.
"""

import math
from abc import ABC, abstractmethod

import numpy as np

from host.config import Cameras, FilterSettings, Lidar
from host.estimator.evidence import likeness, new_share
from host.estimator.gaussians.gaussian_mixture import PXX, PXY, PYY, WEIGHT
from host.estimator.gaussians.moving_gaussians import X, Y, absorb, summed
from host.estimator.learnt_lidar import LearntLidar
from host.estimator.sensor_models import CameraModel, in_view, surroundings, survival
from host.estimator.things.association import Association
from host.estimator.things.pairing import pair_bearings, pair_positions
from host.estimator.things.static_world import StaticWorld
from host.estimator.things.strip_births import Places, StripBirths
from host.estimator.things.thing_modes import (
    MOTION_OF,
    MOTIONS,
    OBSTACLE,
    PARKED,
    STILL,
    TEAMMATE,
    ThingModes,
)
from host.estimator.things.things import LABEL, PICTURED, SEEN, Things
from host.message_checks import check
from host.messages import Bearings, BoolArray, Displacement, Estimate, FloatArray, Positions

_STILL_ONLY = np.eye(MOTIONS)[:, [STILL]]  # the motion of obstacles
_BELIEVED = 0.5  # from this existence on a thing is taken to be there
_NARROWEST_RAD = 1e-3  # half width of a view that shows nothing
# Correlation times: misses follow each other, and pictures show the same scene.
_SCANS_S, _PICTURES_S = 0.3, 0.3
_LIDAR_FLOOR = 0.001**2 * np.eye(2)  # m²: what differs in how a turret looks from place to place
_LEARN_S = 0.4  # after so long the static world is brought up to date
LONGEST_S = 1.0  # things that appeared longer ago were seen before or have gone


class ThingFilter(ABC):
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    _associate: "staticmethod[..., Association]"  # as `association.associate`

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
        self._lidar, self._camera = LearntLidar(lidar), CameraModel(camera)
        self.learnt = self._lidar
        self._ranges_to_m = camera.max_range_m if camera.use_ranges else None
        teammates = 1.0 - self._settings.pmb.obstacle_share
        self._births = StripBirths(camera, self._settings.pmb.appear_per_m2_s * teammates)
        self._width = lidar.target_diameter_m
        self._things, self._time, self._next_label = Things(), 0.0, 1
        self._scanned, self._learnt = -math.inf, -math.inf

    def predict(self, motion: Displacement) -> None:
        """Each thing moves on and survives with p_S."""
        check(motion)
        self._time = motion.time
        self._world.predict(motion)
        things = self._things
        if not len(things):
            return
        things.rows, things.weights = self._modes.predict(things.rows, things.weights, motion)
        things.changed()
        things.scale(survival(things.whole[X], things.whole[Y], motion.interval, self._settings))

    def update(self, measurement: Positions | Bearings) -> None:
        """Take in lidar positions or camera bearings, in any order."""
        check(measurement)
        if isinstance(measurement, Positions):
            self._update_by_lidar(measurement)
        else:
            self._update_by_cameras(measurement)
        self._label()

    def _update_by_lidar(self, measured: Positions) -> None:
        """Readings of things whatever they are; a miss counts by the time since the last scan."""
        settings, things = self._settings, self._things
        whole, motions = things.whole, things.motions
        n, m = len(things), len(measured.positions)
        elapsed = min(measured.time - self._scanned, LONGEST_S)
        self._scanned = measured.time
        noise = measured.covariances + _LIDAR_FLOOR
        detected = self._lidar_detection(measured.clearance)
        # Of each pair P_D N(z; H m, S), by motion and summed; of each thing that it gives none.
        pairs = pair_positions(things.rows, whole, measured, noise, settings.gate)
        i, j = pairs.target, pairs.reading
        likelihood = pairs.likelihood * detected.take(i, axis=1)
        mass = (likelihood * motions.take(i, axis=1)).sum(axis=0)
        missing = (1.0 - detected) ** new_share(elapsed, _SCANS_S)
        absent = self._absent(whole[WEIGHT], (motions * missing).sum(axis=0))
        # What else a reading may be, 1/m²: clutter, a new thing, a remembered obstacle.
        birth = settings.pmb.appear_per_m2_s * elapsed
        remembered = self._remembered_detection(measured.clearance)
        known = self._world.intensity(measured, noise, remembered)
        known_total, like_turrets = known[0] + known[1], likeness(measured)
        background = self._lidar.clutter / like_turrets + birth + known_total
        found = self._associate(i, j, mass / (absent.take(i) * background.take(j)), n, m)
        # Under each motion a thing becomes the mixture over its readings and a miss.
        by_reading = likelihood * (found.pairs / np.maximum(mass, 1e-300))
        total = found.missed * missing / absent + summed(by_reading, i, n)
        shares = by_reading / np.maximum(total, 1e-300).take(i, axis=1)
        absorb(things.rows, pairs.changes, i, shares)
        things.weights *= total.take(MOTION_OF, axis=0)
        sure = (found.pairs > 0.5).nonzero()[0]
        variances = 0.5 * (noise[:, 0, 0] + noise[:, 1, 1])
        things.placed(i.take(sure), measured.time, variances.take(j.take(sure)))
        teammates = things.weights[TEAMMATE].sum(axis=0)
        expected = (motions * detected).sum(axis=0)
        self._lidar.learn(teammates, expected, 1.0 - found.missed, elapsed)
        new = found.unclaimed / background
        explained = found.pairs @ whole[WEIGHT].take(i) + new @ known_total
        self._lidar.learn_clutter(m - float(explained), measured.clearance, elapsed)
        born = self._born(measured, noise, new * birth, like_turrets, new * known)
        things.bear(*born, measured.time, variances)
        things.merge_duplicates()
        known_again = (known_total > 0.5 * background).any()
        if known_again or measured.time - self._learnt >= _LEARN_S:
            self._remember_obstacles(remembered, measured.time)

    def _lidar_detection(self, measured: FloatArray | None) -> FloatArray:
        """P_D (MOTIONS, n) of each thing (Perera eq. 18); measured: the scan's own clearance."""
        things = self._things
        clearance = measured
        if clearance is None:
            clearance = surroundings(things.whole, self._width)[2]
        x, y = things.rows[X].ravel(), things.rows[Y].ravel()
        bearing, distance = np.arctan2(y, x), np.hypot(x, y)
        found = self._lidar.detection(bearing, distance, clearance, measured is not None)
        return found.reshape(MOTIONS, -1)

    def _remembered_detection(self, measured: FloatArray | None) -> FloatArray:
        """P_D (k,) of each obstacle that is remembered; measured: the scan's own clearance."""
        if not self._world.rows.shape[1]:
            return np.zeros(0)
        bearing, distance, clearance = surroundings(self._world.rows, self._width, measured)
        return self._lidar.detection(bearing, distance, clearance, measured is not None)

    def _born(
        self,
        measured: Positions,
        noise: FloatArray,
        existence: FloatArray,
        like_turrets: FloatArray,
        known: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """A thing for each reading (m,), with the probability that it is a new thing.

        like_turrets (m,): as of `likeness`. known (2, m): the probability that it is an obstacle,
        or stands, and is remembered.

        What does not look like a turret is rather an obstacle. That it does is no evidence for a
        teammate: what looks like one in this revolution, a post, does so in the next.
        """
        obstacle = self._settings.pmb.obstacle_share
        teammate = (1.0 - obstacle) * like_turrets
        lags = 0.0 if measured.lags is None else measured.lags
        rows, weights = self._modes.born(
            measured.positions, noise, lags, existence * teammate, existence * obstacle
        )
        weights[OBSTACLE : PARKED + 1] += known
        return rows, weights

    def _remember_obstacles(self, remembered: FloatArray, now: float) -> None:
        """Tell the static world what stands still; remembered (k,): P_D of what it holds."""
        there, standing = self._things.standing(_BELIEVED)
        obstacle = self._things.weights[OBSTACLE].take(there) / standing[WEIGHT]
        self._world.learn(standing, obstacle, remembered, min(now - self._learnt, LONGEST_S))
        self._learnt = now

    def _update_by_cameras(self, measured: Bearings) -> None:
        """Readings of teammates only; without the lidar they show those that are new, too."""
        elapsed, n = self._births.elapsed(measured), len(self._things)
        if measured.time - self._scanned <= LONGEST_S:
            if n:
                self._use_strips(measured, None)
            return
        places, unclaimed = self._births.places(measured, elapsed), np.ones(len(measured.bearings))
        births = places.of_readings(len(measured.bearings))
        if n:
            unclaimed = self._use_strips(measured, births)
        self._bear_strips(measured, places, unclaimed / (self._camera.clutter + births))

    def _use_strips(self, measured: Bearings, births: FloatArray | None) -> FloatArray:
        """What has no strip is an obstacle, or not there; returns the unclaimed (m,).

        births (m,): intensity of teammates that are new; None where it is for the lidar to say.

        L = 1 - P_D + sum over z of P_D N(z) nu(z) / kappa for each motion of a teammate, and 1
        otherwise; it counts with the share of it that is new.
        """
        things, weights = self._things, self._things.weights
        there = things.whole[WEIGHT]
        n, m, gate = len(things), len(measured.bearings), self._settings.gate
        detected, share = self._camera_detection(measured)
        pairs = pair_bearings(things.rows, things.whole, measured, share, gate, self._ranges_to_m)
        i, j = pairs.target, pairs.reading
        likelihood = pairs.likelihood * detected.take(i)
        teammates = things.teammate_motions
        expected = detected * teammates.sum(axis=0)
        if births is None:
            # Strips beyond what is expected are of teammates that the lidar has not shown yet.
            width = 2.0 * max(measured.view[1], _NARROWEST_RAD)
            clutter = np.full(m, self._camera.clutter + max(0.0, m - float(expected.sum())) / width)
        else:
            clutter = self._camera.clutter + births
        mass = (likelihood * teammates.take(i, axis=1)).sum(axis=0)
        absent = self._absent(there, there - expected)
        found = self._associate(i, j, mass / (absent.take(i) * clutter.take(j)), n, m)
        by_reading = likelihood * (found.messages / clutter.take(j))
        total = 1.0 - detected + summed(by_reading, i, n)
        after = teammates * total**share
        shares = after / np.maximum((after + weights[OBSTACLE] * _STILL_ONLY) * total, 1e-300)
        absorb(things.rows, pairs.changes, i, by_reading * shares.take(i, axis=1))
        weights[TEAMMATE] *= (total**share).take(MOTION_OF[TEAMMATE], axis=0)
        weights /= self._total(there, there + (after - teammates).sum(axis=0))
        things.changed()
        if births is not None:
            things.tracks[SEEN, i[found.pairs > 0.5]] = measured.time - measured.lag
        return found.unclaimed

    def _bear_strips(self, measured: Bearings, places: Places, free: FloatArray) -> None:
        """A thing for each place of a strip; free (m,): its share to nobody, over clutter."""
        weights, taken = places.intensity * free.take(places.reading), measured.time - measured.lag
        variances = 0.5 * np.trace(places.covariances, axis1=1, axis2=2)
        born = self._modes.born(
            places.positions, places.covariances, measured.lag, weights, 0.0 * weights
        )
        self._things.bear(*born, taken, variances, pictured=taken)
        self._things.merge_duplicates()

    def _camera_detection(self, measured: Bearings) -> tuple[FloatArray, FloatArray]:
        """P_D (n,) of each thing if it is a teammate (eq. 29); share of evidence that is new."""
        bearing, distance, clearance = surroundings(self._things.whole, self._width)
        detected = self._camera.detection(bearing, distance, clearance, measured.view)
        pictured, taken = self._things.tracks[PICTURED], measured.time - measured.lag
        share = new_share(taken - pictured, _PICTURES_S)
        pictured[in_view(bearing, measured.view)] = taken
        return detected, np.maximum(share, 1e-6)

    @abstractmethod
    def _absent(self, there: FloatArray, missed: FloatArray) -> FloatArray:
        """The weight (n,) without a reading that ratios are over; missed: of it, what is missed."""

    @abstractmethod
    def _total(self, there: FloatArray, after: FloatArray) -> FloatArray:
        """What weights (n,) are divided by that a picture took from `there` to `after`."""

    def _label(self) -> None:
        """Number what is reported for the first time."""
        labels = self._things.tracks[LABEL]
        new = (self._reported(self._things.teammates) & (labels == 0.0)).nonzero()[0]
        labels[new] = np.arange(self._next_label, self._next_label + len(new))
        self._next_label += len(new)

    def _reported(self, teammates: FloatArray) -> BoolArray:
        """Which things (n,) lower the expected GOSPA (p = 2, cut-off c) by their report.

        Missed, a teammate costs c²/2; reported, its squared error, or c²/2 if it is none:
        w tr P + (1 - w) c²/2 < w c²/2.
        """
        half = 0.5 * self._settings.pmb.report_error_m**2
        error = teammates[PXX] + teammates[PYY]
        return np.asarray(teammates[WEIGHT] * (2.0 * half - error) > half)

    def estimate(self) -> Estimate:
        """The teammates that are worth a report."""
        teammates = self._things.teammates
        index = self._reported(teammates).nonzero()[0]
        teammates, tracks = teammates.take(index, 1), self._things.tracks.take(index, 1)
        places, spreads = self._world.believed()
        return Estimate(
            time=self._time,
            positions=teammates[: Y + 1].T,
            covariances=teammates.take((PXX, PXY, PXY, PYY), axis=0).T.reshape(-1, 2, 2),
            weights=teammates[WEIGHT],
            ages=self._time - tracks[SEEN],
            labels=tracks[LABEL].astype(np.int64),
            obstacles=places,
            obstacle_covariances=spreads,
        )
