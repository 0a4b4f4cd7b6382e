"""Messages on their way from the devices' threads to the localizer's: bounded, counted."""

import threading
import time
from collections import deque
from collections.abc import Callable

from host.messages import Displacement, Message

CAPACITY = 768  # messages: some 3 s of them, most of which are bytes to be recorded


class MessageQueue:
    """Between threads. When it is full a message is dropped and counted.

    It is the oldest one that is no displacement: one scan less is of little harm, but a missing
    displacement is a hole in the odometry. waited_s: how long the message taken last was in it, by
    `clock` (s).
    """

    def __init__(
        self, capacity: int = CAPACITY, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.dropped = 0
        self.waited_s = 0.0
        self._clock = clock
        self._messages: deque[tuple[Message, float]] = deque()  # each with when it came
        self._capacity = capacity
        self._news = threading.Condition()
        self._closed = False

    def put(self, message: Message) -> None:
        """Append a message; never waits. After `close` it does nothing."""
        with self._news:
            if self._closed:
                return
            self._messages.append((message, self._clock()))
            if len(self._messages) > self._capacity:
                self._drop()
            self._news.notify()

    def _drop(self) -> None:
        others = (k for k, (m, _) in enumerate(self._messages) if not isinstance(m, Displacement))
        del self._messages[next(others, 0)]
        self.dropped += 1

    def close(self) -> None:
        """Refuse what comes from now on; what is in it can still be taken."""
        with self._news:
            self._closed = True
            self._news.notify()

    @property
    def exhausted(self) -> bool:
        """Is it closed and empty?"""
        with self._news:
            return self._closed and not self._messages

    def take(self, timeout_s: float) -> Message | None:
        """The oldest message, None where none comes within `timeout_s`."""
        with self._news:
            if not self._messages and not self._closed:
                self._news.wait(timeout_s)
            if not self._messages:
                return None
            message, came = self._messages.popleft()
            self.waited_s = self._clock() - came
            return message
