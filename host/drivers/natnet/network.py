"""The sockets between a robot and a motion capture server, and what can be known of their way."""

import errno
import fcntl
import ipaddress
import select
import socket
import struct
from dataclasses import dataclass

from host.config import NatNet
from host.drivers.natnet.protocol import MAX_DATAGRAM
from host.errors import UserError

_SIOCGIFADDR, _SIOCGIFNETMASK = 0x8915, 0x891B  # ioctls of Linux: an interface's address and mask
_MOST_AT_ONCE = 64


@dataclass(frozen=True, slots=True)
class Interface:
    """One network interface of this computer: its name, its address and its subnet."""

    name: str
    address: str
    subnet: ipaddress.IPv4Network

    def __str__(self) -> str:
        return f"{self.name} ({self.address}/{self.subnet.prefixlen})"


def interfaces() -> list[Interface]:
    """The interfaces that are up, each with its first IPv4 address, as far as the system says."""
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            request = struct.pack("256s", name.encode()[:15])
            try:
                address, mask = (
                    socket.inet_ntoa(fcntl.ioctl(probe.fileno(), number, request)[20:24])
                    for number in (_SIOCGIFADDR, _SIOCGIFNETMASK)
                )
            except OSError:
                continue  # it has no address
            subnet = ipaddress.IPv4Network(f"{address}/{mask}", strict=False)
            found.append(Interface(name, address, subnet))
    return found


class Link:
    """The sockets of one connection: questions and answers, and frames.

    Raises UserError where the server's name or the way to it is unknown, OSError as sockets do.
    """

    def __init__(self, config: NatNet) -> None:
        self.server = _resolve(config.server)
        self.local = _local_address(self.server, config.command_port)
        self._peer = (self.server, config.command_port)
        self._command = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets = [self._command]
        self._command.bind((self.local, 0))

    def close(self) -> None:
        for each in self._sockets:
            each.close()

    def send(self, packet: bytes) -> None:
        """Send a packet to the server's command port; one that a full buffer takes is lost."""
        try:
            self._command.sendto(packet, self._peer)
        except BlockingIOError:
            return

    def join(self, group: str, port: int) -> None:
        """Listen to a multicast group, by the interface that routes to the server."""
        data = self._open_data()
        data.bind((group, port))  # not "": only what is sent to this group
        membership = socket.inet_aton(group) + socket.inet_aton(self.local)
        data.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)

    def listen(self, port: int) -> None:
        """Listen to the data port, too, where old servers send unicast frames; if it is free."""
        try:
            self._open_data().bind((self.local, port))
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise

    def _open_data(self) -> socket.socket:
        data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sockets.append(data)
        data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        return data

    def receive(self, wait_s: float) -> list[tuple[bytes, str]]:
        """Datagrams and the addresses they came from; waits up to `wait_s` for the first."""
        ready, _, _ = select.select(self._sockets, [], [], wait_s)
        packets: list[tuple[bytes, str]] = []
        for each in ready:
            for _ in range(_MOST_AT_ONCE):
                try:
                    packet, (address, _port) = each.recvfrom(MAX_DATAGRAM, socket.MSG_DONTWAIT)
                except BlockingIOError:
                    break
                packets.append((packet, address))
        return packets

    def way(self) -> tuple[str, str]:
        """The interface used, as text, and what speaks against it ("" where nothing does)."""
        known = interfaces()
        used = [each for each in known if each.address == self.local]
        if not used:
            return self.local, ""
        server = ipaddress.IPv4Address(self.server)
        if server not in used[0].subnet:
            return str(used[0]), f"{self.server} is not in its subnet, and routers stop multicast"
        rivals = [str(each) for each in known if server in each.subnet and each != used[0]]
        if rivals:
            return str(used[0]), f"{' and '.join(rivals)} is in the same subnet: switch one off"
        return str(used[0]), ""


def explain_network(error: OSError, server: str) -> UserError:
    """What a socket's failure means to the user."""
    if error.errno in (errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN, errno.ENODEV):
        why = "this computer has no network that leads there"
    elif error.errno == errno.EADDRINUSE:
        why = "another program on this computer keeps the data port to itself"
    else:
        why = error.strerror or str(error)
    return UserError(
        f"no connection to the motion capture server {server}",
        why,
        "check the network, and server in [mocap.natnet]; it is tried again by itself",
    )


def _resolve(server: str) -> str:
    try:
        return socket.gethostbyname(server)
    except (OSError, UnicodeError) as error:
        raise UserError(
            f"no computer is known by the name {server}",
            getattr(error, "strerror", None) or str(error),
            "give the address that Motive's streaming pane shows as server in [mocap.natnet]",
        ) from error


def _local_address(server: str, port: int) -> str:
    """Address of the interface that routes to the server; nothing is sent for it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((server, port))
        address: str = probe.getsockname()[0]
        return address
