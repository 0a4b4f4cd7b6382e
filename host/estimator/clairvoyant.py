"""Kalman filters that know which reading is whose: the limit of what any filter can reach.

Only for evaluation. It takes readings' `identities`; those of nobody (-1) it leaves out.
"""

import numpy as np

from host.estimator.motion_modes import MotionModes, MovingTeammates
from host.geometry import on_rays, wrap
from host.message_checks import check
from host.messages import Bearings, Displacement, Estimate, FloatArray, Positions

# Standing (or rotating on the spot), manoeuvring, cruising: as robots do that drive straight on at
# 0.3 m/s and rotate where something is in the way. Chosen for the least GOSPA at an ANEES near 1.
WANDERING = MotionModes(
    accelerations=(0.0, 0.07, 1e-4),
    correlations_s=(0.0, 2.0, 100.0),
    rates=((0.0, 1.0, 0.0), (0.7, 0.0, 5.0), (0.3, 0.6, 0.0)),
    shares=(1 / 3, 1 / 3, 1 / 3),
    speed_mps=0.3,
    drift=0.0,
)


class Clairvoyant:
    """One Kalman filter per identity over position and velocity, under several modes of motion.

    A teammate is reported while the trace of its covariance is below `most_variance` (m²) and it
    was placed within forget_s; then it is forgotten. It is known from its first position on, or
    from the first strip whose size tells how far it is.
    """

    def __init__(
        self,
        modes: MotionModes = WANDERING,
        most_variance: float = 0.1,
        forget_s: float = 10.0,
    ) -> None:
        self._most_variance = most_variance
        self._forget_s = forget_s
        self._time = 0.0
        self._identities = np.zeros(0, dtype=np.int64)
        self._ages = np.zeros(0)
        self._teammates = MovingTeammates(modes)

    def predict(self, motion: Displacement) -> None:
        """Carry every teammate into the robot's new frame; forget those known no more."""
        check(motion)
        self._time = motion.time
        self._teammates.predict(motion)
        self._ages = self._ages + motion.interval
        _, covariances = self._teammates.moments()
        known = np.trace(covariances, axis1=1, axis2=2) < self._most_variance
        known &= self._ages < self._forget_s
        self._identities, self._ages = self._identities[known], self._ages[known]
        self._teammates.keep(known)

    def update(self, measurement: Positions | Bearings) -> None:
        """Take in the readings that have an identity. Raises ValueError where none are given."""
        check(measurement)
        self._time = measurement.time
        if measurement.identities is None:
            raise ValueError("the clairvoyant filter needs the identity of each reading")
        for reading in np.flatnonzero(measurement.identities >= 0):
            identity = int(measurement.identities[reading])
            found = np.flatnonzero(self._identities == identity)
            teammate = int(found[0]) if len(found) else None
            if isinstance(measurement, Positions):
                self._use_position(measurement, int(reading), identity, teammate)
            elif teammate is not None:
                self._use_strip(measurement, int(reading), teammate)
            else:
                self._begin_by_strip(measurement, int(reading), identity)

    def _use_position(
        self, measured: Positions, reading: int, identity: int, teammate: int | None
    ) -> None:
        """H = [I, -lag I]: the reading shows where the teammate was `lag` seconds ago."""
        position, noise = measured.positions[reading], measured.covariances[reading]
        lag = 0.0 if measured.lags is None else float(measured.lags[reading])
        if teammate is None:
            self._begin(identity, position, noise, lag)
            return
        then, jacobian = self._teammates.positions_before(teammate, lag)
        self._teammates.update(teammate, position - then, jacobian, noise)
        self._ages[teammate] = 0.0

    def _begin(self, identity: int, position: FloatArray, noise: FloatArray, lag: float) -> None:
        self._teammates.begin(position, noise, lag)
        self._identities = np.append(self._identities, identity)
        self._ages = np.append(self._ages, 0.0)

    def _begin_by_strip(self, measured: Bearings, reading: int, identity: int) -> None:
        if measured.ranges is None or measured.range_variances is None:
            return
        bearing, distance = measured.bearings[[reading]], measured.ranges[[reading]]
        across = distance**2 * measured.variances[[reading]]
        along = measured.range_variances[[reading]]
        (position,), (noise,) = on_rays(measured.origin, bearing, distance, across, along)
        self._begin(identity, position, noise, measured.lag)

    def _use_strip(self, measured: Bearings, reading: int, teammate: int) -> None:
        """Bearing and, where its size tells it, range of where the teammate was `lag` s ago.

        H = ((-y, x) / r², (x, y) / r) (Perera 2021 eq. 25-28, repaired).
        """
        then, jacobian = self._teammates.positions_before(teammate, measured.lag)
        x, y = (then - measured.origin).T
        r = np.hypot(x, y)
        if np.any(r < 1e-3):
            return  # a teammate at the rays' origin: its direction says nothing
        rows = [np.stack((-y, x), axis=1) / (r * r)[:, None]]
        innovations = [wrap(measured.bearings[reading] - np.arctan2(y, x))]
        noise = [measured.variances[reading]]
        if measured.ranges is not None and measured.range_variances is not None:
            rows.append(np.stack((x, y), axis=1) / r[:, None])
            innovations.append(measured.ranges[reading] - r)
            noise.append(measured.range_variances[reading])
        h = np.stack(rows, axis=1) @ jacobian
        self._teammates.update(teammate, np.stack(innovations, axis=1), h, np.diag(noise))

    def estimate(self) -> Estimate:
        """Every teammate that is known; labels are the identities."""
        positions, covariances = self._teammates.moments()
        return Estimate(
            time=self._time,
            positions=positions,
            covariances=covariances,
            weights=np.ones(len(self._ages)),
            ages=self._ages.copy(),
            labels=self._identities.copy(),
        )
