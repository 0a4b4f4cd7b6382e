"""What a person sees: runs a command on a pseudo-terminal and plays what it writes on a grid."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
import time
from collections.abc import Callable, Iterator

import pytest

ROWS, COLUMNS = 30, 80
LONG_S = 40.0  # a bound on waiting, not on speed
_CODE = re.compile(r"\x1b\[(\??\d*(?:;\d+)*)([A-Za-z])")


def shown_on_screen(written: str, rows: int = ROWS, columns: int = COLUMNS) -> list[str]:
    """The lines on the screen after all that was written, without styles."""
    grid = [[" "] * columns for _ in range(rows)]
    row = column = 0
    place = 0
    while place < len(written):
        code = _CODE.match(written, place)
        if code:
            place = code.end()
            if code[2] == "H":
                row = column = 0
            elif code[2] == "K":
                grid[row][column:] = [" "] * (columns - column)
            elif code[2] == "J":
                grid[row][column:] = [" "] * (columns - column)
                first = 0 if code[1] == "2" else row + 1
                grid[first:] = [[" "] * columns for _ in range(rows - first)]
            continue
        letter = written[place]
        place += 1
        if letter in "\r\n" or column == columns:
            row, column = row + (letter != "\r"), 0  # a terminal returns at each new line
        if row == rows:
            grid, row = [*grid[1:], [" "] * columns], row - 1
        if letter not in "\r\n":
            grid[row][column] = letter
            column += 1
    return ["".join(line).rstrip() for line in grid]


class Screen:
    """A running `swarmloc` on a terminal of its own."""

    def __init__(self, *arguments: str, **environment: str) -> None:
        self.written = ""
        self._data = b""
        command = [sys.executable, "-c", "from host.cli.main import main; main()", *arguments]
        self._pid, self._handle = pty.fork()
        if not self._pid:
            os.execve(command[0], command, {**os.environ, **environment})
        size = struct.pack("HHHH", ROWS, COLUMNS, 0, 0)
        fcntl.ioctl(self._handle, termios.TIOCSWINSZ, size)

    @property
    def lines(self) -> list[str]:
        return shown_on_screen(self.written)

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def wait_for(self, seen: Callable[[str], object]) -> None:
        """Read on until the screen's text, words one space apart, shows what is waited for."""
        end = time.monotonic() + LONG_S
        while not seen(" ".join(self.text.split())):
            assert time.monotonic() < end, self.text
            assert self._read(), self.text

    def type(self, keys: bytes) -> None:
        os.write(self._handle, keys)

    def send(self, number: int) -> None:
        """Send it a signal."""
        os.kill(self._pid, number)

    def kill(self) -> None:
        """End it by force where it still runs."""
        if self._pid:
            os.kill(self._pid, signal.SIGKILL)
            self.end()

    def end(self) -> int:
        """Read to the end; return the exit code."""
        while self._read():
            pass
        os.close(self._handle)
        code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        self._pid = 0
        return code

    def _read(self) -> bool:
        """Whether the command still runs."""
        ready, _, _ = select.select([self._handle], [], [], 0.1)
        if not ready:
            return True
        try:
            data = os.read(self._handle, 65536)
        except OSError:  # Linux's way to say that the other side has closed
            return False
        self._data += data
        self.written = self._data.decode(errors="ignore")
        return bool(data)


@pytest.fixture
def shown() -> Callable[..., list[str]]:
    """The lines on a screen after what was written to it: `shown(text, rows=30, columns=80)`."""
    return shown_on_screen


@pytest.fixture
def on_screen() -> Iterator[Callable[..., Screen]]:
    """Starts `swarmloc` with some arguments on a terminal: `on_screen("run", ...)`."""
    screens: list[Screen] = []

    def start(*arguments: str, **environment: str) -> Screen:
        screens.append(Screen(*arguments, **environment))
        return screens[-1]

    yield start
    for screen in screens:
        screen.kill()
