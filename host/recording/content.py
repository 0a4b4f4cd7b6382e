"""Messages ↔ bytes, bit for bit: the content of the records of a recording.

A message is the number of its kind and its fields in order, each a tag and a value. Which kinds and
fields there are stands in the recording's header (`LAYOUT`), so that fields may be added later.
Arrays are kept in the smallest form that gives back every bit, and as they are where none does.
Estimates, which a replay makes again, are rounded and carry a digest of every bit. What
a device sent is joined.
"""

import hashlib
import itertools
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from host.messages import (
    Bearings,
    Bodies,
    DeviceBytes,
    DeviceIdentity,
    Displacement,
    Estimate,
    Health,
    Message,
    Names,
    Positions,
    Scan,
    TeammateOdometry,
    Truth,
)
from host.recording.arrays import STEPS, pack, packed_length, rounded, unpack


@dataclass(frozen=True, slots=True)
class RecordedEstimate(Estimate):
    """An estimate whose arrays are rounded. digest: of what they were."""

    digest: bytes = b""


def digest(made: Estimate | Names) -> bytes:
    """Eight bytes that are others where a bit of what was made is another."""
    if isinstance(made, RecordedEstimate):
        return made.digest
    hashed = hashlib.blake2b(digest_size=8)
    for field in fields(made):
        value = np.asarray(getattr(made, field.name))
        hashed.update(repr(value.shape).encode() + value.tobytes())
    return hashed.digest()


_KINDS: dict[str, type[Message]] = {
    "estimate": RecordedEstimate,
    **{
        kind.__name__.lower(): kind
        for kind in (
            *(Scan, Positions, Bearings, Displacement, Truth, Bodies, Health),
            *(DeviceIdentity, TeammateOdometry, Names),
        )
    },
}
_BYTES_SENT = "devicebytes"
LAYOUT = {
    **{name: [field.name for field in fields(kind)] for name, kind in _KINDS.items()},
    _BYTES_SENT: ["device", "times", "sizes", "data"],
}
_NUMBERS = {name: number for number, name in enumerate(LAYOUT)}
Layout = Mapping[str, Sequence[str]]
_PLACE_BITS, _OTHER_BITS = 16, 12  # significant ones of an estimate's floats

_NONE, _FALSE, _TRUE, _FLOAT, _INT, _TEXT, _BYTES, _TUPLE, _DICT, _ARRAY = range(10)


def encode(message: Message) -> bytes:
    """The bytes of a message. Raises struct.error where a number has no place in 64 bits."""
    if isinstance(message, Estimate):
        values = {field.name: _rounded(field.name, message) for field in fields(Estimate)}
        message = RecordedEstimate(**values, digest=digest(message))
        name = "estimate"
    else:
        name = type(message).__name__.lower()
    content = bytearray([_NUMBERS[name]])
    for field in LAYOUT[name]:
        _put(content, getattr(message, field), STEPS.get(field))
    return bytes(content)


def _rounded(name: str, estimate: Estimate) -> Any:
    """A field of an estimate; places to some 0.1 mm, what else is a float to 0.02 %."""
    value = getattr(estimate, name)
    if not isinstance(value, np.ndarray) or value.dtype.kind != "f":
        return value
    return rounded(value, _PLACE_BITS if name in ("positions", "obstacles") else _OTHER_BITS)


def encode_sent(parts: Sequence[DeviceBytes]) -> bytes:
    """The bytes of what one device sent, read by read."""
    content = bytearray([_NUMBERS[_BYTES_SENT]])
    _put(content, parts[0].device)
    _put(content, np.array([part.time for part in parts]))
    _put(content, np.array([len(part.data) for part in parts]))
    _put(content, b"".join(part.data for part in parts))
    return bytes(content)


def _sent(device: str, times: Any, sizes: Any, data: bytes) -> Iterator[DeviceBytes]:
    ends = np.cumsum(sizes).tolist()
    if len(times) != len(sizes) or (ends or [0])[-1] != len(data):
        raise ValueError("times, sizes and bytes do not belong together")
    bounds = itertools.pairwise([0, *ends])
    for time, (begin, end) in zip(times.tolist(), bounds, strict=True):
        yield DeviceBytes(time, device, data[begin:end])


def decode(data: bytes, layout: Layout = LAYOUT) -> list[Message]:
    """The messages that stand behind each other. layout: of the recording.

    Raises ValueError for what is none.
    """
    reader = _Reader(data)
    messages: list[Message] = []
    names = list(layout)
    try:
        while reader.left:
            name = names[reader.byte()]
            values = {field: reader.value() for field in layout[name]}
            if name == _BYTES_SENT:
                messages += _sent(**values)
            else:
                messages.append(_KINDS[name](**values))
    except (IndexError, KeyError, TypeError, OverflowError, struct.error) as error:
        raise ValueError(f"no message: {error}") from error
    return messages


def _put(content: bytearray, value: Any, step: float | None = None) -> None:
    """Append a value with its tag."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool):
        content.append({None: _NONE, False: _FALSE, True: _TRUE}[value])
    elif isinstance(value, float):
        content += struct.pack("<Bd", _FLOAT, value)
    elif isinstance(value, int):
        content += struct.pack("<Bq", _INT, value)
    elif isinstance(value, str | bytes):
        data = value.encode("utf-8", "surrogatepass") if isinstance(value, str) else value
        content += struct.pack("<BI", _TEXT if isinstance(value, str) else _BYTES, len(data)) + data
    elif isinstance(value, tuple):
        content += bytes((_TUPLE, len(value)))
        for item in value:
            _put(content, item)
    elif isinstance(value, dict):
        content += struct.pack("<BH", _DICT, len(value))
        for key, item in value.items():
            _put(content, key)
            _put(content, item)
    else:
        _put_array(content, np.asarray(value), step)


def _put_array(content: bytearray, array: NDArray[Any], step: float | None) -> None:
    form, data = pack(array, step)
    content += struct.pack(f"<BBB{array.ndim}I", _ARRAY, form, array.ndim, *array.shape) + data


class _Reader:
    """Takes values off the front of `data`. Raises ValueError, struct.error or IndexError."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return len(self._data) - self._place

    def byte(self) -> int:
        """The next byte."""
        return int(self._unpack("<B")[0])

    def value(self) -> Any:
        """The next value."""
        tag = self.byte()
        if tag in (_NONE, _FALSE, _TRUE):
            return {_NONE: None, _FALSE: False, _TRUE: True}[tag]
        if tag in (_FLOAT, _INT):
            return self._unpack("<d" if tag == _FLOAT else "<q")[0]
        if tag in (_TEXT, _BYTES):
            data = self._take(*self._unpack("<I"))
            return data.decode("utf-8", "surrogatepass") if tag == _TEXT else data
        if tag == _TUPLE:
            return tuple(self.value() for _ in range(self.byte()))
        if tag == _DICT:
            return {self.value(): self.value() for _ in range(*self._unpack("<H"))}
        if tag == _ARRAY:
            return self._array()
        raise ValueError(f"no value has tag {tag}")

    def _array(self) -> NDArray[Any]:
        form, dimensions = self._unpack("<BB")
        shape = self._unpack(f"<{dimensions}I")
        size = math.prod(shape)
        flat = unpack(form, self._take(packed_length(form, size)), size)
        return flat.reshape(shape).astype(np.float64 if flat.dtype.kind == "f" else np.int64)

    def _take(self, length: int) -> bytes:
        if length > self.left:
            raise ValueError("it ends too early")
        self._place += length
        return self._data[self._place - length : self._place]

    def _unpack(self, layout: str) -> tuple[Any, ...]:
        return struct.unpack(layout, self._take(struct.calcsize(layout)))
