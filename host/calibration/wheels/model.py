"""How a robot's wheels move the body that motion capture tracks, and by how much they miss it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.config import Mocap, Wheels
from host.geometry import to_frame, to_parent, wrap
from host.messages import BoolArray, FloatArray, IntArray

# Where things are in a vector of values: left and right radius, track (m); x, y (m) and heading
# (rad) of the body in the robot frame; and for each drive by how much the stamps of its ticks are
# late (s) at its start and at its end. Clocks drift: in recorded runs by 50 ms in a minute.
GEOMETRY, BODY, LAGS = slice(0, 3), slice(3, 6), slice(6, None)


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive: wheel ticks and the true path of the tracked body.

    times (n,) s; ticks (n, 2): left, right, counted from the start. truth_times (m,) s;
    truth (m, 3): x, y (m), heading (rad, not wrapped) on the floor; instants at which the body
    was lost are left out.
    """

    times: FloatArray
    ticks: IntArray
    truth_times: FloatArray
    truth: FloatArray
    name: str = ""

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


def values_of(wheels: Wheels, mocap: Mocap, drives: int = 0) -> FloatArray:
    """Values (6 + 2 drives,) as they are configured: without lags."""
    geometry = wheels.left_radius_m, wheels.right_radius_m, wheels.track_m
    return np.array([*geometry, mocap.x_m, mocap.y_m, mocap.heading_rad, *([0.0] * 2 * drives)])


def configured(values: FloatArray, wheels: Wheels, mocap: Mocap) -> tuple[Wheels, Mocap]:
    """The configuration with fitted values in it; the lags have no place there."""
    left, right, track, x, y, heading = values[:6].tolist()
    return (
        wheels.model_copy(
            update={"left_radius_m": left, "right_radius_m": right, "track_m": track}
        ),
        mocap.model_copy(update={"x_m": x, "y_m": y, "heading_rad": float(wrap(heading))}),
    )


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


def compose(frames: FloatArray, pose: FloatArray) -> FloatArray:
    """Where poses (n, 3) or (3,), given in frames at `frames` (n, 3), are in their parent."""
    points = np.broadcast_to(pose[..., :2], (len(frames), 2))
    return np.column_stack((to_parent(points, frames), frames[:, 2] + pose[..., 2]))


def stamps(drive: Drive, lags: FloatArray, times: FloatArray) -> FloatArray:
    """What the ticks' clock shows at the true `times` (k,); lags (2,) s at its start and end."""
    return np.asarray(times + np.interp(times, drive.span, lags))


def at(drive: Drive, columns: FloatArray, lags: FloatArray, times: FloatArray) -> FloatArray:
    """Rows (n, c), known at the stamps of a drive's ticks, at the true `times` (k,): (k, c)."""
    shown = stamps(drive, lags, times)
    return np.stack([np.interp(shown, drive.times, column) for column in columns.T], axis=1)


def body_path(drive: Drive, counts: int, values: FloatArray) -> FloatArray:
    """Poses (n, 3) of the tracked body at drive.times by the wheels alone.

    They start at the body's own pose in the robot frame.
    """
    return compose(path(drive, counts, values), values[BODY])


@dataclass(frozen=True, slots=True)
class Windows:
    """Pairs of true poses that lie so many seconds apart.

    drives (w,): which drive each is of. starts, ends (w,): indices of poses of its truth.
    """

    drives: IntArray
    starts: IntArray
    ends: IntArray

    def __len__(self) -> int:
        return len(self.drives)

    def where(self, chosen: BoolArray) -> "Windows":
        """Those chosen (w,)."""
        return Windows(self.drives[chosen], self.starts[chosen], self.ends[chosen])


def windows_of(drives: Sequence[Drive], length_s: float, stride_s: float) -> Windows:
    """Windows of `length_s`, one each `stride_s`, wherever both ends were seen."""
    parts = [np.zeros((0, 3), dtype=np.int64)]
    for number, drive in enumerate(drives):
        times, (first, last) = drive.truth_times, drive.span
        due = np.arange(first, last - length_s + 1e-9, stride_s)
        if last - first < length_s:
            continue
        starts, ends = _nearest(times, due), _nearest(times, due + length_s)
        off = np.maximum(np.abs(times[starts] - due), np.abs(times[ends] - due - length_s))
        good = (times[starts] >= first) & (times[ends] <= last) & (off <= 0.5 * stride_s)
        parts.append(np.stack((np.full(len(due), number), starts, ends), axis=1)[good])
    return Windows(*np.concatenate(parts).T)


def advance(drives: Sequence[Drive], columns: Sequence[FloatArray], windows: Windows) -> FloatArray:
    """By how much columns (n, c) of each drive, one row a time, grow in each window (w, c)."""
    grown = np.zeros((len(windows), columns[0].shape[1]))
    still = np.zeros(2)
    for number, (drive, rows) in enumerate(zip(drives, columns, strict=True)):
        own = windows.drives == number
        start, end = (
            at(drive, rows, still, drive.truth_times[index[own]])
            for index in (windows.starts, windows.ends)
        )
        grown[own] = end - start
    return grown


def _nearest(times: FloatArray, due: FloatArray) -> IntArray:
    after = np.clip(np.searchsorted(times, due), 1, len(times) - 1)
    earlier = due - times[after - 1] < times[after] - due
    return np.asarray(after - earlier, dtype=np.int64)


def motions(drives: Sequence[Drive], windows: Windows) -> FloatArray:
    """How the body truly moved in each window (w, 3), seen from its pose at the start."""
    moved = np.zeros((len(windows), 3))
    for number, drive in enumerate(drives):
        own = windows.drives == number
        moved[own] = relative(drive.truth[windows.starts[own]], drive.truth[windows.ends[own]])
    return moved


def misses(
    drives: Sequence[Drive], counts: int, values: FloatArray, windows: Windows
) -> FloatArray:
    """By how much the wheels miss the motion in each window.

    (w, 3): along and across the body's x-axis at the window's start (m), heading (rad).
    """
    wrong = -motions(drives, windows)
    lags = values[LAGS].reshape(-1, 2)
    for number, drive in enumerate(drives):
        own = windows.drives == number
        poses = body_path(drive, counts, values)
        starts, ends = (
            at(drive, poses, lags[number], drive.truth_times[index[own]])
            for index in (windows.starts, windows.ends)
        )
        wrong[own] += relative(starts, ends)
    return wrong
