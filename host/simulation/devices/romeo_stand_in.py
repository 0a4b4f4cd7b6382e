"""A Romeo board that is not there: it speaks the frames of protocol.toml, in virtual time."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from host.drivers.romeo.framing import DELIMITER, BoardDecoder, encode
from host.drivers.romeo.protocol import (
    ACCELERATION_MIN_TICKS_PER_S2,
    ACCELERATION_TICKS_PER_S2,
    BOARD_ROMEO_V2,
    COMMAND_TIMEOUT_MS,
    COUNTS_PER_TURN,
    COUNTS_PER_TURN_MIN,
    FIRMWARE_VERSION,
    FULL_SPEED_MIN_TICKS_PER_S,
    FULL_SPEED_TICKS_PER_S,
    INTEGRAL_16THS_PER_S,
    PROPORTIONAL_16THS,
    PROTOCOL_HASH,
    RADIUS_MAX_NM,
    RADIUS_NM,
    REPORT_RATE_HZ,
    REPORT_RATE_MAX_HZ,
    REPORT_RATE_MIN_HZ,
    RUNAWAY_MS,
    TRACK_MIN_NM,
    TRACK_NM,
    DisplacementFrame,
    DisplacementStatus,
    Frame,
    HelloFrame,
    IdentityFrame,
    ReadSettingsFrame,
    SettingsFrame,
    SettingsReversed,
    VelocityFrame,
)

VERSION = FIRMWARE_VERSION
EDGES_PER_PERIOD = 2
DEFAULTS = SettingsFrame(
    report_rate_hz=REPORT_RATE_HZ,
    reversed=0,
    full_speed=FULL_SPEED_TICKS_PER_S,
    proportional=PROPORTIONAL_16THS,
    integral=INTEGRAL_16THS_PER_S,
    acceleration=ACCELERATION_TICKS_PER_S2,
    runaway=RUNAWAY_MS,
    left_radius=RADIUS_NM,
    right_radius=RADIUS_NM,
    track=TRACK_NM,
    counts_per_turn=COUNTS_PER_TURN,
)
ALL_REVERSED = sum(SettingsReversed)
HARD_SHARE = 1 / 20  # of full speed; the board's control drives hard from about 1 / 36 on
PROGRESS_SHARE = 1 / 4


class _Odometry:
    """Distance (um) and heading (urad) by eq. 31 and 32, in floating point, report by report."""

    def __init__(self) -> None:
        self._ticks = (0, 0)
        self._distance = self._heading = 0.0

    def advance(self, ticks: tuple[int, int], settings: SettingsFrame) -> tuple[int, int]:
        """The wheels stand at these ticks (left, right), and came there with these settings."""
        turn = 2e-3 * math.pi / settings.counts_per_turn
        left = (ticks[0] - self._ticks[0]) * turn * settings.left_radius
        right = (ticks[1] - self._ticks[1]) * turn * settings.right_radius
        self._ticks = ticks
        self._distance += (left + right) / 2.0
        self._heading += 1e9 * (right - left) / settings.track
        return round(self._distance), round(self._heading)


class _FollowedWheel:
    """Does a wheel follow its command?"""

    def __init__(self) -> None:
        self.ran_away = False
        self._since: tuple[float, int, bool] | None = None  # time, ticks, forward

    def follow(self, now: float, asked: int, ticks: int, limit_s: float) -> None:
        """It should run at `asked` ticks/s (0: it is not driven hard) and stands at `ticks`."""
        forward = asked > 0
        if asked == 0 or self._since is None or self._since[2] != forward:
            self._since = (now, ticks, forward) if asked else None
            return
        since, mark, _ = self._since
        progress = (ticks - mark) * (1 if forward else -1)
        if progress < 0:
            self._since = since, ticks, forward
        elif progress >= max(2.0, abs(asked) * max(now - since, limit_s / 8) * PROGRESS_SHARE):
            self._since = now, ticks, forward
            return
        if limit_s and now - since >= limit_s:
            self.ran_away = True


class RomeoStandIn:
    """The board's behaviour at its serial port, without its electronics.

    Times are the simulation's, in seconds, and do not run backward. Wheels are the caller's: it
    asks `wheel_speeds` and answers `ticks`.

    It knows no duty: it takes a wheel for driven hard that should run faster than HARD_SHARE of
    settings.full_speed.

    protocol_hash, version, edges_per_period, illegal (transitions of the encoders), silent (sends
    nothing, its wheels and clock go on) and settings_defaulted may be set at any time.
    """

    def __init__(
        self,
        ticks: Callable[[float], tuple[int, int]],
        start: float = 0.0,
        first_count_us: int = 0,
        drift: float = 0.0,
    ) -> None:
        """ticks: encoder counts (left, right) at a time since some beginning, forward positive.

        start: when it is switched on, s. first_count_us: what its clock shows then.
        drift: relative error of its clock, positive where it is fast.
        """
        self.protocol_hash = PROTOCOL_HASH
        self.version: tuple[int, int, int] | None = None  # VERSION
        self.edges_per_period = EDGES_PER_PERIOD
        self.illegal = (0, 0)
        self.silent = False
        self.settings_defaulted = False
        self.settings = DEFAULTS
        self._ticks = ticks
        self._drift = drift
        self._switch_on(start, first_count_us)

    def reset(self, now: float) -> None:
        """As the reset button does: counters, clock and command are forgotten, settings stay."""
        self._switch_on(now, 0)

    def _switch_on(self, now: float, first_count_us: int) -> None:
        self._start, self._first_count_us = now, first_count_us
        self._first_ticks = self._ticks(now)
        self._decoder = BoardDecoder()
        self._misdirected = 0  # frames that only a board sends
        self._answers: deque[tuple[float, bytes]] = deque()
        self._greeted = False
        self._velocity: tuple[float, VelocityFrame] | None = None
        self._sequence = 0
        self._next_report = now
        self._odometry = _Odometry()
        self._wheels = _FollowedWheel(), _FollowedWheel()

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host arrive at `now`."""
        for frame in self._decoder.feed(data):
            answer = self._handle(frame, now)
            if answer is not None:
                self._answers.append((now, encode(answer)))

    def _handle(self, frame: Frame, now: float) -> Frame | None:
        if isinstance(frame, HelloFrame):
            self._greeted = True
            return IdentityFrame(
                self.protocol_hash,
                *(self.version or VERSION),
                BOARD_ROMEO_V2,
                self.edges_per_period,
            )
        if isinstance(frame, VelocityFrame):
            self._velocity = now, frame
            if (frame.left_ticks_per_s, frame.right_ticks_per_s) == (0, 0):
                self._wheels = _FollowedWheel(), _FollowedWheel()
        elif isinstance(frame, SettingsFrame):
            self._odometry.advance(self._counted(now), self.settings)
            self.settings = _bounded(frame)
            self.settings_defaulted = False
            return self.settings
        elif isinstance(frame, ReadSettingsFrame):
            return self.settings
        else:
            self._misdirected += 1
        return None

    def wheel_speeds(self, now: float) -> tuple[int, int]:
        """Commanded ticks/s (left, right); zero once they have timed out, or a wheel ran away."""
        if (
            self._velocity is None
            or self.has_timed_out(now)
            or any(w.ran_away for w in self._wheels)
        ):
            return 0, 0
        frame = self._velocity[1]
        return frame.left_ticks_per_s, frame.right_ticks_per_s

    def has_timed_out(self, now: float) -> bool:
        """Whether the last command is too old, so that the motors are off."""
        return self._velocity is not None and now >= self._velocity[0] + COMMAND_TIMEOUT_MS / 1000

    def transmit(self, now: float) -> list[tuple[float, bytes]]:
        """What it sent since the last call, up to `now`: (time, one frame's bytes), in order."""
        sent = []
        while self._answers or self._next_report <= now:
            if self._answers and self._answers[0][0] <= self._next_report:
                sent.append(self._answers.popleft())
            else:
                sent.append((self._next_report, self._report(self._next_report)))
                self._next_report += 1.0 / self.settings.report_rate_hz
        return [] if self.silent else sent

    def _counted(self, now: float) -> tuple[int, int]:
        """Ticks (left, right) since it was switched on."""
        left, right = self._ticks(now)
        return left - self._first_ticks[0], right - self._first_ticks[1]

    def _follow(self, now: float, ticks: tuple[int, int]) -> None:
        limit = self.settings.runaway / 1000
        hard = HARD_SHARE * self.settings.full_speed
        for wheel, asked, at in zip(self._wheels, self.wheel_speeds(now), ticks, strict=True):
            wheel.follow(now, asked if abs(asked) > hard else 0, at, limit)

    def _report(self, now: float) -> bytes:
        left, right = self._counted(now)
        self._follow(now, (left, right))
        distance, heading = self._odometry.advance((left, right), self.settings)
        status = DisplacementStatus(0)
        if not self._greeted:
            status |= DisplacementStatus.FRESH
        if self.has_timed_out(now):
            status |= DisplacementStatus.COMMAND_TIMED_OUT
        if self.settings_defaulted:
            status |= DisplacementStatus.SETTINGS_DEFAULTED
        if self._wheels[0].ran_away:
            status |= DisplacementStatus.LEFT_RUNAWAY
        if self._wheels[1].ran_away:
            status |= DisplacementStatus.RIGHT_RUNAWAY
        frame = DisplacementFrame(
            sequence=self._sequence,
            board_time_us=self.clock_us(now),
            left_ticks=_signed(left),
            right_ticks=_signed(right),
            distance_um=_signed(distance),
            heading_urad=_signed(heading),
            status=int(status),
            left_illegal=self.illegal[0] & 0xFFFF,
            right_illegal=self.illegal[1] & 0xFFFF,
            dropped_frames=0,
            bad_frames=min(self._decoder.counts.refused + self._misdirected, 0xFFFF),
        )
        self._sequence = (self._sequence + 1) & 0xFFFF
        # A zero byte ahead of the first frame ends whatever a bootloader may have said before.
        return (DELIMITER if frame.sequence == 0 else b"") + encode(frame)

    def clock_us(self, now: float) -> int:
        """What the board's 32-bit clock shows at `now`."""
        run = math.floor((now - self._start) * (1.0 + self._drift) * 1e6)
        return (self._first_count_us + run) % (1 << 32)


def _bounded(frame: SettingsFrame) -> SettingsFrame:
    """The same with each field brought to its nearest bound."""
    return replace(
        frame,
        report_rate_hz=min(max(frame.report_rate_hz, REPORT_RATE_MIN_HZ), REPORT_RATE_MAX_HZ),
        reversed=frame.reversed & ALL_REVERSED,
        full_speed=max(frame.full_speed, FULL_SPEED_MIN_TICKS_PER_S),
        acceleration=max(frame.acceleration, ACCELERATION_MIN_TICKS_PER_S2),
        left_radius=min(frame.left_radius, RADIUS_MAX_NM),
        right_radius=min(frame.right_radius, RADIUS_MAX_NM),
        track=max(frame.track, TRACK_MIN_NM),
        counts_per_turn=max(frame.counts_per_turn, COUNTS_PER_TURN_MIN),
    )


def _signed(count: int) -> int:
    """A count as a 32-bit register holds it."""
    return (count + (1 << 31)) % (1 << 32) - (1 << 31)
