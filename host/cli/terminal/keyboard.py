"""Single keys of a terminal, as they are pressed."""

import contextlib
import os
import select
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator

from host.errors import UserError

_POLL_S = 0.05


@contextlib.contextmanager
def keys_read(press: Callable[[str, float], None], closed: Callable[[], None]) -> Iterator[None]:
    """Call `press(key, time)` for each key while it lasts, `closed()` once no more can come.

    Both in a thread of their own; time: host time, s. Raises UserError without a terminal.
    """
    if not sys.stdin.isatty():
        raise UserError(
            "there are no keys to drive by",
            "standard input is not a terminal",
            "run it in one, or let it drive by itself: swarmloc drive walk",
        )
    handle = sys.stdin.fileno()
    before = termios.tcgetattr(handle)
    stop = threading.Event()
    reader = threading.Thread(target=_read, args=(handle, press, closed, stop), daemon=True)
    tty.setcbreak(handle)
    reader.start()
    try:
        yield
    finally:
        stop.set()
        reader.join()
        with contextlib.suppress(termios.error):  # the terminal was closed
            termios.tcsetattr(handle, termios.TCSADRAIN, before)


def _read(
    handle: int,
    press: Callable[[str, float], None],
    closed: Callable[[], None],
    stop: threading.Event,
) -> None:
    while not stop.is_set():
        if not select.select([handle], [], [], _POLL_S)[0]:
            continue
        try:
            data = os.read(handle, 64)
        except OSError:
            data = b""
        if not data:
            closed()
            return
        # Of several that waited the last one counts.
        press(chr(data[-1]), time.monotonic())
