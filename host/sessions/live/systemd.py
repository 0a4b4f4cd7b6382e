"""A run as a service of systemd: ready when every device is healthy; feeds the watchdog.

systemd's protocol is a datagram of lines to the socket that it names (sd_notify(3)).
"""

import contextlib
import os
import socket
from collections.abc import Iterable, Mapping

from host.errors import one_line
from host.messages import Health, Message
from host.pipeline import LOCALIZER

SOCKET_VARIABLE = "NOTIFY_SOCKET"


class Service:
    """Takes the messages of a run. devices: that have to be healthy before it is ready.

    The watchdog is fed with the localizer's own report, in its thread: what hangs there, or dies,
    is noticed by systemd, which starts the service again.
    """

    def __init__(self, address: str, devices: Iterable[str]) -> None:
        # "@" stands for the zero byte of an abstract address.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)
        self._health: dict[str, Health | None] = dict.fromkeys((*devices, LOCALIZER))
        self._ready = False

    def take(self, message: Message) -> None:
        """Note a device's state; at the localizer's report, notify systemd."""
        if not isinstance(message, Health):
            return
        self._health[message.device] = message
        if message.device != LOCALIZER:
            return
        down = [name for name, health in self._health.items() if health is None or not health.ok]
        lines = ["WATCHDOG=1", f"STATUS={self._status(down)}"]
        if not down and not self._ready:
            self._ready = True
            lines.append("READY=1")
        self._send(lines)

    def close(self) -> None:
        """The run ends."""
        self._send(["STOPPING=1"])
        self._socket.close()

    def _status(self, down: list[str]) -> str:
        if not down:
            localizer = self._health[LOCALIZER]
            return f"healthy: {'' if localizer is None else one_line(localizer.reason)}"
        states = (self._health[name] for name in down)
        words = ["starting" if state is None else one_line(state.reason) for state in states]
        return "; ".join(f"{name}: {word}" for name, word in zip(down, words, strict=True))

    def _send(self, lines: list[str]) -> None:
        # A service manager that does not listen is no reason to end a run.
        with contextlib.suppress(OSError):
            self._socket.sendto("\n".join(lines).encode(), self._address)


def of_environment(
    devices: Iterable[str], environment: Mapping[str, str] = os.environ
) -> Service | None:
    """The service that systemd started this run as, None where it did not."""
    address = environment.get(SOCKET_VARIABLE, "")
    return Service(address, devices) if address.startswith(("/", "@")) else None
