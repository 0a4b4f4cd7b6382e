"""A Romeo board that is not there: speaks the frames of protocol.toml, in any time it is told."""

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
    FULL_SPEED_MIN_TICKS_PER_S,
    FULL_SPEED_TICKS_PER_S,
    INTEGRAL_16THS_PER_S,
    PROPORTIONAL_16THS,
    PROTOCOL_HASH,
    REPORT_RATE_HZ,
    REPORT_RATE_MAX_HZ,
    REPORT_RATE_MIN_HZ,
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

VERSION = (0, 1, 0)
DEFAULTS = SettingsFrame(
    report_rate_hz=REPORT_RATE_HZ,
    reversed=0,
    full_speed=FULL_SPEED_TICKS_PER_S,
    proportional=PROPORTIONAL_16THS,
    integral=INTEGRAL_16THS_PER_S,
    acceleration=ACCELERATION_TICKS_PER_S2,
)
ALL_REVERSED = sum(SettingsReversed)


class RomeoStandIn:
    """The board's behaviour at its serial port, without its electronics.

    Times are the simulation's, in seconds, and do not run backward. Wheels are the caller's: it
    asks `wheel_speeds` and answers `ticks`.

    protocol_hash, silent (sends nothing, its wheels and clock go on) and settings_defaulted may be
    set at any time.
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

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host arrive at `now`."""
        for frame in self._decoder.feed(data):
            answer = self._handle(frame, now)
            if answer is not None:
                self._answers.append((now, encode(answer)))

    def _handle(self, frame: Frame, now: float) -> Frame | None:
        if isinstance(frame, HelloFrame):
            self._greeted = True
            return IdentityFrame(self.protocol_hash, *VERSION, board=BOARD_ROMEO_V2)
        if isinstance(frame, VelocityFrame):
            self._velocity = now, frame
        elif isinstance(frame, SettingsFrame):
            self.settings = replace(
                frame,
                report_rate_hz=min(
                    max(frame.report_rate_hz, REPORT_RATE_MIN_HZ), REPORT_RATE_MAX_HZ
                ),
                reversed=frame.reversed & ALL_REVERSED,
                full_speed=max(frame.full_speed, FULL_SPEED_MIN_TICKS_PER_S),
                acceleration=max(frame.acceleration, ACCELERATION_MIN_TICKS_PER_S2),
            )
            self.settings_defaulted = False
            return self.settings
        elif isinstance(frame, ReadSettingsFrame):
            return self.settings
        else:
            self._misdirected += 1
        return None

    def wheel_speeds(self, now: float) -> tuple[int, int]:
        """Commanded ticks/s (left, right) at `now`; zero once the command has timed out."""
        if self._velocity is None or self._timed_out(now):
            return 0, 0
        frame = self._velocity[1]
        return frame.left_ticks_per_s, frame.right_ticks_per_s

    def _timed_out(self, now: float) -> bool:
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

    def _report(self, now: float) -> bytes:
        left, right = self._ticks(now)
        status = DisplacementStatus(0)
        if not self._greeted:
            status |= DisplacementStatus.FRESH
        if self._timed_out(now):
            status |= DisplacementStatus.COMMAND_TIMED_OUT
        if self.settings_defaulted:
            status |= DisplacementStatus.SETTINGS_DEFAULTED
        frame = DisplacementFrame(
            sequence=self._sequence,
            board_time_us=self.clock_us(now),
            left_ticks=_signed(left - self._first_ticks[0]),
            right_ticks=_signed(right - self._first_ticks[1]),
            status=int(status),
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


def _signed(count: int) -> int:
    """A count as a 32-bit register holds it."""
    return (count + (1 << 31)) % (1 << 32) - (1 << 31)
