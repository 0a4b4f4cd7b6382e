"""What works in threads of its own while a `with` block lasts."""

import contextlib
import threading
from collections.abc import Callable, Mapping
from typing import Self


class Workers:
    """Base class: its threads run from entry to exit of its `with` block."""

    def __init__(
        self, works: Mapping[str, Callable[[], None]], opened: contextlib.ExitStack
    ) -> None:
        """works: what the threads do, by their names, until soon after `_stop` is set.

        opened: what they use; taken over, and closed once they have ended.
        """
        self._stop = threading.Event()
        self._opened = opened.pop_all()
        self._threads = [
            threading.Thread(target=work, name=name, daemon=True) for name, work in works.items()
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._opened.close()
