"""A NatNet frame of motion capture: bytes ↔ values, versions 2.7 to 4.x, little-endian.

    number (4) | marker sets | other markers | rigid bodies | skeletons | assets (4.1)
    | labelled markers | force plates (2.9) | devices (2.11) | latency (4; only before 3.0)
    | timecode (4 + 4) | timestamp (8)
    | stamps of mid-exposure, reception and transmission (3 x 8; 3.0) | precise time (4 + 4; 4.1)
    | flags (2) | end (4)

A section is a count and that many items; from 4.1 its size in bytes stands between the two, so
that a section nobody needs is skipped in one step. Only rigid bodies and the end are read, the
rest is walked over. A frame has no checksum: it is taken only if it is used up exactly.
Source: the packet layout of OptiTrack's NatNet SDK 2.7 to 4.1, and recorded frames. Its Python
sample reads the precise time from 4.0 and its C++ sample from 4.1; 4.0 is read either way here, by
what is left of it. The Python sample leaves out the latency; Motive 1.7.2 and 1.9 send it, with
the timestamp's value in it.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from host.messages import BoolArray, FloatArray, IntArray

Version = tuple[int, int]
OLDEST: Version = (2, 7)

_BODY = struct.Struct("<i3f4ffh")  # number, position, quaternion, error, flags
_POSE_BYTES = 32  # of a body up to its quaternion; before 3.0 its markers follow
_MARKER_BYTES = 12 + 4 + 4  # position, number and size of a marker in a body
_MAX_NAME = 256
_TRACKED = 1
_RECORDING, _MODELS_CHANGED = 1, 2
_LATEST_S = 1e9  # a timestamp beyond is damaged
_NORM_TOLERANCE = 0.02  # of a quaternion; it is rounded, but not by this much


class TornError(Exception):
    """The bytes are no whole frame."""


@dataclass(frozen=True, slots=True)
class MocapFrame:
    """One frame as streamed, in Motive's own axes.

    identities (n,), positions (n, 3) m, quaternions (n, 4) x, y, z, w, errors (n,) m: mean marker
    error, tracked (n,): whether the body is seen; the pose of one that is not says nothing.
    timestamp: s since capture began. exposed (middle of the exposure), received, transmitted: the
    server's high resolution clock in ticks, 0 where unknown. timecode, precise_time: two words
    each, as they stand (0 where there are none).
    """

    number: int
    identities: IntArray
    positions: FloatArray
    quaternions: FloatArray
    errors: FloatArray
    tracked: BoolArray
    timestamp: float = 0.0
    exposed: int = 0
    received: int = 0
    transmitted: int = 0
    timecode: tuple[int, int] = (0, 0)
    precise_time: tuple[int, int] = (0, 0)
    recording: bool = False
    models_changed: bool = False


class _Cursor:
    """Walks over bytes; whatever goes beyond their end raises TornError or struct.error."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def take(self, size: int) -> bytes:
        self.skip(size)
        return self._data[self._at - size : self._at]

    def skip(self, size: int) -> None:
        if not 0 <= size <= self.left:
            raise TornError
        self._at += size

    def unpack(self, layout: struct.Struct) -> tuple[int, ...]:
        values = layout.unpack_from(self._data, self._at)
        self._at += layout.size
        return values

    def count(self, item_bytes: int = 4) -> int:
        """A count of items, each at least `item_bytes` long."""
        (count,) = self.unpack(_INT)
        if not 0 <= count * item_bytes <= self.left:
            raise TornError
        return count

    def skip_items(self, item_bytes: int) -> None:
        self.skip(self.count(item_bytes) * item_bytes)

    def skip_name(self) -> None:
        end = self._data.find(b"\0", self._at, self._at + _MAX_NAME)
        if end < 0:
            raise TornError
        self._at = end + 1


_INT = struct.Struct("<i")
_LATENCY = struct.Struct("<f")
_TIMECODE = struct.Struct("<II")
_TIMESTAMP = struct.Struct("<d")
_STAMPS = struct.Struct("<QQQ")
_PRECISE = struct.Struct("<II")
_END = struct.Struct("<hi")


def decode_frame(payload: bytes, version: Version) -> MocapFrame:
    """The frame in `payload` (without the packet's header). Raises TornError, and nothing else."""
    cursor = _Cursor(payload)
    try:
        return _decode(cursor, version)
    except struct.error as error:
        raise TornError from error


def _decode(cursor: _Cursor, version: Version) -> MocapFrame:
    (number,) = cursor.unpack(_INT)
    _skip(cursor, version, _skip_marker_set)
    _skip(cursor, version, 12)  # other markers
    bodies = _read_bodies(cursor, version)
    _skip(cursor, version, _skip_skeleton)
    if version >= (4, 1):
        _skip(cursor, version, 1)  # assets
    _skip(cursor, version, 26 if version >= (3, 0) else 22)  # labelled markers
    if version >= (2, 9):
        _skip(cursor, version, _skip_channels)  # force plates
    if version >= (2, 11):
        _skip(cursor, version, _skip_channels)  # devices
    return _read_end(cursor, version, number, bodies)


def _skip(
    cursor: _Cursor, version: Version, item: int | Callable[[_Cursor, Version], None]
) -> None:
    """Go over a section. item: bytes of each, or how to go over one that has no fixed size."""
    if version >= (4, 1):
        count, size = cursor.count(), cursor.count(1)
        if 4 * count > size:
            raise TornError
        cursor.skip(size)
    elif isinstance(item, int):
        cursor.skip_items(item)
    else:
        for _ in range(cursor.count()):
            item(cursor, version)


def _skip_marker_set(cursor: _Cursor, _: Version) -> None:
    cursor.skip_name()
    cursor.skip_items(12)


def _skip_skeleton(cursor: _Cursor, version: Version) -> None:
    cursor.skip(4)
    for _ in range(cursor.count()):
        _take_body(cursor, version)


def _skip_channels(cursor: _Cursor, _: Version) -> None:
    """A force plate or a device: its number, and the samples of each of its channels."""
    cursor.skip(4)
    for _channel in range(cursor.count()):
        cursor.skip_items(4)


def _take_body(cursor: _Cursor, version: Version) -> bytes:
    """One rigid body as from 3.0 on; the markers that stand in older ones are left out."""
    if version >= (3, 0):
        return cursor.take(_BODY.size)
    pose = cursor.take(_POSE_BYTES)
    cursor.skip_items(_MARKER_BYTES)
    return pose + cursor.take(_BODY.size - _POSE_BYTES)


def _read_bodies(cursor: _Cursor, version: Version) -> list[tuple[Any, ...]]:
    """The fields of `_BODY` of each rigid body."""
    count = cursor.count(_BODY.size)
    if version >= (4, 1) and cursor.count(1) != count * _BODY.size:
        raise TornError
    data = b"".join(_take_body(cursor, version) for _ in range(count))
    bodies = list(_BODY.iter_unpack(data))
    for _, x, y, z, qx, qy, qz, qw, _, flags in bodies:
        norm = qx * qx + qy * qy + qz * qz + qw * qw
        sound = abs(norm - 1.0) < _NORM_TOLERANCE and math.isfinite(x + y + z)
        if flags & _TRACKED and not sound:
            raise TornError
    return bodies


def _read_end(
    cursor: _Cursor, version: Version, number: int, bodies: list[tuple[Any, ...]]
) -> MocapFrame:
    if version < (3, 0):
        cursor.skip(_LATENCY.size)
    timecode, subframe = cursor.unpack(_TIMECODE)
    (timestamp,) = cursor.unpack(_TIMESTAMP)
    stamps = cursor.unpack(_STAMPS) if version >= (3, 0) else (0, 0, 0)
    seconds = fraction = 0
    if version >= (4, 1) or (version == (4, 0) and cursor.left > _END.size):
        seconds, fraction = cursor.unpack(_PRECISE)
    flags, end = cursor.unpack(_END)
    if end != 0 or cursor.left or not abs(timestamp) < _LATEST_S:
        raise TornError
    numbers = np.array([body[1:9] for body in bodies], dtype=float).reshape(-1, 8)
    return MocapFrame(
        number=number,
        identities=np.array([body[0] for body in bodies], dtype=np.int64),
        positions=numbers[:, :3],
        quaternions=numbers[:, 3:7],
        errors=numbers[:, 7],
        tracked=np.array([body[9] & _TRACKED for body in bodies], dtype=bool),
        timestamp=timestamp,
        exposed=stamps[0],
        received=stamps[1],
        transmitted=stamps[2],
        timecode=(timecode, subframe),
        precise_time=(seconds, fraction),
        recording=bool(flags & _RECORDING),
        models_changed=bool(flags & _MODELS_CHANGED),
    )


def encode_frame(frame: MocapFrame, version: Version) -> bytes:
    """The payload that a server of `version` sends for `frame`: its bodies, and nothing else."""
    bodies = [
        _BODY.pack(identity, *position, *quaternion, error, _TRACKED if tracked else 0)
        for identity, position, quaternion, error, tracked in zip(
            frame.identities.tolist(),
            frame.positions.tolist(),
            frame.quaternions.tolist(),
            frame.errors.tolist(),
            frame.tracked.tolist(),
            strict=True,
        )
    ]
    if version < (3, 0):
        bodies = [body[:_POSE_BYTES] + _INT.pack(0) + body[_POSE_BYTES:] for body in bodies]
    data = b"".join(bodies)
    size = _INT.pack(len(data)) if version >= (4, 1) else b""
    empty = bytes(8 if version >= (4, 1) else 4)
    # Skeletons and labelled markers, and what came with later versions, are all empty.
    after = 2 + (version >= (4, 1)) + (version >= (2, 9)) + (version >= (2, 11))
    parts = [
        _INT.pack(frame.number) + 2 * empty,
        _INT.pack(len(bodies)) + size + data + after * empty,
        _LATENCY.pack(frame.timestamp) if version < (3, 0) else b"",
        _TIMECODE.pack(*frame.timecode) + _TIMESTAMP.pack(frame.timestamp),
    ]
    if version >= (3, 0):
        parts.append(_STAMPS.pack(frame.exposed, frame.received, frame.transmitted))
    if version >= (4, 1):
        parts.append(_PRECISE.pack(*frame.precise_time))
    flags = frame.recording * _RECORDING | frame.models_changed * _MODELS_CHANGED
    return b"".join([*parts, _END.pack(flags, 0)])
