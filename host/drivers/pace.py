"""Does this computer keep up? A step that took much longer than it should was held up."""

import contextlib
from collections import deque
from collections.abc import Callable, Iterator

from host.errors import UserError

_SLACK_S = 0.15  # by which a step may be longer on a computer that keeps up
_WINDOW_S = 3.5  # some longer than that over which devices are judged by what came
_MOST_S = 0.5  # held up in all within the window, and devices can still be judged


class Pace:
    """Of one thread. clock: host time, s.

    silent_s: for how long it has listened to its device in vain: in all steps since `heard`, but
    not while this computer stood still.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self.silent_s = 0.0
        self._clock = clock
        self._held_up: deque[tuple[float, float]] = deque()  # until when, for how long, s

    @contextlib.contextmanager
    def within(self, at_most_s: float) -> Iterator[None]:
        """A step that should be over after so long."""
        begin = self._clock()
        yield
        now = self._clock()
        self.silent_s += min(now - begin, at_most_s)
        late = now - begin - at_most_s
        if late > _SLACK_S:
            self._held_up.append((now, late))

    def heard(self) -> None:
        """The device is not silent."""
        self.silent_s = 0.0

    def fault(self) -> UserError | None:
        """The error that this computer is too slow; None if it keeps up."""
        now = self._clock()
        while self._held_up and self._held_up[0][0] < now - _WINDOW_S:
            self._held_up.popleft()
        seconds = sum(late for _, late in self._held_up)
        if seconds <= _MOST_S:
            return None
        return UserError(
            f"this computer is too slow: swarmloc was paused for {seconds:.1f} s",
            "other programs keep it busy, or it was suspended",
            "close other programs, or use fewer sensors (--sensors lidar)",
        )
