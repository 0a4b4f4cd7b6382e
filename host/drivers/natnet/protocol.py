"""NatNet, the protocol by which OptiTrack's Motive streams: packets ↔ values.

A packet is one UDP datagram: message (2), size of what follows (2), little-endian. The client asks
on the command port: connect, echo (which gives the server's clock), keep-alive (unicast only).
Frames (`natnet_frames`) come on the data port; by unicast, to where `connect` came from.
Source: the packet layout of OptiTrack's NatNet SDK.
"""

import ipaddress
import struct
from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np

from host.drivers.natnet.frames import MocapFrame, TornError, Version, decode_frame, encode_frame
from host.messages import Bodies, BoolArray, FloatArray

Up = Literal["y", "z"]

CONNECT, SERVER_INFO, FRAME, KEEP_ALIVE, ECHO_REQUEST, ECHO_RESPONSE = 0, 1, 7, 10, 12, 13
MAX_DATAGRAM = 65507

_HEADER = struct.Struct("<HH")
_SENDER = struct.Struct("<256s4B4B")
_CONNECTION = struct.Struct("<QH?4s")
_CONNECT_OPTIONS = bytes(5)  # from 4.0: all data, in the server's own version
_ECHO_REQUEST = struct.Struct("<Q")
_ECHO_RESPONSE = struct.Struct("<QQ")
_HIGHEST_CLOCK_HZ = 10**11


@dataclass(frozen=True, slots=True)
class ServerInfo:
    """What a server says of itself. clock_hz: of its stamps; that and the rest: 0, "" before 3.0.

    multicast: how it streams; None: it does not say. data_port, group: where it streams to.
    """

    application: str
    application_version: tuple[int, int, int, int]
    version: Version
    clock_hz: int = 0
    multicast: bool | None = None
    data_port: int = 0
    group: str = ""


@dataclass(frozen=True, slots=True)
class Echo:
    """asked: what the question said. server: the server's clock (ticks) when it answered."""

    asked: int
    server: int


class MocapDecoder:
    """What a client hears: packets in, values out; garbage is counted.

    version: of the server's frames; learnt from its ServerInfo where that comes by.
    counts: frames, malformed (no whole packet), unversioned (frames before the version was
    known), others (packets that nobody needs).
    """

    def __init__(self, version: Version | None = None) -> None:
        self.version = version
        self.counts = Counter(frames=0, malformed=0, unversioned=0, others=0)

    def feed(self, packet: bytes) -> MocapFrame | ServerInfo | Echo | None:
        """The value of one datagram; None for what is damaged or not needed."""
        try:
            message, payload = split(packet)
            if message == FRAME:
                return self._frame(payload)
            if message == SERVER_INFO:
                info = _server_info(payload)
                self.version = info.version
                return info
            if message == ECHO_RESPONSE:
                return Echo(*_unpack(_ECHO_RESPONSE, payload))
        except TornError:
            self.counts["malformed"] += 1
            return None
        self.counts["others"] += 1
        return None

    def _frame(self, payload: bytes) -> MocapFrame | None:
        if self.version is None:
            self.counts["unversioned"] += 1
            return None
        frame = decode_frame(payload, self.version)
        self.counts["frames"] += 1
        return frame


def split(packet: bytes) -> tuple[int, bytes]:
    """Message and payload of a datagram. Raises TornError where its size is not as it says."""
    if len(packet) < _HEADER.size:
        raise TornError
    message, size = _HEADER.unpack_from(packet)
    if len(packet) != _HEADER.size + size:
        raise TornError
    return message, packet[_HEADER.size :]


def _join(message: int, payload: bytes = b"") -> bytes:
    return _HEADER.pack(message, len(payload)) + payload


def _unpack(layout: struct.Struct, payload: bytes) -> tuple[int, ...]:
    if len(payload) < layout.size:
        raise TornError
    return layout.unpack_from(payload)


def _server_info(payload: bytes) -> ServerInfo:
    if len(payload) < _SENDER.size:
        raise TornError
    name, *numbers = _SENDER.unpack_from(payload)
    text = name.split(b"\0")[0].decode("utf-8", "replace")
    application = "".join(letter for letter in text if letter.isprintable())
    major, minor, build, revision = numbers[:4]
    about = application, (major, minor, build, revision), (numbers[4], numbers[5])
    if len(payload) < _SENDER.size + _CONNECTION.size:
        return ServerInfo(*about)
    clock_hz, port, multicast, group = _CONNECTION.unpack_from(payload, _SENDER.size)
    if clock_hz > _HIGHEST_CLOCK_HZ:
        raise TornError
    return ServerInfo(*about, clock_hz, multicast, port, str(ipaddress.IPv4Address(group)))


def connect(application: str = "swarmloc") -> bytes:
    """The packet by which a client asks the server who it is and, for unicast, to stream."""
    sender = _SENDER.pack(application.encode()[:255], 0, 1, 0, 0, 4, 1, 0, 0)
    return _join(CONNECT, sender + _CONNECT_OPTIONS)


def keep_alive() -> bytes:
    """The packet without which a server ends its unicast stream after some seconds."""
    return _join(KEEP_ALIVE)


def echo_request(stamp: int) -> bytes:
    """The packet that asks for the server's clock; stamp: comes back in the answer."""
    return _join(ECHO_REQUEST, _ECHO_REQUEST.pack(stamp))


def echo_response(question: bytes, server: int) -> bytes:
    """A server's answer to the payload of an echo request. Raises TornError where it is none."""
    (asked,) = _unpack(_ECHO_REQUEST, question)
    return _join(ECHO_RESPONSE, _ECHO_RESPONSE.pack(asked, server))


def server_info(info: ServerInfo) -> bytes:
    """A server's answer to `connect`."""
    payload = _SENDER.pack(
        info.application.encode()[:255], *info.application_version, *info.version, 0, 0
    )
    if info.version >= (3, 0):
        group = ipaddress.IPv4Address(info.group or "0.0.0.0").packed
        payload += _CONNECTION.pack(info.clock_hz, info.data_port, bool(info.multicast), group)
    return _join(SERVER_INFO, payload)


def frame_packet(frame: MocapFrame, version: Version) -> bytes:
    """The datagram of one frame."""
    return _join(FRAME, encode_frame(frame, version))


def floor_poses(positions: FloatArray, quaternions: FloatArray, up: Up) -> FloatArray:
    """Planar poses (n, 3) in the floor's frame: x, y (m) and heading (rad) of the body's x-axis.

    positions (n, 3) m and quaternions (n, 4) x, y, z, w in Motive's frame, whose axis `up` points
    up. With y up, the floor's x and y are Motive's x and -z.
    """
    qx, qy, qz, qw = quaternions.T
    # The first column of the rotation matrix: the body's x-axis.
    ahead = 1.0 - 2.0 * (qy * qy + qz * qz)
    if up == "y":
        left, y = -2.0 * (qx * qz - qw * qy), -positions[:, 2]
    else:
        left, y = 2.0 * (qx * qy + qw * qz), positions[:, 1]
    return np.stack((positions[:, 0], y, np.arctan2(left, ahead)), axis=-1)


def bodies_of(frame: MocapFrame, time: float, up: Up) -> Bodies:
    """The tracked bodies of a frame that was exposed at `time` (host, s)."""
    seen = frame.tracked
    poses = floor_poses(frame.positions[seen], frame.quaternions[seen], up)
    return Bodies(time, frame.identities[seen], poses)


def frame_of(
    bodies: Bodies,
    up: Up,
    number: int = 0,
    *,
    exposed: int = 0,
    received: int = 0,
    transmitted: int = 0,
    height_m: float = 0.2,
) -> MocapFrame:
    """The frame that a server sends of bodies upright at `height_m`; the way back of `bodies_of`.

    exposed, received, transmitted: as in `MocapFrame`. A body at nan is one that is not tracked.
    """
    tracked: BoolArray = np.asarray(np.isfinite(bodies.poses).all(axis=1))
    x, y, heading = np.where(tracked, bodies.poses.T, 0.0)
    height, zero = np.full(len(x), height_m), np.zeros(len(x))
    sine, cosine = np.sin(heading / 2.0), np.cos(heading / 2.0)
    if up == "y":
        positions, quaternions = (x, height, -y), (zero, sine, zero, cosine)
    else:
        positions, quaternions = (x, y, height), (zero, zero, sine, cosine)
    return MocapFrame(
        number=number,
        identities=bodies.identities,
        positions=np.stack(positions, axis=-1),
        quaternions=np.stack(quaternions, axis=-1),
        errors=np.where(tracked, 0.0003, 0.0),
        tracked=tracked,
        timestamp=bodies.time,
        exposed=exposed,
        received=received,
        transmitted=transmitted,
    )
