"""An event loop in its own thread, for as long as a `with` block lasts."""

import asyncio
import threading
from abc import ABC, abstractmethod
from typing import Self


class LoopThread(ABC):
    """Serves from entry to exit of its `with` block."""

    def __init__(self, name: str) -> None:
        """name: of the thread."""
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()  # not before: one that never runs has to be closed
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()
        self._loop.close()

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())

    @abstractmethod
    async def _serve(self) -> None:
        """Serve until `_stop` is set."""
