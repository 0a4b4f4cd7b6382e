"""Recording beside a run that must not wait for a disk."""

import threading
from collections import deque
from types import TracebackType
from typing import Self

from host.errors import UserError
from host.messages import Bearings, Message, Picture
from host.recording.log import Recorder

CAPACITY = 3000  # messages: more than 10 s of them
_PICTURES = 60  # a second of them; more would take the memory of a small computer
_CLOSE_S = 1.5  # to write what is left


class BackgroundRecorder:
    """Writes with `recorder` in a thread of its own. A failure is raised by the next `write`.

    A recording that was given up has no end, so that its readers say so.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._messages: deque[Message] = deque()
        self._news = threading.Condition()
        self._closed = False
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._write_all, name="recording", daemon=True)
        self._thread.start()

    def write(self, message: Message) -> None:
        """Have a message written; never waits. Raises UserError where the recording has ended."""
        with self._news:
            if self._failure is not None:
                raise self._failure
            waiting = len(self._messages)
            self._messages.append(message)
            if waiting >= CAPACITY:
                self._failure = _too_slow(waiting)
                self._messages.clear()
                raise self._failure
            self._news.notify()

    def picture(self, jpeg: bytes, found: Bearings) -> None:
        """Have the picture written in which bearings were found; left out where the disk lags."""
        with self._news:
            if self._failure is None and len(self._messages) < _PICTURES:
                self._messages.append(Picture(found.time, found.camera, jpeg))
                self._news.notify()

    def _write_all(self) -> None:
        try:
            while (message := self._next()) is not None:
                self._recorder.write(message)
            if self._failure is None:
                self._recorder.close()
        except Exception as error:
            # Raised again by the next `write`, in a thread that can report it.
            self._failure = error
        finally:
            self._recorder.abandon()

    def _next(self) -> Message | None:
        """The next message, waited for; None after the last, or where it was given up."""
        with self._news:
            while not self._messages and not self._closed and self._failure is None:
                self._news.wait()
            return self._messages.popleft() if self._messages else None

    def close(self) -> None:
        """Write what is left and end the recording. Raises UserError where that fails."""
        with self._news:
            self._closed = True
            known = self._failure
            self._news.notify()
        self._thread.join(_CLOSE_S)
        if self._thread.is_alive():
            self._failure = self._failure or _too_slow(len(self._messages))
        if self._failure is not None and known is None:
            raise self._failure

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def _too_slow(waiting: int) -> UserError:
    return UserError(
        "the recording was ended: its disk is too slow",
        f"{waiting} messages waited to be written",
        "record to another disk; what was written before can be replayed",
    )
