"""The link's socket: sends this robot's odometry to all, and hears theirs."""

import socket
import threading
import time
from collections.abc import Callable

from host.config import LinkSettings
from host.drivers.health import HealthReporter
from host.drivers.link.protocol import DATAGRAM_BYTES, Receiver, Report, encode
from host.drivers.reconnect import keep_connected
from host.errors import UserError
from host.geometry import Path
from host.messages import Displacement, Message

LINK = "link"
_WAIT_S = 0.1
_RECENTLY_S = 3.0  # a robot that was heard within that time counts as heard


class Link:
    """One robot's link. `run` is meant for its own thread; `take` is a sink of the run.

    clock: host time; calendar: seconds since 1970.
    """

    def __init__(
        self,
        settings: LinkSettings,
        clock: Callable[[], float] = time.monotonic,
        calendar: Callable[[], float] = time.time,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._calendar = calendar
        self._key = settings.key.encode()
        self._began = clock()
        self._session = round(calendar() * 1e6)
        self._receiver = Receiver(
            self._key, settings.robot, self._session, settings.clock_tolerance_s
        )
        self._emit: Callable[[Message], None] = lambda message: None
        self._stop = threading.Event()
        self._health = HealthReporter(LINK, clock)
        self._last_heard: dict[int, float] = {}
        self._socket: socket.socket | None = None
        self._path = Path()
        self._total = (0.0, 0.0)  # variances
        self._sequence = 0
        self._next_sent = 0.0
        self._unsent: str | None = None

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Listen until `stop` is set, and emit what is heard, and Health."""
        self._emit, self._stop = emit, stop
        keep_connected(self._serve, self._report_failure, stop)

    def take(self, message: Message) -> None:
        """Send odometry when it is due; other messages are left alone."""
        if not isinstance(message, Displacement):
            return
        self._path.append(message)
        self._total = (
            self._total[0] + message.translation_variance,
            self._total[1] + message.heading_variance,
        )
        now = self._clock()
        if self._socket is not None and now >= self._next_sent:
            self._next_sent = now + 1.0 / self._settings.rate_hz
            self._send(self._socket, now)

    def _send(self, way: socket.socket, now: float) -> None:
        x, y, heading = (float(value) for value in self._path.last)
        report = Report(
            self._settings.robot,
            self._session,
            self._sequence,
            round((now - self._began) * 1e6),
            max(0.0, now - self._path.end),
            (x, y, heading),
            self._total,
        )
        self._sequence += 1
        try:
            way.sendto(encode(report, self._key), (self._settings.address, self._settings.port))
            self._unsent = None
        except OSError as error:  # no network yet, or none any more: it may come
            self._unsent = error.strerror or str(error)

    def _serve(self) -> None:
        """One socket: until `stop` is set or it fails. Raises UserError."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
            way.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            way.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            way.settimeout(_WAIT_S)
            try:
                way.bind(("", self._settings.port))
            except OSError as error:
                raise UserError(
                    f"cannot listen to other robots on UDP port {self._settings.port}",
                    error.strerror or str(error),
                    "end what uses it, or give all robots another port in [link] of robot.toml",
                ) from error
            self._socket = way
            try:
                while not self._stop.is_set():
                    self._receive(way)
                    ok, reason = self._judge()
                    self._health.report(self._emit, ok, reason, lambda: self._receiver.counts)
            finally:
                self._socket = None

    def _receive(self, way: socket.socket) -> None:
        try:
            datagram = way.recv(DATAGRAM_BYTES + 1)
        except TimeoutError:
            return
        now = self._clock()
        heard = self._receiver.feed(datagram, now, self._calendar())
        if heard is not None:
            self._last_heard[heard.identity] = now
            self._emit(heard)

    def _judge(self) -> tuple[bool, str]:
        """Whether it does, and in words how."""
        now, counts = self._clock(), self._receiver.counts
        present = sorted(r for r, last in self._last_heard.items() if now - last < _RECENTLY_S)
        if self._receiver.twins:
            return False, (
                f"another robot has the number {self._settings.robot}, too\n"
                "its odometry cannot be distinguished from this robot's\n"
                "give each robot its own number in [link] of robot.toml"
            )
        if self._receiver.off_clock:
            robot, off = next(iter(self._receiver.off_clock.items()))
            return False, (
                f"what robot {robot} sends is refused\n"
                f"its calendar clock is {off:.0f} s behind ours, or somebody sends a recording\n"
                "set the clocks of all robots by NTP, or raise clock_tolerance_s in [link]"
            )
        if self._unsent is not None:
            return False, f"nothing can be sent: {self._unsent}\nconnect the robot to the network"
        if counts["forged"] and not present:
            return False, (
                "what other robots send has another signature\n"
                "robots need the same key\ncopy key of [link] in robot.toml to all"
            )
        if not present:
            return True, "no other robot heard yet"
        return True, f"hears robot {', '.join(map(str, present))}"

    def _report_failure(self, error: UserError) -> None:
        self._health.report(self._emit, False, str(error), lambda: self._receiver.counts)
