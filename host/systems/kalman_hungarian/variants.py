"""The variants of Belaroussi 2024 on one run: each sensor alone, and every way to fuse them."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from host.config import RobotConfig
from host.estimator.kalman_hungarian import IMPROVED, KalmanHungarian
from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.truth_scoring import score_by_track
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    FloatArray,
    Positions,
    Scan,
    Truth,
)
from host.systems.kalman_hungarian.lidar_detection import Detection
from host.systems.kalman_hungarian.sensors import NOTHING, Event, Found, Sensors

LIDAR, CAMERA, LIDAR_AND_CAMERA = "lidar", "camera", "lidar+camera"
_SENSOR_VARIANCE = 0.03**2  # m², of a sensor on its own

# By the name of a fusion: the lidar's detection, and the filters.
_FUSIONS: dict[str, tuple[Detection, Callable[[], KalmanHungarian]]] = {
    "fused standalone": ("standalone", KalmanHungarian),
    "fused partial": ("partial", KalmanHungarian),
    "fused full": ("full", KalmanHungarian),
    "complementary": ("partial", lambda: KalmanHungarian("complementary")),
    "improved": ("standalone", lambda: KalmanHungarian(errors=IMPROVED)),
}


class _Fusion:
    """Filters on what a camera and one method of the lidar find."""

    def __init__(self, detection: Detection, filter_: KalmanHungarian) -> None:
        self._detection = detection
        self._filter = filter_
        self._time = 0.0
        self._used = NOTHING

    def update(self, sensors: Sensors, picture: Bearings) -> None:
        """A round with a picture that has just been taken in.

        The lidar's positions of a scan are used once where delays are compensated, and with every
        picture until the next scan as published.
        """
        now = max(sensors.camera.time, self._time)
        self._predict(sensors, now)
        lidar = sensors.lidar[self._detection]
        fresh = not sensors.compensated or lidar is not self._used
        self._used = lidar
        self._filter.update(_positions(sensors, lidar if fresh else NOTHING, now))
        self._filter.update(replace(picture, time=now))

    def estimate(self, sensors: Sensors, time: float) -> Estimate:
        """At `time` (s)."""
        self._predict(sensors, time)
        return self._filter.estimate()

    def _predict(self, sensors: Sensors, time: float) -> None:
        """The robot's own motion counts only where it is compensated."""
        motion = sensors.path.between(self._time, max(time, self._time))
        still = Displacement(motion.time, motion.interval, 0.0, 0.0, 0.0)
        self._filter.predict(motion if sensors.compensated else still)
        self._time = motion.time


def _positions(sensors: Sensors, found: Found, now: float) -> Positions:
    if not sensors.compensated:
        found = Found(now, found.positions, np.full(len(found.times), now))
    carried = found.carried(sensors.path, now)
    lags = np.maximum(now - found.times, 0.0)
    return Positions(now, carried.positions, _covariances(found), lags)


def _sensor_estimate(sensors: Sensors, found: Found, time: float) -> Estimate:
    """What a sensor found last, as if it were an estimate at `time` (s)."""
    if sensors.compensated:
        found = found.carried(sensors.path, time)
    count = len(found.positions)
    return Estimate(
        time,
        found.positions,
        _covariances(found),
        np.ones(count),
        np.zeros(count),
        np.arange(count),
    )


def _covariances(found: Found) -> FloatArray:
    return np.tile(_SENSOR_VARIANCE * np.eye(2), (len(found.positions), 1, 1))


def scored(
    config: RobotConfig, messages: Sequence[Event], truths: Sequence[Truth], compensated: bool
) -> dict[tuple[str, str], Accumulator]:
    """Scores of the sensors and of every fusion, by name and sensors, at each scan.

    messages in order of arrival. compensated: for delays and the robot's own motion, so that
    estimates are of a time that has passed by as much as pictures are late.
    """
    sensors = Sensors(config, compensated)
    fusions = {name: _Fusion(how, make()) for name, (how, make) in _FUSIONS.items()}
    estimates: dict[tuple[str, str], list[Estimate]] = defaultdict(list)
    for message in sensors.in_order(messages):
        sensors.take(message)
        if isinstance(message, Bearings) and message.ranges is not None:
            for fusion in fusions.values():
                fusion.update(sensors, message)
        elif isinstance(message, Scan):
            time = message.time
            for name, fusion in fusions.items():
                estimates[name, LIDAR_AND_CAMERA].append(fusion.estimate(sensors, time))
            alone = {("camera", CAMERA): sensors.camera}
            alone |= {(f"lidar {how}", LIDAR): found for how, found in sensors.lidar.items()}
            for key, found in alone.items():
                estimates[key].append(_sensor_estimate(sensors, found, time))
    track = TruthTrack(truths)
    scores = {key: Accumulator() for key in estimates}
    for key, each in estimates.items():
        score_by_track(each, track, scores[key])
    return scores
