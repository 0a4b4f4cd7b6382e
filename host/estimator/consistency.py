"""Do the noise settings fit the data? Normalised innovations squared (NIS) of each sensor, online.

Where the noise is as it is configured, NIS = nu^T S^-1 nu of m dimensions is chi-squared (Bar-
Shalom, Li & Kirubarajan 2001, section 5.4). Three sensors, three innovations, none of which depends
on the filter or on how teammates are taken to move:

lidar: of a thing that stands still, from one scan to the next; S = R + R' + odometry.
wheels: of the same thing over 3 s; there the odometry is most of S.
cameras: of a teammate that is known well; S is the bearing's variance and a little.

Medians are compared, so that a thing that moves after all, or a false alarm, does not count.
"""

import math
from collections import deque

import numpy as np

from host.geometry import Path, into_new_frame, rotation, to_frame, to_parent, wrap
from host.messages import Bearings, BoolArray, Estimate, FloatArray, IntArray, Positions

LIDAR, WHEELS, CAMERAS = "lidar", "wheels", "cameras"
_MEDIANS = {LIDAR: 1.386, WHEELS: 1.386, CAMERAS: 0.455}  # of chi-squared with 2, 2 and 1 dof
_KEPT = 300  # innovations: of some minutes
_FEWEST = 40
_CONTRADICTION = 2.5  # times the expected NIS; noise that is off by 3 gives 9
_LEAST_BEARING_RATIO = 1.0 / 4.0  # only of the cameras: R of the lidar allows for rare shapes
_BASE_S = 3.0  # over which a thing must stand still, and the wheels are judged
_PICTURE_S = 0.3  # pictures closer together show the same error
_SEEN_SHARE = 0.8  # of the scans: something hides it in the others
_STILL_M = 0.15  # a robot that turns on the spot drives further within _BASE_S
_FRESH_S = 0.3  # a teammate seen longer ago may be elsewhere
_SURE = 0.8
_LIDAR_GONE_S = 1.0  # then teammates stand where the pictures had them, which say nothing new
_SPEED_MPS = 0.3  # of teammates while a picture waits
_NEAR_SHARE = 1.0  # of the bearing's variance: a teammate known worse says nothing of it
_GATE_SIGMA, _ALONE_RAD = 9.0, 0.6


class _Things:
    """The readings of one scan, and how often each was seen there again."""

    def __init__(self, begun: Positions) -> None:
        self.begun = begun
        self._seen, self._scans = np.zeros(len(begun.positions)), 0
        self._first = np.full(len(begun.positions), math.nan)

    def follow(self, measured: Positions, path: Path) -> tuple[FloatArray, FloatArray]:
        """NIS (k,) of what was there in all the scans: from the first to the next, and to this."""
        begun = self.begun
        then, now = path.poses(np.array([begun.time, measured.time]))
        carried = to_frame(to_parent(begun.positions, then), now)
        distances = np.linalg.norm(carried[:, None] - measured.positions, axis=2)
        nearest = distances.argmin(axis=1)
        found = distances[np.arange(len(carried)), nearest] < _STILL_M
        self._seen += found
        self._scans += 1
        nis = np.full(len(carried), math.nan)
        if self._scans == 1 or measured.time - begun.time >= _BASE_S:
            nis[found] = _nis(begun, measured, found, nearest[found], path)
        if self._scans == 1:
            self._first = nis
        kept = found & (self._seen >= _SEEN_SHARE * self._scans) & np.isfinite(self._first)
        return self._first[kept], nis[kept]


def _nis(
    begun: Positions,
    measured: Positions,
    found: BoolArray,
    reading: IntArray,
    path: Path,
) -> FloatArray:
    """nu^T S^-1 nu (k,) of the things (n,) found again, as if they had stood still.

    reading (k,): which of those measured each is.
    """
    motion = path.between(begun.time, measured.time)
    places, spread = into_new_frame(begun.positions[found], begun.covariances[found], motion)
    spread += measured.covariances[reading]
    innovation = measured.positions[reading] - places
    weighted = np.linalg.solve(spread, innovation[..., None])[..., 0]
    return np.asarray(np.sum(innovation * weighted, axis=1))


def _expected(measured: Bearings, known: Estimate, path: Path) -> tuple[FloatArray, FloatArray]:
    """The bearing (n,) of each teammate when the picture was taken, and its variance, rad²."""
    then, now = path.poses(np.array([known.time, measured.time]))
    places = to_frame(to_parent(known.positions, then), now) - measured.origin
    square = np.maximum(np.sum(places * places, axis=1), 1e-6)
    across = places[:, ::-1] * (-1.0, 1.0)
    to_now = rotation(float(then[2] - now[2]))
    spread = np.einsum("na,nab,nb->n", across, to_now @ known.covariances @ to_now.T, across)
    waited = abs(measured.time - known.time) + measured.lag
    variances = spread / square**2 + (_SPEED_MPS * waited) ** 2 / square
    return np.arctan2(places[:, 1], places[:, 0]), variances


class Consistency:
    """Takes each sensor's readings as they are used, and reports noise settings that do not fit."""

    def __init__(self) -> None:
        self._innovations = {name: deque[float](maxlen=_KEPT) for name in _MEDIANS}
        self._things: _Things | None = None
        self._scanned = -math.inf  # time of the newest positions
        self._pictured = -math.inf  # time of the newest picture that was compared

    def take_positions(self, measured: Positions, path: Path) -> None:
        """Readings of the lidar, in the robot frame at their time."""
        self._scanned = measured.time
        if not len(measured.positions):
            return
        if self._things is None:
            self._things = _Things(measured)
            return
        of_lidar, of_wheels = self._things.follow(measured, path)
        if measured.time - self._things.begun.time >= _BASE_S:
            self._innovations[LIDAR].extend(of_lidar.tolist())
            self._innovations[WHEELS].extend(of_wheels.tolist())
            self._things = _Things(measured)

    def take_bearings(self, measured: Bearings, known: Estimate, path: Path) -> None:
        """Readings of a picture, and what was estimated at about that time, each in its frame."""
        new = abs(measured.time - self._pictured) >= _PICTURE_S
        new &= measured.time - self._scanned < _LIDAR_GONE_S
        if not (new and len(known.positions) and len(measured.bearings)):
            return
        self._pictured = measured.time
        bearings, spread = _expected(measured, known, path)
        others = np.diag(np.full(len(bearings), math.tau))
        apart = (np.abs(wrap(bearings[:, None] - bearings)) + others).min(axis=1)
        off = np.abs(wrap(measured.bearings - bearings[:, None]))
        reading = off.argmin(axis=1)
        innovation, variance = off.min(axis=1), measured.variances[reading]
        usable = (apart > _ALONE_RAD) & (spread < _NEAR_SHARE * variance)
        usable &= (known.ages < _FRESH_S) & (known.weights > _SURE)
        usable &= innovation < np.minimum(_GATE_SIGMA * np.sqrt(variance), 0.5 * _ALONE_RAD)
        nis = innovation**2 / (variance + spread)
        self._innovations[CAMERAS].extend(nis[usable].tolist())

    def ratio(self, sensor: str) -> float:
        """Median NIS of a sensor over the expected one: 1 is consistent; nan: not known yet."""
        values = self._innovations[sensor]
        if len(values) < _FEWEST:
            return math.nan
        return float(np.median(values)) / _MEDIANS[sensor]

    @property
    def known(self) -> bool:
        """Whether there is enough of any sensor to judge it."""
        return any(len(values) >= _FEWEST for values in self._innovations.values())

    def summary(self) -> str:
        """The ratio of each sensor that is known, as text."""
        ratios = {sensor: self.ratio(sensor) for sensor in _MEDIANS}
        known = [f"{name} {ratio:.1f}" for name, ratio in ratios.items() if not math.isnan(ratio)]
        return f"they fit the data (NIS over the expected: {', '.join(known)})"

    def fault(self) -> str | None:
        """What contradicts the data, with the next step; None where nothing does."""
        lidar, wheels, cameras = (self.ratio(sensor) for sensor in (LIDAR, WHEELS, CAMERAS))
        if lidar > _CONTRADICTION:
            return (
                f"what stands still scatters {math.sqrt(lidar):.1f} times as far from scan to scan "
                "as the lidar's noise allows: raise range_noise_m in [lidar], or correct the "
                "covariances of your sensor"
            )
        if wheels > _CONTRADICTION:
            return (
                f"within {_BASE_S:.0f} s what stands still is off {math.sqrt(wheels):.1f} times as "
                "far as the noise of the odometry allows: raise distance_noise_m, "
                "heading_noise_rad and drift_noise_rad in [wheels]; `swarmloc calibrate wheels` "
                "fits them"
            )
        if cameras > _CONTRADICTION or cameras < _LEAST_BEARING_RATIO:
            word = "raise" if cameras > 1.0 else "lower"
            return (
                f"bearings are off {math.sqrt(cameras):.1f} times as far as their noise says: "
                f"{word} bearing_noise_rad in [camera]; `swarmloc calibrate camera` fits it"
            )
        return None
