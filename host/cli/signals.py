"""Ctrl-C and its kin end a run in good order."""

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def signals_caught() -> Iterator[Callable[[], bool]]:
    """Gives a function: did a signal to end come? A second one ends the program at once."""
    came = False
    before = {number: signal.getsignal(number) for number in _SIGNALS}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    def handle(number: int, stack: FrameType | None) -> None:
        # It interrupts this very thread wherever it is, perhaps inside a lock: take none here.
        nonlocal came
        restore()
        came = True

    for number in _SIGNALS:
        signal.signal(number, handle)
    try:
        yield lambda: came
    finally:
        restore()
