"""One robot's localizer: puts messages in time order and drives one filter.

Deterministic: it uses only the messages' own times, so the same messages in the same order give
bit-identical estimates, live or replayed.
"""

import copy
import dataclasses
import heapq
import math
from collections import deque
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from host.config import RobotConfig
from host.estimator.consistency import Consistency
from host.estimator.interface import Filter, Learning
from host.geometry import Path, rotation, to_frame, to_parent
from host.message_checks import fault
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    Measurement,
    Positions,
    Scan,
)
from host.perception.odometry_gains import OdometryGains
from host.perception.turrets import turrets

AnyReadings = TypeVar("AnyReadings", bound=Positions | Bearings)

_PATIENCE_S = 0.2  # how long a measurement waits for the odometry of its time
_SILENT_S = 0.5  # after this silence of the odometry, measurements no longer wait for it
_TOO_LATE_S = 1.0  # measurements older than this are dropped
_ALONE_S = 2.0  # without a measurement for this long the filter follows the odometry alone
_LEAP_S = 10.0  # a message further ahead of all others is used when a second one agrees


def unnoticed(measurement: Measurement, readings: Positions | Bearings) -> None:
    """Default for `used`: ignore it."""


class Localizer:
    """Feeds one filter with scans, positions, bearings and displacements.

    A measurement waits until the odometry reaches its time. A late one, as pictures are, is
    transformed by the odometry into the filter's present frame. A malformed message is dropped and
    changes nothing.
    """

    def __init__(
        self,
        config: RobotConfig,
        estimator: Filter,
        used: Callable[[Measurement, Positions | Bearings], None] = unnoticed,
    ) -> None:
        """used: called after each estimate with the measurement and the readings found in it."""
        self.dropped = 0  # measurements that came too late
        self.malformed = 0  # malformed messages
        self.fault: str | None = None  # what was wrong with the last of these
        self.consistency = Consistency()
        self.odometry = OdometryGains(config.lidar)
        self.learnt = estimator.learnt if isinstance(estimator, Learning) else None
        self._config = config
        self._filter = estimator
        self._unjudged: list[Scan] = []  # not yet compared with the odometry
        self._recent: deque[Estimate] = deque(maxlen=8)  # as far back as pictures are late
        self._used = used
        self._path = Path()
        self._waiting: list[tuple[float, int, Measurement]] = []
        self._count = 0
        self._time = -math.inf  # of the filter
        self._first = math.inf  # time of the first message
        self._newest = -math.inf  # time of the newest message
        self._leapt = -math.inf  # time of a message that was too far ahead
        self.measured = -math.inf  # time of the newest measurement that was used

    def handle(self, message: Measurement | Displacement) -> list[Estimate]:
        """Process one message; return an estimate for each measurement that was used.

        After two seconds without measurements there is one estimate per second, by odometry alone.
        """
        wrong = fault(message) or self._leap(message)
        if wrong is not None:
            self._drop(wrong)
            return []
        self._judge_odometry()
        self._first = min(self._first, message.time)
        self._newest = max(self._newest, message.time)
        if isinstance(message, Displacement):
            self._path.append(self.odometry.corrected(message))
            return self._release(self._until()) + self._follow()
        heapq.heappush(self._waiting, (message.time, self._count, message))
        self._count += 1
        return self._release(self._until())

    def ahead(self, time: float) -> Estimate | None:
        """The filter's estimate predicted to `time` (s); None before the first measurement.

        The filter itself is not changed, so late measurements are still used in order. Beyond the
        last odometry the robot's motion is extrapolated.
        """
        if not math.isfinite(self._time):
            return None
        filter_ = copy.deepcopy(self._filter)
        if time > self._time:
            filter_.predict(self._path.extended(time).between(self._time, time))
        return filter_.estimate()

    def finish(self) -> list[Estimate]:
        """Use the measurements that still wait for odometry: no more messages will come."""
        return self._release(math.inf)

    def _drop(self, wrong: str) -> None:
        self.malformed += 1
        self.fault = wrong

    def _leap(self, message: Measurement | Displacement) -> str | None:
        """The fault of a single message whose time is far ahead of all others, else None.

        Using it would make every later message too late. The first message sets the clock.
        """
        ahead = message.time - self._newest
        if not _LEAP_S < ahead < math.inf or abs(message.time - self._leapt) <= _LEAP_S:
            return None
        self._leapt = message.time
        return f"{type(message).__name__}: its time is {ahead:.1f} s ahead of all before it"

    def _until(self) -> float:
        """Measurements up to this time (s) no longer wait for odometry."""
        if self._newest - max(self._path.end, self._first) > _SILENT_S:
            return self._newest
        return max(self._path.end, self._newest - _PATIENCE_S)

    def _follow(self) -> list[Estimate]:
        """Without measurements, predict by the odometry before the path forgets it.

        The filter stays _TOO_LATE_S behind, so that measurements that are not too late fit in.
        """
        if not math.isfinite(self._time) or self._path.end <= self._time + _ALONE_S:
            return []
        self._predict(self._path.end - _TOO_LATE_S)
        return [self._filter.estimate()]

    def _release(self, until: float) -> list[Estimate]:
        estimates = []
        while self._waiting and self._waiting[0][0] <= until:
            measurement = heapq.heappop(self._waiting)[2]
            if measurement.time < self._time - _TOO_LATE_S:
                self.dropped += 1
                continue
            estimates += self._use(measurement)
        return estimates

    def _predict(self, time: float) -> None:
        if math.isfinite(self._time):
            self._filter.predict(self._path.between(self._time, time))
        else:
            self._filter.predict(Displacement(time, 0.0, 0.0, 0.0, 0.0))
        self._time = time

    def _use(self, measurement: Measurement) -> list[Estimate]:
        """The estimate after a measurement; none if the readings found in it are malformed."""
        if measurement.time > self._time:
            self._predict(measurement.time)
        self.measured = max(self.measured, measurement.time)
        readings = measurement
        if isinstance(readings, Scan):
            self._unjudged.append(readings)
            readings = turrets.find(readings, self._config.lidar, self._path)
        present = carried(readings, self._path, self._time)
        try:
            self._filter.update(present)
        except ValueError:
            wrong = fault(present)
            if wrong is None:
                raise  # a fault of the filter, not of the message
            self._drop(wrong)
            return []
        self._compare(readings)
        estimate = self._filter.estimate()
        self._recent.append(estimate)
        self._used(measurement, readings)
        return [estimate]

    def _judge_odometry(self) -> None:
        """Compare it with the last scans: before the next motion, after the estimates."""
        for scan in self._unjudged:
            self.odometry.take(scan, self._path)
        self._unjudged.clear()

    def _compare(self, readings: Positions | Bearings) -> None:
        """Update the consistency statistics (NIS) with the readings."""
        if isinstance(readings, Positions):
            self.consistency.take_positions(readings, self._path)
        elif self._recent:
            known = min(self._recent, key=lambda estimate: abs(estimate.time - readings.time))
            self.consistency.take_bearings(readings, known, self._path)


def carried(measured: AnyReadings, path: Path, time: float) -> AnyReadings:
    """The readings in the robot frame at a later `time` (s); their lag grows accordingly."""
    lag = time - measured.time
    if lag <= 0.0:
        return measured
    then, now = path.poses(np.array([measured.time, time]))
    rotated_by = float(then[2] - now[2])
    if isinstance(measured, Bearings):
        origin = to_frame(to_parent(np.array([measured.origin]), then), now)[0]
        return dataclasses.replace(
            measured,
            time=time,
            bearings=measured.bearings + rotated_by,
            origin=(float(origin[0]), float(origin[1])),
            view=(measured.view[0] + rotated_by, measured.view[1]),
            lag=measured.lag + lag,
        )
    to_now = rotation(rotated_by)
    lags = np.zeros(len(measured.positions)) if measured.lags is None else measured.lags
    return dataclasses.replace(
        measured,
        time=time,
        positions=to_frame(to_parent(measured.positions, then), now),
        covariances=to_now @ measured.covariances @ to_now.T,
        lags=lags + lag,
        clearance=None,
    )
