"""Does the X4 measure? Judged by what its revolutions contain, not by whether bytes come."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from host.config import Lidar
from host.drivers.x4.packets import SAMPLE_RATE_HZ
from host.drivers.x4.revolution import FASTEST_HZ, SLOWEST_HZ
from host.errors import UserError
from host.messages import BoolArray, FloatArray, IntArray, Scan

WINDOW_S = 2.0  # over which revolutions, returns and samples are judged
SECTOR_WINDOW_S = 5.0
START_S = 5.0  # until the motor has its speed
NEAREST_M = 0.1  # what returns from closer is on the window itself
_COMPLETE_DEG = 330
_SPEED_TOLERANCE = 0.04
_SAMPLE_TOLERANCE = 0.1
_FEWEST_RETURNS = 0.005  # as share of the samples; 0.1 come back in the open
_FROZEN_REVOLUTIONS = 5
FROZEN_RETURNS = 20  # fewer may be the same by chance
# Recorded X4s see nothing in up to 37 deg of an office, and in two times 120 deg in the open.
_WIDEST_OPEN_DEG = 45
_WIDEST_COVER_DEG = 180  # a single straight wall leaves more empty than that
_OUTSTANDING = 1.6  # times as wide as the next widest empty sector
_FILLED_ELSEWHERE = 0.5
_FAR_M = 6.0  # walls that end in returns from here on go on beyond the lidar's 10 m
_BESIDE_DEG = 2  # a wall close by leads away within few degrees
_BRIDGED_DEG = 30  # a sector that is not judged separates no wider than this


@dataclass(frozen=True, slots=True)
class _Summary:
    """One revolution. returns, far (360,): per degree of bearing. extent: degrees with samples."""

    time: float
    samples: int
    speed_hz: float
    extent_deg: int
    returns: IntArray
    far: IntArray


class Repeats:
    """How many revolutions in a row are the one before again: a measurement's noise differs."""

    def __init__(self) -> None:
        self.count = 0
        self._last: FloatArray | None = None

    def add(self, ranges: FloatArray) -> None:
        """Take the ranges (n,) m of the next revolution."""
        same = self._last is not None and np.array_equal(ranges, self._last)
        self.count = self.count + 1 if same else 0
        self._last = ranges


class Liveness:
    """Collects revolutions and judges the last seconds.

    config: the [lidar] section, of which its mounting, field of view and blind sectors count.
    """

    def __init__(self, config: Lidar) -> None:
        self._heading_rad = config.heading_rad
        self._judged = judged_degrees(config)
        self._summaries: deque[_Summary] = deque()
        self._started: float | None = None
        self._arrived: deque[tuple[float, int]] = deque()  # host time, samples since the start
        self._first: tuple[float, int] | None = None  # of those that arrived
        self._repeats = Repeats()

    def add(self, scan: Scan, speed_hz: float) -> None:
        """Take the next revolution. speed_hz: of the motor, by the angles within its packets."""
        degrees = np.floor(np.degrees(scan.angles + self._heading_rad)).astype(np.intp) % 360
        back = scan.ranges >= NEAREST_M
        returns = np.bincount(degrees[back], minlength=360)
        far = np.bincount(degrees[scan.ranges >= _FAR_M], minlength=360)
        extent = 10 * np.count_nonzero(np.bincount(degrees // 10, minlength=36))
        self._repeats.add(scan.ranges)
        self._started = scan.time if self._started is None else self._started
        self._summaries.append(
            _Summary(scan.time, len(scan.ranges), speed_hz, int(extent), returns, far)
        )
        while self._summaries[0].time < scan.time - SECTOR_WINDOW_S:
            self._summaries.popleft()

    def fault(self, now: float, samples: int) -> UserError | None:
        """What is wrong at host time `now` (s), None where nothing is.

        samples: how many came since the start.
        """
        if self._arrived and now - self._arrived[-1][0] > WINDOW_S:
            # The program was suspended. What came in that time is lost, by no fault of the lidar.
            self._arrived.clear()
            self._first = None
        self._arrived.append((now, samples))
        self._first = self._first or (now, samples)
        while self._arrived[0][0] < now - WINDOW_S - 0.5:
            self._arrived.popleft()
        if now - self._arrived[0][0] < WINDOW_S - 0.5 or self._started is None:
            return None
        recent = [summary for summary in self._summaries if summary.time > now - WINDOW_S - 0.5]
        if not recent:
            return None
        settled = now - self._started > START_S
        return (
            (self._wrong_speed(recent) if settled else None)
            or self._no_revolution(recent, settled)
            or self._no_return(recent)
            or self._frozen_ranges(recent)
            or self._wrong_sample_rate()
            or (self._covered_sector() if settled else None)
        )

    @staticmethod
    def _wrong_speed(recent: list[_Summary]) -> UserError | None:
        speed = float(np.median([summary.speed_hz for summary in recent]))
        low, high = (1 - _SPEED_TOLERANCE) * SLOWEST_HZ, (1 + _SPEED_TOLERANCE) * FASTEST_HZ
        if speed == 0.0 or low <= speed <= high:
            return None
        return UserError(
            f"the motor makes {speed:.1f} revolutions/s, not {SLOWEST_HZ:.0f} to {FASTEST_HZ:.0f}",
            "its supply is weak, something brakes it, or the lidar is another model",
            "check that it turns freely and has 4.8 to 5.2 V and 1 A at the POWER lead",
        )

    @staticmethod
    def _no_revolution(recent: list[_Summary], settled: bool) -> UserError | None:
        widest = max(summary.extent_deg for summary in recent)
        standing = all(summary.speed_hz == 0.0 for summary in recent)
        if widest >= _COMPLETE_DEG or not (settled or standing):
            return None
        return UserError(
            "scanning, but no revolution is complete",
            "all packets have the same angle: the motor stands still or the angle sensor fails"
            if standing
            else f"the angles of its samples cover {widest} of 360 deg at most",
            "check that it turns freely; unplug both USB leads for some seconds",
        )

    @staticmethod
    def _no_return(recent: list[_Summary]) -> UserError | None:
        samples = sum(summary.samples for summary in recent)
        returns = sum(int(summary.returns.sum()) for summary in recent)
        if returns > _FEWEST_RETURNS * samples:
            return None
        what = "all ranges are zero: the laser does not fire"
        if returns:
            share = 100 * (1 - returns / samples)
            what = f"{share:.1f} % of the ranges are zero: the laser hardly fires"
        return UserError(
            what,
            "or something covers the whole window, or nothing is within 10 m",
            "hold a hand 30 cm beside the lidar: if this stays, the lidar is broken",
        )

    def _frozen_ranges(self, recent: list[_Summary]) -> UserError | None:
        if self._repeats.count < _FROZEN_REVOLUTIONS or recent[-1].returns.sum() < FROZEN_RETURNS:
            return None
        return UserError(
            f"the ranges are frozen: {self._repeats.count + 1} identical revolutions",
            "the noise of a measurement makes each one different",
            "unplug both USB leads of the lidar for some seconds",
        )

    def _wrong_sample_rate(self) -> UserError | None:
        rate = _rate(self._arrived[0], self._arrived[-1])
        if rate > SAMPLE_RATE_HZ:
            # What a busy host had left to wait comes at once, but is not more on the whole.
            rate = min(rate, _rate(self._first or self._arrived[0], self._arrived[-1]))
        if abs(rate / SAMPLE_RATE_HZ - 1.0) <= _SAMPLE_TOLERANCE:
            return None
        if rate > SAMPLE_RATE_HZ:
            return UserError(
                f"{rate:.0f} samples/s come, an X4 makes {SAMPLE_RATE_HZ:.0f}",
                "the lidar is another model",
                "check the label below the lidar: X4 and X4 Pro are supported",
            )
        return UserError(
            f"only {rate:.0f} samples/s come, an X4 makes {SAMPLE_RATE_HZ:.0f}",
            "packets are lost on the way, or the lidar is another model",
            "use no unpowered USB hub, and close other programs on the port",
        )

    def _covered_sector(self) -> UserError | None:
        if self._summaries[-1].time - self._summaries[0].time < 0.8 * SECTOR_WINDOW_S:
            return None
        returns = np.sum([summary.returns for summary in self._summaries], axis=0)
        sector = covered_sector(returns > 0, self._judged)
        far = np.sum([summary.far for summary in self._summaries], axis=0)
        if sector is None or _is_out_of_reach(sector, returns, far):
            return None
        return UserError(
            f"nothing comes back between {sector[0]} and {sector[1]} deg: "
            "something covers the window",
            "everywhere else there are returns",
            "look at the lidar's window there; a part of the robot belongs into blind_sectors in "
            "[lidar] of robot.toml",
        )


def _rate(before: tuple[float, int], after: tuple[float, int]) -> float:
    """Samples a second between two times at which they were counted."""
    return (after[1] - before[1]) / (after[0] - before[0])


def judged_degrees(config: Lidar) -> BoolArray:
    """Which degrees (360,) of bearing, from 0 counter-clockwise, are expected to see something."""
    bearing = (np.arange(360.0) + 180.5) % 360.0 - 180.0
    judged: BoolArray = np.abs(bearing) <= 0.5 * math.degrees(config.field_of_view_rad)
    for sector in config.blind_sectors:
        away = (bearing - math.degrees(sector.centre_rad) + 180.0) % 360.0 - 180.0
        judged &= np.abs(away) > 0.5 * math.degrees(sector.width_rad)
    return judged


def covered_sector(filled: BoolArray, judged: BoolArray) -> tuple[int, int] | None:
    """The sector (from, to) deg in which nothing comes back because something covers the window.

    filled (360,): degrees of bearing with returns; judged: those that are expected to have some.
    A room may be open to one side, too. So the sector has to be wide, to stand out from the other
    empty ones, and to have returns nearly everywhere else. In the open, where most samples do not
    come back, no sector is called covered.
    """
    seen = filled | _breaks(~judged)
    empty = sorted(_runs(~seen), key=lambda run: run[1])
    if not empty or not seen.any():
        return None
    start, width = _trimmed(*empty[-1], judged)
    others = [_trimmed(*run, judged)[1] for run in empty[:-1]]
    elsewhere = judged.copy()
    elsewhere[np.arange(start, start + width) % 360] = False
    if (
        not _WIDEST_OPEN_DEG <= width <= _WIDEST_COVER_DEG
        or width < _OUTSTANDING * max(others, default=0)
        or filled[elsewhere].mean() < _FILLED_ELSEWHERE
    ):
        return None
    return _signed(start), _signed(start + width)


def _is_out_of_reach(sector: tuple[int, int], returns: IntArray, far: IntArray) -> bool:
    """Do the walls on both sides of a sector lead away from the lidar, as those of a hall do?

    returns, far (360,): how many came from each degree of bearing, and from beyond _FAR_M.
    """
    begin, end = sector
    return all(
        2 * far.take(beside, mode="wrap").sum() >= returns.take(beside, mode="wrap").sum()
        for beside in (np.arange(begin - _BESIDE_DEG, begin), np.arange(end, end + _BESIDE_DEG))
    )


def _breaks(unjudged: BoolArray) -> BoolArray:
    """Those degrees that are not judged and too wide to look across."""
    wide = np.zeros(360, dtype=bool)
    for start, width in _runs(unjudged):
        if width > _BRIDGED_DEG:
            wide[np.arange(start, start + width) % 360] = True
    return wide


def _runs(true: BoolArray) -> list[tuple[int, int]]:
    """Start and length of each run of true values around the circle."""
    if true.all():
        return [(0, len(true))]
    before = np.roll(true, 1)
    starts, ends = np.flatnonzero(true & ~before), np.flatnonzero(~true & before)
    return [(int(s), int(min((ends - s) % len(true)))) for s in starts]


def _trimmed(start: int, width: int, judged: BoolArray) -> tuple[int, int]:
    """A run without the degrees at its ends that are not judged; width 0 where none is."""
    inside = np.flatnonzero(judged[np.arange(start, start + width) % 360])
    if not len(inside):
        return start, 0
    return start + int(inside[0]), int(inside[-1] - inside[0]) + 1


def _signed(degrees: int) -> int:
    return (degrees + 179) % 360 - 179
