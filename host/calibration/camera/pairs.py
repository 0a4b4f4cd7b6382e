"""Strips in pictures with the teammates' true positions, by motion capture or the lidar."""

import itertools
import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from scipy.spatial.distance import cdist

from host.calibration.gathered import Gathered, Tracks
from host.errors import UserError
from host.geometry import to_frame, to_parent
from host.messages import FloatArray, IntArray
from host.perception.turrets import turrets

CAMERAS: tuple[Literal["front", "rear"], ...] = ("front", "rear")
LEAST_PAIRS = 12  # of a camera, to fit it
_MOST_STRIPS = 1200  # of a longer drive every second, third, ... is used
_LINK_M = 0.12  # a candidate of the lidar moves no farther in one revolution
_REVOLUTION_S = 0.4  # revolutions are nearer to each other than this


@dataclass(frozen=True, slots=True)
class Strips:
    """What the cameras took for strips, in order of time.

    times (n,) s: of the messages. cameras (n,): index into CAMERAS. pixels (n, 2): of the middles.
    """

    times: FloatArray
    cameras: IntArray
    pixels: FloatArray


class Reference(Protocol):
    """True positions of teammates. noise_m: their own uncertainty."""

    noise_m: float

    def positions(self, times: FloatArray, shift_s: float = 0.0) -> FloatArray:
        """Positions (k, m, 2) m in the robot frame at `times` + `shift_s`; nan where unknown.

        A column means the same teammate for any `shift_s`, not for different times.
        """

    def headings(self, times: FloatArray) -> FloatArray:
        """Headings (k,) rad of the robot on the floor at `times`; nan where unknown."""


class Captured:
    """Teammates as motion capture saw them."""

    noise_m = 0.003

    def __init__(self, tracks: Tracks) -> None:
        self._tracks = tracks

    def positions(self, times: FloatArray, shift_s: float = 0.0) -> FloatArray:
        """Positions (k, m, 2), one column a teammate."""
        return self._tracks.teammates(times + shift_s)

    def headings(self, times: FloatArray) -> FloatArray:
        """Headings (k,) of the tracked body, less how it lies on the robot."""
        return self._tracks.own(times)[:, 2]


class Ranged:
    """Teammates, and whatever else is as wide, as the calibrated lidar saw them.

    Candidates of one revolution are joined with those of the next that are nearest on the floor.
    """

    noise_m = 0.02

    def __init__(self, gathered: Gathered) -> None:
        self._path = gathered.path()
        self._ends = np.array([scan.time for scan in gathered.scans])
        seen = []
        for scan in gathered.scans:
            found = turrets.find(scan, gathered.config.lidar, self._path)
            (pose,) = self._path.poses(np.array([scan.time]))
            lags = np.zeros(len(found.positions)) if found.lags is None else found.lags
            seen.append((scan.time - lags, to_parent(found.positions, pose)))
        pairs = [_link(*a, *b) for a, b in itertools.pairwise(seen)]
        widest = max((len(pair) for pair in pairs), default=0)
        # Of two revolutions and a candidate: first and last time, place and velocity on the floor.
        # One more before and after them all, of nothing.
        self._rows = np.full((len(pairs) + 2, widest, 6), math.nan)
        for row, pair in zip(self._rows[1:], pairs, strict=False):
            row[: len(pair)] = pair

    def positions(self, times: FloatArray, shift_s: float = 0.0) -> FloatArray:
        """Positions (k, m, 2), one column a candidate seen shortly before and after a time."""
        # A revolution's candidates were seen before its end, each at its own time.
        after = np.clip(np.searchsorted(self._ends, times), 0, len(self._rows) - 2)
        rows = np.concatenate((self._rows[after], self._rows[after + 1]), axis=1)
        floor = (
            rows[..., 2:4] + (times[:, None] + shift_s - rows[..., 0])[..., None] * rows[..., 4:]
        )
        between = (times[:, None] >= rows[..., 0]) & (times[:, None] < rows[..., 1])
        poses = np.repeat(self._path.poses(times + shift_s), rows.shape[1], axis=0)
        found = to_frame(floor.reshape(-1, 2), poses).reshape(floor.shape)
        found[~between] = math.nan
        return found

    def headings(self, times: FloatArray) -> FloatArray:
        """Headings (k,) by the wheels."""
        return np.asarray(self._path.poses(times)[:, 2])


def _link(
    times: FloatArray, places: FloatArray, next_times: FloatArray, next_places: FloatArray
) -> FloatArray:
    """Rows (j, 6) of the candidates of both revolutions: both times, place and velocity."""
    if not len(times) or not len(next_times):
        return np.zeros((0, 6))
    distances = cdist(places, next_places)
    first = np.arange(len(places))
    second = np.argmin(distances, axis=1)
    mutual = np.argmin(distances, axis=0)[second] == first
    interval = next_times[second] - times
    kept = (
        mutual
        & (distances[first, second] < _LINK_M)
        & (interval > 0.01)
        & (interval < _REVOLUTION_S)
    )
    step = (next_places[second] - places)[kept] / interval[kept, None]
    return np.column_stack((times[kept], next_times[second][kept], places[kept], step))


def strips_of(gathered: Gathered) -> Strips:
    """What both cameras saw. Raises UserError where no message says where in the picture."""
    parts = [
        (bearings.time, CAMERAS.index(bearings.camera), pixel)
        for bearings in gathered.bearings
        if bearings.pixels is not None and bearings.camera in CAMERAS
        for pixel in bearings.pixels
    ]
    if not parts:
        raise UserError(
            "there are no strips in pictures to calibrate the cameras with",
            f"{len(gathered.bearings)} messages of cameras, none of them with a place in a picture",
            "check that [camera.front] and [camera.rear] of robot.toml name their sources",
        )
    parts.sort(key=lambda part: part[0])
    parts = parts[:: -(-len(parts) // _MOST_STRIPS)]
    return Strips(
        np.array([part[0] for part in parts]),
        np.array([part[1] for part in parts]),
        np.array([part[2] for part in parts], dtype=float),
    )


def reference_of(gathered: Gathered) -> Reference:
    """Motion capture, or the lidar where there is none. Raises UserError where neither is."""
    if gathered.bodies:
        return Captured(gathered.tracks_of_teammates())
    if len(gathered.scans) < 2:
        raise UserError(
            "there is no reference for the teammates' positions",
            f"no frame of motion capture and {len(gathered.scans)} revolutions of the lidar",
            "name the source in [mocap] of robot.toml, or connect the lidar and calibrate it first",
        )
    return Ranged(gathered)
