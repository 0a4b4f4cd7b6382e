"""One connection to a motion capture server: its clock, and what was seen in the last second."""

from collections import deque
from collections.abc import Callable

from host.config import NatNet
from host.drivers.clock import ClockSync
from host.drivers.natnet.echo_clock import EchoClock
from host.drivers.natnet.frames import MocapFrame
from host.drivers.natnet.network import Link
from host.drivers.natnet.protocol import Echo, ServerInfo, connect, echo_request, keep_alive

_ASK_PERIOD_S = 0.25
_FIRST_QUESTIONS = 8  # at once, so that the first frame finds a clock
_ECHO_PATIENCE_S = 2.0  # then frames are stamped by their arrival


class MocapSession:
    """What is known while connected.

    last_number: of the latest frame. stranger: address from which others sent packets. bodies,
    tracked: numbers streamed, and of those seen, since they were last cleared.
    """

    def __init__(self, clock: Callable[[], float], config: NatNet, info: ServerInfo) -> None:
        self.info = info
        self.last_number: int | None = None
        self.stranger = ""
        self.bodies: set[int] = set()
        self.tracked: set[int] = set()
        self._clock = clock
        self._unicast = config.connection == "unicast"
        self._began = clock()
        self._echo = EchoClock(info.clock_hz) if info.clock_hz else None
        self._arrivals = ClockSync(bits=64)
        self._asked: deque[tuple[int, float]] = deque(maxlen=2 * _FIRST_QUESTIONS)
        self._questions = 0
        self._next_ask = 0.0

    def ask(self, link: Link) -> None:
        """Ask for the server's clock, when it is time to; that also shows whether it is there."""
        if self._clock() < self._next_ask:
            return
        self._next_ask = self._clock() + _ASK_PERIOD_S
        if self._unicast:
            link.send(keep_alive())
        if self._echo is None:
            link.send(connect())
            return
        for _ in range(1 if self._questions else _FIRST_QUESTIONS):
            self._questions += 1
            self._asked.append((self._questions, self._clock()))
            link.send(echo_request(self._questions))

    def answer(self, echo: Echo) -> int:
        """Take in the server's clock; 1 where it has started to count again, else 0."""
        sent = dict(self._asked).get(echo.asked)
        if self._echo is None or sent is None:
            return 0
        before = self._echo.restarts
        self._echo.update(echo.server, sent, self._clock())
        return self._echo.restarts - before

    def time_of(self, frame: MocapFrame) -> float | None:
        """Host time (s) of the middle of the exposure; None while the clock is not known.

        Cameras that do not give their exposure are stamped with the reception of their data,
        servers that do not give their clock (before 3.0) with the arrival of the frame.
        """
        arrival = self._clock()
        stamp = frame.exposed or frame.received or frame.transmitted
        if self._echo is not None and self._echo.ready and stamp:
            return min(self._echo.host_time(stamp), arrival)
        if self._echo is None or arrival - self._began > _ECHO_PATIENCE_S:
            return self._arrivals.update(round(frame.timestamp * 1e6), arrival)
        return None

    def clock_words(self) -> str:
        """How well times are known."""
        if self._echo is not None and self._echo.ready:
            return f"clock known to {1000.0 * self._echo.uncertainty_s:.1f} ms"
        return "stamped on arrival, for the server does not give its clock"
