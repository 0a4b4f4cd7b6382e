"""Ctrl-C and its kin end a command in good order, and a second one at once."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def signals_caught() -> Iterator[Callable[[], bool]]:
    """Gives a function: did a signal to end come? A second one ends the program at once."""
    came = False

    def handle(number: int, stack: FrameType | None) -> None:
        # It interrupts this very thread wherever it is, perhaps inside a lock: take none here.
        nonlocal came
        came = True
        for each in _SIGNALS:
            signal.signal(each, signal.SIG_DFL)

    with _handled_by(handle):
        yield lambda: came


@contextlib.contextmanager
def signals_interrupt() -> Iterator[None]:
    """Each of them raises KeyboardInterrupt, as Ctrl-C does; a second one ends at once."""

    def handle(number: int, stack: FrameType | None) -> None:
        for each in _SIGNALS:
            signal.signal(each, signal.SIG_DFL)
        raise KeyboardInterrupt

    with _handled_by(handle):
        yield


def signals_end() -> contextlib.AbstractContextManager[None]:
    """Each of them ends the program at once and without a word, as while it is being loaded."""
    return _handled_by(signal.SIG_DFL)


@contextlib.contextmanager
def _handled_by(
    handle: Callable[[int, FrameType | None], None] | signal.Handlers,
) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread alone
        return
    numbers = set(_SIGNALS)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        numbers.remove(signal.SIGHUP)  # as under nohup: what runs goes on without its terminal
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            none_came = signal.getsignal(number) is not signal.SIG_DFL
            if none_came or handle is signal.SIG_DFL:
                signal.signal(number, handler)
