"""How a robot's wheels move the body that motion capture tracks, and by how much they miss it."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from host.config import Mocap, Wheels
from host.geometry import to_frame, to_parent
from host.messages import BoolArray, FloatArray, IntArray

# Where things are in a vector of values: left and right radius, track (m); x, y (m) and heading
# (rad) of the body in the robot frame; and for each drive by how much the stamps of its ticks are
# late (s) at its start and at its end. Clocks drift: in recorded runs by 50 ms in a minute.
GEOMETRY, BODY, LAGS = slice(0, 3), slice(3, 6), slice(6, None)
_AROUND, _FEW_TICKS = 7, 10  # rows that show what is usual; less is a matter of timing
_LEAST_MOVED_M, _RADIAN_M = 0.05, 0.1  # a window of less is one of standing still


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive: wheel ticks and the true path of the tracked body.

    times (n,) s; ticks (n, 2): left, right, counted from the start. truth_times (m,) s;
    truth (m, 3): x, y (m), heading (rad, not wrapped) on the floor; instants at which the body
    was lost are left out. stamps (k,) s: of all frames as they came, also of equal ones; None:
    truth_times are all.
    """

    times: FloatArray
    ticks: IntArray
    truth_times: FloatArray
    truth: FloatArray
    name: str = ""
    stamps: FloatArray | None = None

    def part(self, start: float, end: float) -> "Drive":
        """What of it lies from `start` to `end` (s), both included."""
        ticks = (self.times >= start) & (self.times <= end)
        seen = (self.truth_times >= start) & (self.truth_times <= end)
        truth = self.truth_times[seen], self.truth[seen]
        return Drive(self.times[ticks], self.ticks[ticks], *truth, self.name)

    @property
    def span(self) -> tuple[float, float]:
        """From when to when (s) both ticks and truth are known; (0, 0) where they never are."""
        if not len(self.times) or not len(self.truth_times):
            return 0.0, 0.0
        start = max(float(self.times[0]), float(self.truth_times[0]))
        end = min(float(self.times[-1]), float(self.truth_times[-1]))
        return (start, end) if end > start else (0.0, 0.0)


def without_absurd_rows(drive: Drive) -> tuple[Drive, int]:
    """The drive with rows of ticks that no wheel can count replaced, and how many there were.

    A row is absurd if its rate is off that of the rows around it by more than half of the fastest
    usual one. It is taken to have counted as these.
    """
    if len(drive.times) < _AROUND:
        return drive, 0
    seconds = np.maximum(np.diff(drive.times), 1e-6)[:, None]
    rates = np.diff(drive.ticks, axis=0) / seconds
    usual = median_filter(rates, (_AROUND, 1), mode="nearest")
    fastest = np.percentile(np.abs(usual), 99.0)
    absurd = (np.abs(rates - usual) > 0.5 * fastest + _FEW_TICKS / seconds).any(axis=1)
    steps = np.where(absurd[:, None], usual, rates) * seconds
    ticks = np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    replaced = dataclasses.replace(drive, ticks=np.rint(ticks).astype(np.int64))
    return (replaced, int(absurd.sum())) if absurd.any() else (drive, 0)


def values_of(wheels: Wheels, mocap: Mocap, drives: int = 0) -> FloatArray:
    """Values (6 + 2 drives,) as they are configured: without lags."""
    geometry = wheels.left_radius_m, wheels.right_radius_m, wheels.track_m
    return np.array([*geometry, mocap.x_m, mocap.y_m, mocap.heading_rad, *([0.0] * 2 * drives)])


def path(drive: Drive, counts: int, values: FloatArray) -> FloatArray:
    """Robot poses (n, 3) at drive.times by the wheels alone, from (0, 0, 0).

    Perera 2021 eq. 31-32, each step an arc as in `differential_drive`. counts: per
    revolution of a wheel.
    """
    ways = 2.0 * math.pi / counts * values[:2] * (drive.ticks - drive.ticks[0])
    heading = (ways[:, 1] - ways[:, 0]) / values[2]
    distance = np.diff(ways.mean(axis=1), prepend=0.0)
    rotation = np.diff(heading, prepend=0.0)
    chord = distance * np.sinc(rotation / (2.0 * math.pi))
    middle = heading - 0.5 * rotation
    steps = chord * np.cos(middle), chord * np.sin(middle)
    return np.stack((np.cumsum(steps[0]), np.cumsum(steps[1]), heading), axis=1)


def relative(start: FloatArray, end: FloatArray) -> FloatArray:
    """Poses (n, 3) `end` seen from the poses (n, 3) `start`; headings are not wrapped."""
    return np.column_stack((to_frame(end[:, :2], start), end[:, 2] - start[:, 2]))


def compose(frames: FloatArray, poses: FloatArray) -> FloatArray:
    """Where poses (n, 3), given in frames at `frames` (n, 3), are in their parent.

    Where there is only one of frames or poses, (1, 3) or for the pose (3,), it goes with all.
    """
    return np.column_stack((to_parent(poses[..., :2], frames), frames[:, 2] + poses[..., 2]))


def at(drive: Drive, columns: FloatArray, lags: FloatArray, times: FloatArray) -> FloatArray:
    """Rows (n, c), known at the stamps of a drive's ticks, at the true `times` (k,): (k, c).

    lags (2,) s: by how much the stamps are late at the drive's start and end.
    """
    shown = times + np.interp(times, drive.span, lags)
    return np.stack([np.interp(shown, drive.times, column) for column in columns.T], axis=1)


def body_path(drive: Drive, counts: int, values: FloatArray) -> FloatArray:
    """Poses (n, 3) of the tracked body at drive.times by the wheels alone.

    They start at the body's own pose in the robot frame.
    """
    return compose(path(drive, counts, values), values[BODY])


@dataclass(frozen=True, slots=True)
class Windows:
    """Pairs of true poses that lie so many seconds apart.

    drives (w,): which drive each is of. starts, ends (w,) s: when. moved (w, 3): how the body
    actually moved, seen from its pose at the start.
    """

    drives: IntArray
    starts: FloatArray
    ends: FloatArray
    moved: FloatArray

    def __len__(self) -> int:
        return len(self.drives)

    def where(self, chosen: BoolArray) -> "Windows":
        """Those chosen (w,)."""
        return Windows(
            self.drives[chosen], self.starts[chosen], self.ends[chosen], self.moved[chosen]
        )

    @property
    def moving(self) -> BoolArray:
        """In which windows (w,) the body actually moved."""
        ways = np.hypot(*self.moved[:, :2].T) + _RADIAN_M * np.abs(self.moved[:, 2])
        return np.asarray(ways > _LEAST_MOVED_M)


def windows_of(drives: Sequence[Drive], length_s: float, stride_s: float) -> Windows:
    """Windows of `length_s`, one each `stride_s`, wherever both ends were seen."""
    parts = [np.zeros((0, 6))]
    for number, drive in enumerate(drives):
        times, (first, last) = drive.truth_times, drive.span
        if last - first < length_s:
            continue
        due = np.arange(first, last - length_s + 1e-9, stride_s)
        starts, ends = _nearest(times, due), _nearest(times, due + length_s)
        off = np.maximum(np.abs(times[starts] - due), np.abs(times[ends] - due - length_s))
        good = (times[starts] >= first) & (times[ends] <= last) & (off <= 0.5 * stride_s)
        moved = relative(drive.truth[starts], drive.truth[ends])
        numbers = np.full(len(due), number)
        parts.append(np.column_stack((numbers, times[starts], times[ends], moved))[good])
    rows = np.concatenate(parts)
    return Windows(rows[:, 0].astype(np.int64), rows[:, 1], rows[:, 2], rows[:, 3:])


def _nearest(times: FloatArray, due: FloatArray) -> IntArray:
    return np.searchsorted(0.5 * (times[1:] + times[:-1]), due, side="right")


def at_ends(
    drives: Sequence[Drive], columns: Sequence[FloatArray], windows: Windows, lags: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Columns (n, c) of each drive, one row a time, at both ends of each window: two (w, c).

    lags (drives, 2) s: by how much each drive's stamps are late at its start and end.
    """
    ends = np.zeros((2, len(windows), columns[0].shape[1]))
    for number, (drive, rows) in enumerate(zip(drives, columns, strict=True)):
        own = windows.drives == number
        ends[0, own] = at(drive, rows, lags[number], windows.starts[own])
        ends[1, own] = at(drive, rows, lags[number], windows.ends[own])
    return ends[0], ends[1]


def misses(
    drives: Sequence[Drive], counts: int, values: FloatArray, windows: Windows
) -> FloatArray:
    """By how much the wheels miss the motion in each window.

    (w, 3): along and across the body's x-axis at the window's start (m), heading (rad).
    """
    paths = [body_path(drive, counts, values) for drive in drives]
    return relative(*at_ends(drives, paths, windows, values[LAGS].reshape(-1, 2))) - windows.moved
