"""A motion capture server that answers and streams as Motive does, for simulated bodies."""

import contextlib
import math
import socket
import threading
import time
from collections.abc import Callable
from typing import Literal

import numpy as np

from host.config import NatNet
from host.drivers.natnet.frames import TornError, Version
from host.drivers.natnet.protocol import (
    CONNECT,
    ECHO_REQUEST,
    KEEP_ALIVE,
    MAX_DATAGRAM,
    ServerInfo,
    Up,
    echo_response,
    frame_of,
    frame_packet,
    server_info,
    split,
)
from host.messages import Bodies, FloatArray, IntArray
from host.simulation.devices.workers import Workers

Poses = Callable[[float], tuple[IntArray, FloatArray]]

CLOCK_HZ = 3_312_787  # as that of a recorded server
CLOCK_AHEAD_S = 427_584.25  # its clock counts from another moment than the host's
# From the exposure to the reception of the cameras' data, and from there to the transmission.
CAMERA_S, SOLVING_S = 0.0046, 0.0009
_FORGET_CLIENT_S = 10.0
_WAIT_S = 0.05


class NatNetServer(Workers):
    """Streams while its `with` block lasts. config: what a client needs to reach it.

    poses: host time (s) → identities (n,) and planar poses (n, 3) of bodies in the floor's frame,
    nan for one that is not tracked; called at the times of exposure, from a thread of this server.
    clock: host time in s. version: of NatNet. Ports of 0 are chosen free ones. streaming may be
    switched off, as Broadcast Frame Data is in Motive; the server goes on answering.
    """

    def __init__(
        self,
        poses: Poses,
        rate_hz: float = 120.0,
        clock: Callable[[], float] = time.monotonic,
        *,
        version: Version = (4, 1),
        connection: Literal["multicast", "unicast"] = "unicast",
        address: str = "127.0.0.1",
        command_port: int = 0,
        data_port: int = 0,
        group: str = "239.255.42.99",
        up: Up = "y",
    ) -> None:
        self.streaming = True
        self._poses = poses
        self._rate_hz = rate_hz
        self._clock = clock
        self._version = version
        self._clients: dict[tuple[str, int], float] = {}  # and when they were last heard
        self._lock = threading.Lock()
        with contextlib.ExitStack() as opened:
            self._command = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self._data = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self._command.bind((address, command_port))
            self._command.settimeout(_WAIT_S)
            self._data.bind((address, 0))
            interface = socket.inet_aton(address)
            self._data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
            super().__init__(
                {"natnet answers": self._answer, "natnet frames": self._stream}, opened
            )
        self.config = NatNet(
            server=address,
            connection=connection,
            multicast_group=group,
            command_port=self._command.getsockname()[1],
            # A free port here is most likely one for the group, too.
            data_port=data_port or self._data.getsockname()[1],
            up=up,
        )

    def ticks(self, host_time: float) -> int:
        """This server's clock at a host time (s)."""
        return round((host_time + CLOCK_AHEAD_S) * CLOCK_HZ)

    def _answer(self) -> None:
        """Answer questions until the end."""
        while not self._stop.is_set():
            try:
                packet, client = self._command.recvfrom(MAX_DATAGRAM)
            except TimeoutError:
                continue
            try:
                message, payload = split(packet)
                answer = self._answer_to(message, payload, client)
            except TornError:
                continue
            if answer:
                self._command.sendto(answer, client)

    def _answer_to(self, message: int, payload: bytes, client: tuple[str, int]) -> bytes:
        """The answer to one question; empty where none is due. Raises TornError."""
        if message == ECHO_REQUEST:
            return echo_response(payload, self.ticks(self._clock()))
        with self._lock:
            if message == CONNECT or (message == KEEP_ALIVE and client in self._clients):
                self._clients[client] = self._clock()
        return self._info() if message == CONNECT else b""

    def _info(self) -> bytes:
        multicast = self.config.connection == "multicast"
        group = self.config.multicast_group if multicast else "0.0.0.0"
        info = ServerInfo(
            "Motive",
            (3, 1, 0, 0),
            self._version,
            CLOCK_HZ,
            multicast,
            self.config.data_port,
            group,
        )
        return server_info(info)

    def _stream(self) -> None:
        """Send frames at their times until the end; those that would be late are left out."""
        start, number = self._clock(), 0
        while not self._stop.is_set():
            exposed = start + number / self._rate_hz
            due = exposed + CAMERA_S + SOLVING_S
            if self._stop.wait(max(0.0, due - self._clock())):
                return
            if self.streaming:
                packet = self._frame(number, exposed, exposed - start)
                for receiver in self._receivers():
                    self._data.sendto(packet, receiver)
            late = (self._clock() - start - CAMERA_S - SOLVING_S) * self._rate_hz
            number = max(number + 1, math.ceil(late))

    def _frame(self, number: int, exposed: float, timestamp: float) -> bytes:
        identities, poses = self._poses(exposed)
        bodies = Bodies(timestamp, np.asarray(identities), np.asarray(poses))
        frame = frame_of(
            bodies,
            self.config.up,
            number,
            exposed=self.ticks(exposed),
            received=self.ticks(exposed + CAMERA_S),
            transmitted=self.ticks(self._clock()),
        )
        return frame_packet(frame, self._version)

    def _receivers(self) -> list[tuple[str, int]]:
        if self.config.connection == "multicast":
            return [(self.config.multicast_group, self.config.data_port)]
        with self._lock:
            silent = self._clock() - _FORGET_CLIENT_S
            self._clients = {who: heard for who, heard in self._clients.items() if heard > silent}
            return list(self._clients)
