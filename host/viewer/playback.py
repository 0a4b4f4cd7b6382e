"""Where a replay is, and what a person asked of it: play, pause, step, speed, any time."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

from host.errors import UserError
from host.messages import Displacement, Message

SHOW_S = 0.1  # so often the one who waits shows where it is
_SOON_S = 1e-6  # nobody sleeps so short
_SPEEDS = (0.01, 1000.0)


class SeekBackError(Exception):
    """The replay is to restart: what was asked for is before the present."""


@dataclass(frozen=True, slots=True)
class Position:
    """Where a replay is. begin, end, now: s of the recording's clock; speed: times real time."""

    begin: float
    end: float
    now: float
    speed: float
    playing: bool


class Playback:
    """`command` may be called in any thread; all else belongs to that of the replay.

    begin, end: of the recording, s of its clock. clock: host time, s.
    """

    def __init__(
        self,
        begin: float,
        end: float,
        speed: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._begin, self._end, self._clock = begin, end, clock
        self._speed = speed
        self._now = begin
        self._playing = True
        self._stepping = False
        self._target = -math.inf  # up to which it goes as fast as possible
        self._anchor = clock(), begin  # of both clocks, at the last change
        self._news = threading.Condition()

    @classmethod
    def of(cls, messages: Iterable[Message], speed: float = 1.0, start_s: float = 0.0) -> Self:
        """Of a recording, from its first displacement to its last, or to its damage.

        start_s: after its beginning, up to where it goes at once.
        """
        times: list[float] = []
        with contextlib.suppress(UserError):
            for message in messages:
                if isinstance(message, Displacement):
                    times.append(message.time)
        begin = min(times, default=0.0)
        made = cls(begin, max(times, default=0.0), speed)
        made.command("seek", begin + start_s)
        return made

    @property
    def position(self) -> Position:
        """Where it is."""
        return Position(self._begin, self._end, self._now, self._speed, self._playing)

    def command(self, do: str, to: Any = None) -> None:
        """Do play, pause, step (to the next estimate), speed or seek (to: times, or s).

        Raises ValueError for anything else.
        """
        with self._news:
            if do in ("play", "pause"):
                self._playing = do == "play"
            elif do == "step":
                self._playing, self._stepping = False, True
            elif do == "speed" and _SPEEDS[0] <= _number(to) <= _SPEEDS[1]:
                self._speed = float(to)
            elif do == "seek" and math.isfinite(_number(to)):
                self._target = min(max(float(to), self._begin), self._end)
            else:
                raise ValueError(f"a replay cannot do {do!r} to {to!r}")
            self._anchor = self._clock(), self._now
            self._news.notify()

    def reach(self, moment: float, show: Callable[[], None]) -> None:
        """Wait until it is this moment; `show` is called meanwhile. Raises SeekBackError."""
        while True:
            with self._news:
                self._turn_back(moment)
                if moment <= self._target or self._stepping:
                    left = 0.0
                    self._anchor = self._clock(), moment
                elif self._playing:
                    left = self._left(moment)
                else:
                    left = SHOW_S
                if left <= _SOON_S:
                    self._now = max(self._now, moment)
                    return
                self._news.wait(min(left, SHOW_S))
            show()

    def estimated(self) -> None:
        """An estimate was made: a step ends with it."""
        self._stepping = False

    def rest(self, show: Callable[[], None]) -> None:
        """Stay at the end until `show` raises something; to play from there is to restart."""
        with self._news:
            self._playing = self._stepping = False
        while True:
            with self._news:
                if self._playing:
                    self._target = self._begin
                self._turn_back(math.inf)
                self._news.wait(SHOW_S)
            show()

    def restart(self) -> None:
        """The replay starts at its first message again."""
        with self._news:
            self._now = self._begin
            self._anchor = self._clock(), self._begin
            if self._target <= self._begin:
                self._target = -math.inf

    def _turn_back(self, following: float) -> None:
        """Raise SeekBackError where it was asked to. following: the next moment there is, s."""
        if math.isfinite(self._target) and self._target < self._now:
            raise SeekBackError
        if self._target < following:
            self._target = -math.inf  # it is there

    def _left(self, moment: float) -> float:
        host, recorded = self._anchor
        return (moment - recorded) / self._speed - (self._clock() - host)


def _number(value: Any) -> float:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
