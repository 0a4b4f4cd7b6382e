"""Wheels against lidar: does the robot move as its encoders report?

Once per second a scan is compared with one about a second older. Where it does not fit the motion
that the wheels report, but does fit another motion, wheels and lidar contradict each other.
"""

import math
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np

from host.config import RobotConfig
from host.errors import UserError
from host.geometry import Path, wrap
from host.messages import FloatArray, Scan
from host.perception.odometry_gains import arc_of
from host.perception.scan_match import FEWEST_RETURNS, Surroundings, returns_of

_INTERVAL_S = (1.0, 1.6)  # between two scans that are compared
# In simulation 0.1 of the returns have no counterpart, 0.3 in a crowd of 20.
_FITS = 0.25  # not more than this share
_FITS_OTHERWISE = 0.4
_BETTER = 0.2  # what another motion has to explain besides
_APART_M, _APART_RAD = 0.1, 0.2  # by so much the two motions have to differ
_STANDS_M, _STANDS_RAD = 0.03, 0.06
_WHEEL_M = 0.06  # how well the lidar knows a wheel's travel
_VERDICTS = 10  # the last ones, of which ...
_CONTRADICTIONS = 4  # ... so many are a fault
_KEEP_S = 20.0


@dataclass(frozen=True, slots=True)
class _Seen:
    """Returns of one scan in the robot frame. plain: without the odometry's de-skewing."""

    time: float
    carried: Surroundings
    carried_points: FloatArray
    plain: Surroundings
    plain_points: FloatArray


@dataclass(frozen=True, slots=True)
class _Verdict:
    """kind: of the contradiction, "" where there is none. Motions (3,) in `seconds`."""

    time: float
    kind: str
    seconds: float
    reported: FloatArray
    seen: FloatArray


class WheelsAgainstLidar:
    """Collects one verdict per second and evaluates the last ten."""

    def __init__(self, config: RobotConfig) -> None:
        self.compared = 0
        self.contradictions = 0
        self._mounting = np.array([config.lidar.x_m, config.lidar.y_m, config.lidar.heading_rad])
        self._half_track = 0.5 * config.wheels.track_m
        self._last: _Seen | None = None
        self._verdicts: deque[_Verdict] = deque(maxlen=_VERDICTS)
        self._kind_reported = ""
        self._reported = UserError("")

    def take(self, scan: Scan, path: Path) -> None:
        """Take the next scan. path: of the odometry, which has reached the scan's end."""
        if self._last is not None and 0.0 <= scan.time - self._last.time < _INTERVAL_S[0]:
            return
        last, self._last = self._last, self._see(scan, path)
        while self._verdicts and self._verdicts[0].time < scan.time - _KEEP_S:
            self._verdicts.popleft()
        if last is None or self._last is None or self._last.time - last.time > _INTERVAL_S[1]:
            return
        verdict = self._judge(last, self._last, path)
        if verdict is not None:
            self.compared += 1
            self.contradictions += bool(verdict.kind)
            self._verdicts.append(verdict)

    def forget(self) -> None:
        """The odometry has a gap: nothing before it can be compared with what follows."""
        self._last = None

    def fault(self) -> UserError | None:
        """How the two contradict each other, None where they do not.

        Its figures are those of its first seconds: one fault is not reported in new words each
        second.
        """
        against = [verdict for verdict in self._verdicts if verdict.kind]
        if len(against) < _CONTRADICTIONS:
            self._kind_reported = ""
            return None
        kinds = Counter(verdict.kind for verdict in against)
        kind = max(kinds, key=lambda kind: (kind != "differs" and kinds[kind] > 1, kinds[kind]))
        if kind != self._kind_reported:
            self._kind_reported = kind
            self._reported = _explained([verdict for verdict in against if verdict.kind == kind])
        return self._reported

    def _see(self, scan: Scan, path: Path) -> _Seen | None:
        plain, times = returns_of(scan, self._mounting)
        if len(plain) < FEWEST_RETURNS:
            return None
        carried = path.carry(plain, times, scan.time)
        return _Seen(scan.time, Surroundings(carried), carried, Surroundings(plain), plain)

    def _judge(self, before: _Seen, now: _Seen, path: Path) -> _Verdict | None:
        """A verdict; None where neither the reported motion nor another one fits."""
        step = path.between(before.time, now.time)
        reported = np.array([step.dx, step.dy, step.dpsi])
        misfit = before.carried.misfit(now.carried_points, reported)
        if misfit <= _FITS:
            return _Verdict(now.time, "", step.interval, reported, reported)
        as_reported = before.carried.match(now.carried_points, reported)
        from_rest = before.plain.match(now.plain_points, before.plain.rotation(now.plain_points))
        misfit_seen, seen = min(
            (before.carried.misfit(now.carried_points, as_reported), tuple(as_reported)),
            (before.plain.misfit(now.plain_points, from_rest), tuple(from_rest)),
        )
        motion = np.array([seen[0], seen[1], float(wrap(seen[2]))])
        if misfit_seen > _FITS_OTHERWISE or misfit - misfit_seen < _BETTER:
            return None
        if _within(motion - reported, _APART_M, _APART_RAD):
            return _Verdict(now.time, "", step.interval, reported, reported)
        kind = self._kind(reported, motion)
        return _Verdict(now.time, kind, step.interval, reported, motion)

    def _kind(self, reported: FloatArray, seen: FloatArray) -> str:
        if _within(seen, _STANDS_M, _STANDS_RAD):
            return "stands"
        if _within(reported, _STANDS_M, _STANDS_RAD):
            return "moves"
        if abs(reported[2]) > _APART_RAD and abs(reported[2] + seen[2]) < _APART_RAD:
            return "mirrored"
        said, true = (wheel_travel(motion, self._half_track) for motion in (reported, seen))
        left, right = np.abs(said - true) < _WHEEL_M
        if left == right:
            return "differs"
        return "right wheel" if left else "left wheel"


def _within(motion: FloatArray, distance: float, angle: float) -> bool:
    return math.hypot(motion[0], motion[1]) < distance and abs(float(wrap(motion[2]))) < angle


def wheel_travel(motion: FloatArray, half_track: float) -> FloatArray:
    """How far (left, right) m the wheels rolled for a motion (3,) along one arc."""
    travel, rotation = arc_of(motion)
    return np.array([travel - half_track * rotation, travel + half_track * rotation])


def _speeds(verdicts: list[_Verdict], which: str) -> str:
    """Median speeds in words, as "0.30 m/s, 12 deg/s"."""
    motions = np.array([getattr(verdict, which) for verdict in verdicts])
    seconds = np.array([verdict.seconds for verdict in verdicts])
    speed = float(np.median(np.hypot(motions[:, 0], motions[:, 1]) / seconds))
    rate = math.degrees(float(np.median(motions[:, 2] / seconds)))
    return f"{speed:.2f} m/s, {round(rate) + 0:+d} deg/s"


def _explained(verdicts: list[_Verdict]) -> UserError:
    reported, seen = _speeds(verdicts, "reported"), _speeds(verdicts, "seen")
    kind = verdicts[0].kind
    if kind == "stands":
        return UserError(
            f"the wheels report {reported}, but the lidar sees nothing move",
            "the wheels slip or hang in the air, an encoder counts its own noise, or the lidar "
            "repeats an old scan",
            "put the robot on the floor; if it does drive, restart the lidar; if its wheels stand "
            "still, check the encoder leads",
        )
    if kind == "moves":
        return UserError(
            f"the lidar sees the robot move ({seen}), but the wheels report that it stands",
            "it is carried or pushed, or no encoder counts: a lead or their supply is loose",
            "put it down; if it drives by itself, check the encoder leads and their 5 V",
        )
    what = f"the wheels report {reported}, the lidar sees {seen}"
    if kind == "mirrored":
        return UserError(
            f"{what}: the rotation is reversed",
            "the two encoders are exchanged, or the lidar is mounted upside down",
            "exchange the leads of the left and the right encoder; see docs/hardware.md",
        )
    if kind == "differs":
        return UserError(
            what,
            "an encoder misses counts or is reversed, wheels slip, or [wheels] is another robot's",
            "check the encoder leads and robot.toml: swarmloc calibrate wheels",
        )
    side = kind.partition(" ")[0]
    return UserError(
        f"{what}: the {kind} does not turn as its encoder says",
        f"the {side} encoder is loose or reversed, or the {kind} slips or is blocked",
        f"check the leads of the {side} encoder and {side}_encoder_reversed in robot.toml",
    )
