"""Motion capture from Motive by NatNet: bodies in host time, and words for why there are none."""

import contextlib
import ipaddress
import threading
import time
from collections import Counter
from collections.abc import Callable

from host.config import NatNet
from host.drivers.health import HealthReporter
from host.drivers.natnet.frames import OLDEST, MocapFrame
from host.drivers.natnet.network import Link, explain_network
from host.drivers.natnet.protocol import (
    Echo,
    MocapDecoder,
    ServerInfo,
    bodies_of,
    connect,
)
from host.drivers.natnet.session import MocapSession
from host.drivers.reconnect import keep_connected
from host.errors import UserError
from host.messages import Message

MOCAP = "motion capture"  # what Health calls it, whichever way it is made
_ANSWER_WAIT_S = 0.5
_TRIES = 4
_SILENCE_S = 3.0
_HEALTH_PERIOD_S = 1.0
_WAIT_S = 0.02


class NatNetClient:
    """One connection to Motive. config: [mocap.natnet]; clock: host time in s.

    `run` is meant for its own thread.
    """

    def __init__(self, config: NatNet, clock: Callable[[], float] = time.monotonic) -> None:
        self._config = config
        self._clock = clock
        self._emit: Callable[[Message], None] = lambda message: None
        self._stop = threading.Event()
        self._decoder = MocapDecoder()
        self._counts = Counter(
            bodies=0, strangers=0, repeated=0, unstamped=0, clock_restarts=0, connections=0
        )
        self._health = HealthReporter(MOCAP, clock, _HEALTH_PERIOD_S)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Bodies per frame, Health once per second and at a change of state, until `stop`.

        Bodies are stamped with the middle of their exposure, in host time, and hold the tracked
        bodies, in the floor's frame. Failures of the network and the server are reported as Health
        and tried again; it raises only what is the program's own fault.
        """
        self._emit, self._stop = emit, stop
        keep_connected(self._serve, self._report_failure, stop)

    def _serve(self) -> None:
        """One connection: from the first question to its loss or to the end. Raises UserError."""
        self._decoder.version = None
        try:
            with contextlib.closing(Link(self._config)) as link:
                info = self._meet(link)
                if info is not None:
                    self._counts["connections"] += 1
                    self._listen(link, info)
                    self._watch(link, info)
        except OSError as error:
            raise explain_network(error, self._config.server) from error

    def _meet(self, link: Link) -> ServerInfo | None:
        """Ask the server who it is. None where `stop` was set meanwhile."""
        strangers = set()
        for _ in range(_TRIES):
            link.send(connect())
            end = self._clock() + _ANSWER_WAIT_S
            while self._clock() < end and not self._stop.is_set():
                for packet, source in link.receive(_WAIT_S):
                    if source != link.server:
                        strangers.add(source)
                        continue
                    value = self._decoder.feed(packet)
                    if isinstance(value, ServerInfo):
                        return value
        if self._stop.is_set():
            return None
        others = f"; {', '.join(sorted(strangers))} answered instead" if strangers else ""
        raise UserError(
            f"the motion capture server {self._config.server} does not answer",
            f"asked on port {self._config.command_port} by {link.way()[0]}{others}",
            "in Motive's streaming pane switch Broadcast Frame Data on and make Local Interface "
            "the address in [mocap.natnet]; let UDP through the firewall",
        )

    def _listen(self, link: Link, info: ServerInfo) -> None:
        """Open the way for the frames; the server knows better than robot.toml where to."""
        if info.version < OLDEST:
            raise UserError(
                "{} speaks NatNet {}.{}".format(_name(info), *info.version),
                "the oldest that is understood is {}.{}".format(*OLDEST),
                "update Motive",
            )
        port = info.data_port or self._config.data_port
        if self._config.connection == "unicast":
            link.listen(port)
            return
        if info.multicast is False:
            raise UserError(
                f"{_name(info)} streams by unicast, but robot.toml says multicast",
                "",
                'set connection = "unicast" in [mocap.natnet], or the transmission type in Motive',
            )
        link.join(self._group(info), port)

    def _group(self, info: ServerInfo) -> str:
        return info.group if _is_group(info.group) else self._config.multicast_group

    def _watch(self, link: Link, info: ServerInfo) -> None:
        """Take in what comes and judge it, until `stop` is set. Raises UserError."""
        session = MocapSession(self._clock, self._config, info)
        pace = self._health.pace
        pace.heard()
        checked = self._clock()
        before = self._totals()
        while not self._stop.is_set():
            with pace.within(_WAIT_S):
                session.ask(link)
                for packet, source in link.receive(_WAIT_S):
                    if source == link.server:
                        self._take(session, packet)
                        pace.heard()
                    else:
                        self._counts["strangers"] += 1
                        session.stranger = source
            if pace.silent_s > _SILENCE_S:
                raise UserError(
                    f"{_name(info)} at {link.server} stopped answering",
                    f"nothing came for {_SILENCE_S:.0f} s",
                    "is Motive still running, and the network up?",
                )
            now = self._clock()
            if now - checked >= _HEALTH_PERIOD_S:
                totals = self._totals()
                news = totals - before
                judged = self._judge(session, link, news, now - checked)
                self._report(*judged, certain=bool(news["frames"]))
                checked, before = now, totals
                session.tracked.clear()
                session.bodies.clear()

    def _take(self, session: MocapSession, packet: bytes) -> None:
        value = self._decoder.feed(packet)
        if isinstance(value, Echo):
            self._counts["clock_restarts"] += session.answer(value)
        if not isinstance(value, MocapFrame):
            return
        if value.number == session.last_number:
            self._counts["repeated"] += 1
            return
        session.last_number = value.number
        exposed = session.time_of(value)
        if exposed is None:
            self._counts["unstamped"] += 1
            return
        bodies = bodies_of(value, exposed, self._config.up)
        session.bodies.update(value.identities.tolist())
        session.tracked.update(bodies.identities.tolist())
        self._counts["bodies"] += len(bodies.identities)
        self._emit(bodies)

    def _judge(
        self, session: MocapSession, link: Link, news: "Counter[str]", seconds: float
    ) -> tuple[bool, str]:
        """Were the last `seconds` good, and why not? news: what was counted in them."""
        name = _name(session.info)
        if not news["frames"]:
            return False, str(self._no_frames(session, link, news))
        if news["unstamped"] == news["frames"]:
            return False, f"{name} streams, but has not given its clock yet"
        if news["repeated"] == news["frames"]:
            return False, (
                f"{name} sends one frame again and again\n"
                "start its playback, or switch Motive to Live mode"
            )
        if not session.bodies:
            return False, (
                f"{name} streams frames without rigid bodies\n"
                "make a rigid body of each robot's markers, and tick Rigid Bodies in the "
                "streaming pane"
            )
        lost = ", ".join(str(number) for number in sorted(session.bodies - session.tracked))
        if not session.tracked:
            return False, (
                f"no rigid body is tracked (streaming ids {lost})\n"
                "are they in view of the cameras, with their markers as they were?"
            )
        words = [f"{news['frames'] / seconds:.0f} frames/s", f"{len(session.tracked)} bodies"]
        if lost:
            words.append(f"not tracked: {lost}")
        return True, ", ".join([*words, session.clock_words()])

    def _no_frames(self, session: MocapSession, link: Link, news: "Counter[str]") -> UserError:
        """Why a server that answers sends no frames, and what was tried."""
        info = session.info
        if news["malformed"]:
            version = "{}.{}".format(*info.version)
            return UserError(f"{_name(info)} sends frames that do not read as NatNet {version}")
        what = f"connected to {_name(info)} at {link.server}, but no frames come"
        interface, doubt = link.way()
        switch = "switch Broadcast Frame Data on in Motive's streaming pane"
        if news["strangers"]:
            return UserError(
                what,
                f"packets come from {session.stranger} instead, which may be its other interface",
                f'set server = "{session.stranger}" in [mocap.natnet]',
            )
        if self._config.connection == "unicast":
            why = f"asked for unicast by {interface}"
            if info.multicast:
                return UserError(
                    what, f"{why}, but it streams by multicast", 'set connection = "multicast"'
                )
            return UserError(what, why, f"{switch}; let UDP through the firewalls")
        port = info.data_port or self._config.data_port
        why = f"joined {self._group(info)}:{port} by {interface}"
        return UserError(
            what,
            f"{why}; {doubt}" if doubt else why,
            f"{switch}, with {link.server} as Local Interface; let UDP {port} through the "
            'firewall; where Wi-Fi or a router drops multicast, set connection = "unicast" there '
            "and here",
        )

    def _totals(self) -> "Counter[str]":
        return self._counts + self._decoder.counts

    def _report_failure(self, error: UserError) -> None:
        self._report(False, str(error))

    def _report(self, ok: bool, reason: str, certain: bool = False) -> None:
        """Emit Health at a change of state and once per second. certain: frames came."""
        counts = {**self._counts, **self._decoder.counts}
        self._health.report(self._emit, ok, reason, lambda: counts, certain)


def _name(info: ServerInfo) -> str:
    major, minor = info.application_version[:2]
    return f"{info.application or 'the server'} {major}.{minor}"


def _is_group(address: str) -> bool:
    return bool(address) and ipaddress.IPv4Address(address).is_multicast
