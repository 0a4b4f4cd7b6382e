"""The screen of a run: a table of teammates and the devices' health.

On a terminal it is redrawn in place; elsewhere there is one line a second, and one for each change
of a device.
"""

import io
import math
import os
import shutil
import textwrap
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TextIO

import segno

from host.cli.terminal import teammates
from host.cli.terminal.teammates import Paint
from host.errors import one_line
from host.messages import Health, Message, Now

FRAME_S = 0.2
LINE_S = 1.0
_WIDEST = 100  # columns: longer lines are hard to read
_SILENT_S = 0.6  # some revolutions: then the sensors say nothing
_HOME, _TO_LINE_END, _TO_SCREEN_END = "\x1b[H", "\x1b[K", "\x1b[J"
_CLEAR, _HIDE_CURSOR, _SHOW_CURSOR = "\x1b[2J", "\x1b[?25l", "\x1b[?25h"
_CODES = {"bold": "1", "dim": "2", "red": "31;1", "green": "32", "": ""}


def plain(text: str, style: str) -> str:
    """Text without any style."""
    return text


def coloured(text: str, style: str) -> str:
    """Text in a style: bold, dim, red or green."""
    return f"\x1b[{_CODES[style]}m{text}\x1b[0m" if style else text


@dataclass
class State:
    """What the screen shows. title: what runs; filter_name, sensors: as chosen; page: its address.

    seconds: since the start; real_time_factor: measured seconds per second of the clock. now: the
    newest look at what is known.
    """

    title: str
    filter_name: str
    sensors: str
    page: str = ""
    seconds: float = 0.0
    real_time_factor: float = math.nan
    now: Now | None = None
    devices: dict[str, Health] = field(default_factory=dict)

    @property
    def silent_s(self) -> float:
        """How long nothing was measured that the estimate could use, s."""
        return 0.0 if self.now is None else self.now.estimate.time - self.now.measured


def frame(state: State, width: int, paint: Paint = plain) -> list[str]:
    """The whole screen as lines of at most `width` columns."""
    width = min(width, _WIDEST)
    return [
        *_header(state, width, paint),
        "",
        *_table(state, width, paint),
        "",
        *_devices(state, width, paint),
        *(_code(state.page.split()[0]) if "token=" in state.page else []),
    ]


@lru_cache(maxsize=1)
def _code(address: str) -> list[str]:
    """An address as a QR code, two modules a letter, for a phone's camera."""
    drawn = io.StringIO()
    segno.make(address, error="l", micro=False).terminal(out=drawn, border=2, compact=True)
    return ["", *drawn.getvalue().splitlines()]


def line(state: State) -> str:
    """One second of the run on one line."""
    parts = [f"{state.seconds:7.1f} s", _tally(state)]
    if state.silent_s > _SILENT_S:
        parts.append(f"nothing measured for {state.silent_s:.1f} s")
    parts += [f"{name} FAIL" for name, health in state.devices.items() if not health.ok]
    return "  ".join(parts)


def _header(state: State, width: int, paint: Paint) -> list[str]:
    minutes, seconds = divmod(state.seconds, 60.0)
    clock = f"{minutes:02.0f}:{seconds:04.1f}" if minutes < 100 else f"{minutes:.0f} min"
    known = not math.isnan(state.real_time_factor) and state.silent_s <= _SILENT_S
    factor = f"   real time x{state.real_time_factor:.2f}" if known else ""
    lines = [
        paint(f"swarmloc   {state.title}"[:width], "bold"),
        f"{clock}   filter {state.filter_name}   sensors {state.sensors}{factor}"[:width],
    ]
    return [*lines, f"live page   {state.page}"] if state.page else lines


def _table(state: State, width: int, paint: Paint) -> list[str]:
    if state.now is None:
        return [
            paint(teammates.HEADING, "dim"),
            "  no estimate yet",
            "",
            paint(_tally(state), "bold"),
        ]
    lines = [*teammates.table(state.now, width, paint), "", paint(_tally(state), "bold")]
    if state.silent_s > _SILENT_S:
        lines.append(paint(_silence(state.silent_s), "red"))
    return lines


def _silence(silent_s: float) -> str:
    return f"nothing was measured for {silent_s:.1f} s: these positions are only predicted"


def _tally(state: State) -> str:
    return "no estimate yet" if state.now is None else teammates.tally(state.now)


def _devices(state: State, width: int, paint: Paint) -> list[str]:
    lines = []
    indent = max(map(len, state.devices), default=0) + 2
    for name, health in state.devices.items():
        mark = paint("ok  ", "green") if health.ok else paint("FAIL", "red")
        reason = textwrap.wrap(one_line(health.reason), max(20, width - indent - 6)) or [""]
        lines.append(f"{name:{indent}}{mark}  {reason[0]}")
        lines += [" " * (indent + 6) + more for more in reason[1:]]
    return lines


class Console:
    """Takes news from any thread (`take`) and draws what they say (`draw`), each at its pace.

    out: where to. clock: host time, s, from which `seconds` counts. line_s: between two lines where
    it is no terminal.
    """

    def __init__(
        self,
        state: State,
        out: TextIO,
        clock: Callable[[], float] = time.monotonic,
        line_s: float = LINE_S,
    ) -> None:
        self._line_s = line_s
        self._state = state
        self._out = out
        self._clock = clock
        self._start = clock()
        self._lock = threading.Lock()
        self._terminal = out.isatty() and os.environ.get("TERM") != "dumb"
        self._paint = coloured if self._terminal and not os.environ.get("NO_COLOR") else plain
        self.gone = False  # whether nothing can be shown any more
        self._opened = False
        self._next_line = self._start + line_s
        self._shown: dict[str, tuple[bool, str]] = {}
        self._progress: list[tuple[float, float]] = []  # clock, time of the newest reading

    def take(self, message: Message) -> None:
        """Note how a device does, for the next drawing; all else is in what is known now."""
        if isinstance(message, Health):
            with self._lock:
                self._state.devices[message.device] = message

    def look(self, now: Now) -> None:
        """Note what is known now, for the next drawing."""
        with self._lock:
            self._state.now = now

    def draw(self) -> None:
        """Draw what is due now."""
        with self._lock:
            now = self._clock()
            self._state.seconds = now - self._start
            self._measure_pace(now)
            text = self._frame() if self._terminal else self._lines(now)
        self._write(text)

    def close(self) -> None:
        """Give the cursor back, below the last frame."""
        if self._opened and self._terminal:
            self._write(f"{_SHOW_CURSOR}\n")

    def _write(self, text: str) -> None:
        try:
            if text and not self.gone:
                self._out.write(text)
                self._out.flush()
        except OSError:  # a pipe that nobody reads, a terminal that was closed, a full disk
            self.gone = True

    def _measure_pace(self, now: float) -> None:
        """How much time was measured in each second of the clock, over the last five."""
        if self._state.now is None:
            return
        self._progress.append((now, self._state.now.measured))
        self._progress = [entry for entry in self._progress if entry[0] >= now - 5.0]
        (first, begin), (last, end) = self._progress[0], self._progress[-1]
        if last > first + 1.0:
            self._state.real_time_factor = (end - begin) / (last - first)

    def _frame(self) -> str:
        columns, rows = shutil.get_terminal_size()
        lines = frame(self._state, columns, self._paint)
        if len(lines) >= rows > 2:
            hidden = len(lines) - rows + 2
            lines = [*lines[: rows - 2], f"... {hidden} more lines: make the window taller"]
        begin = "" if self._opened else _CLEAR + _HIDE_CURSOR
        self._opened = True
        return begin + _HOME + "".join(f"{row}{_TO_LINE_END}\n" for row in lines) + _TO_SCREEN_END

    def _lines(self, now: float) -> str:
        lines = [] if self._opened else [f"swarmloc   {self._state.title}\n"]
        if not self._opened and self._state.page:
            lines.append(f"live page   {self._state.page}\n")
        self._opened = True
        for name, health in self._state.devices.items():
            # While all is well its words may change with every figure in them.
            state = (health.ok, "" if health.ok else health.reason)
            if self._shown.get(name) != state:
                self._shown[name] = state
                word, reason = "ok" if health.ok else "FAIL", one_line(health.reason)
                lines.append(f"{self._state.seconds:7.1f} s  {name} {word}: {reason}\n")
        if now >= self._next_line:
            self._next_line = now + self._line_s  # a standstill is not made up for
            lines.append(line(self._state) + "\n")
        return "".join(lines)
