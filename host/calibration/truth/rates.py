"""How fast a path goes and rotates, and at which lag that fits another path best."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.config import Mocap
from host.errors import UserError
from host.geometry import Path, to_parent
from host.messages import Displacement, FloatArray
from host.recording.elsewhere.named_columns import BodyPath

STEP_S, WINDOW_S = 0.05, 0.2  # of the rates, and over how long each is taken
MOVING = np.array([0.02, 0.05])  # m/s, rad/s: rms of a robot that moves
LEAST_OVERLAP_S = 10.0
_GAP_S, _GAP_INTERVALS = 0.1, 2.5  # a longer gap is one in which nothing was seen
_CORRELATION_TIME_S = 1.0  # of the differences of the rates
_RISE = 9.0  # of twice the log likelihood: 3 sigmas
_LEFT_FLOOR = 1e-2  # of what is left, in squares of MOVING


class Rates:
    """Speed (m/s) and heading rate (rad/s) of a path at any times, nan where it was not seen."""

    def __init__(self, path: BodyPath) -> None:
        self._times, self._poses = path.times, path.poses.copy()
        self._poses[:, 2] = np.unwrap(path.poses[:, 2])
        steps = np.diff(path.times)
        gap = max(_GAP_S, _GAP_INTERVALS * float(np.median(steps)))
        self._holes = np.concatenate(([0], np.cumsum(steps > gap)))

    @property
    def first(self) -> float:
        """When the path begins."""
        return float(self._times[0])

    def at(self, times: FloatArray) -> FloatArray:
        """(n, 2) at `times` (n,) s."""
        ends = times + np.array([[-0.5], [0.5]]) * WINDOW_S
        first, last = (
            np.stack([np.interp(t, self._times, c) for c in self._poses.T]) for t in ends
        )
        rates = np.stack((np.hypot(*(last - first)[:2]), (last - first)[2]), axis=1) / WINDOW_S
        before, after = (
            np.searchsorted(self._times, ends[0], "right"),
            np.searchsorted(self._times, ends[1]),
        )
        inside = (before > 0) & (after < len(self._times))
        before, after = np.maximum(before - 1, 0), np.minimum(after, len(self._times) - 1)
        rates[~inside | (self._holes[before] != self._holes[after])] = math.nan
        return np.asarray(rates)

    def grid(self, stretch: float = 1.0) -> FloatArray:
        """Times every 0.05 s, times `stretch`, from the first to the last."""
        return np.arange(self._times[0], self._times[-1], stretch * STEP_S)


@dataclass(frozen=True, slots=True)
class Found:
    """The search at one drift, at each of lags (k,) s of the tracker's clock.

    gain (k,): how much likelier it is than that both paths are unrelated. seconds (k,): of overlap;
    left (k, 2): mean square of what the wheels leave of speed and heading rate in it.
    """

    drift: float
    lags: FloatArray
    gain: FloatArray
    seconds: FloatArray
    left: FloatArray

    @property
    def best(self) -> float:
        return float(self.lags[np.argmax(self.gain)])

    @property
    def alike(self) -> FloatArray:
        """Lags (m,) of about as long an overlap that fit about as well in it as the best does."""
        best = np.argmax(self.gain)
        worse = np.log(self.left / self.left[best]).sum(axis=1)
        as_good = self.seconds / _CORRELATION_TIME_S * worse <= _RISE
        return np.asarray(self.lags[as_good & (self.seconds >= 0.5 * self.seconds[best])])


def search(seen: FloatArray, wheels: Rates, drift: float) -> Found:
    """Rates (n, 2) against the wheels' at each lag: equal but for a factor, and noise."""
    # Here, because it takes a quarter of the time in which any command starts.
    from scipy.signal import correlate

    other = wheels.at(wheels.grid(1.0 + drift))
    known = [np.isfinite(rates).all(axis=1).astype(float) for rates in (seen, other)]
    a, b = (
        np.where(k[:, None] > 0.0, r, 0.0) / MOVING
        for k, r in zip(known, (seen, other), strict=True)
    )
    lags = np.arange(-(len(a) - 1), len(b))
    count = np.rint(correlate(known[1], known[0], method="fft"))
    gain, left = np.zeros(len(lags)), np.zeros((len(lags), 2))
    for k, (x, y) in enumerate(zip(a.T, b.T, strict=True)):
        xx = correlate(known[1], x**2, method="fft")
        yy = correlate(y**2, known[0], method="fft")
        share = correlate(y, x, method="fft") ** 2 / np.maximum(xx * yy, 1e-3 * count**2 + 1e-9)
        unrelated = 1.0 - np.clip(share, 0.0, 0.9999)
        gain -= count * STEP_S / _CORRELATION_TIME_S * np.log(unrelated)
        left[:, k] = unrelated * np.maximum(xx, 0.0) / np.maximum(count, 1.0) + _LEFT_FLOOR
    gain[count * STEP_S < LEAST_OVERLAP_S] = 0.0
    return Found(drift, np.asarray(lags * STEP_S), gain, count * STEP_S, left)


def path_by_wheels(steps: Sequence[Displacement], mocap: Mocap) -> BodyPath:
    """The path of the tracked body as the wheels have it, from displacements in order of time.

    Raises UserError where there are none.
    """
    if not steps:
        raise UserError(
            "there is no odometry to align the true path by",
            "the recording holds no displacement of the robot",
            "record with the board connected",
        )
    path = Path(keep_seconds=math.inf)
    for step in steps:
        path.append(step)
    times = np.array([steps[0].time - steps[0].interval, *(step.time for step in steps)])
    times = np.unique(times)
    poses = path.poses(times)
    places = to_parent(np.broadcast_to((mocap.x_m, mocap.y_m), (len(poses), 2)), poses)
    return BodyPath("", times, np.column_stack((places, poses[:, 2] + mocap.heading_rad)))
