"""Messages ↔ bytes, bit for bit: the content of the records of a recording.

A message is the number of its kind and its fields in order, each a tag and a value. Which kinds and
fields there are stands in the recording's header (`LAYOUT`), so that fields may be added later.
Arrays are kept in the smallest form that gives back every bit, and as they are where none does.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
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
    Positions,
    Scan,
    Truth,
)

_KINDS: dict[str, type[Message]] = {
    kind.__name__.lower(): kind
    for kind in (
        *(Scan, Positions, Bearings, Displacement, Estimate, Truth, Bodies, Health),
        *(DeviceBytes, DeviceIdentity),
    )
}
LAYOUT = {name: [field.name for field in fields(kind)] for name, kind in _KINDS.items()}
_NUMBERS = {name: number for number, name in enumerate(LAYOUT)}
Layout = Mapping[str, Sequence[str]]

_NONE, _FALSE, _TRUE, _FLOAT, _INT, _TEXT, _BYTES, _TUPLE, _DICT, _ARRAY = range(10)
_FLOATS, _INTS, _SHORT_INTS, _MULTIPLES, _STEADY = range(5)  # forms of an array
# A lidar counts its ranges, and angles are rounded, in these steps: 16 bits instead of 64.
STEPS = {"ranges": 0.00025, "angles": math.tau / 65536}


def encode(message: Message) -> bytes:
    """The bytes of a message. Raises struct.error where a number has no place in 64 bits."""
    name = type(message).__name__.lower()
    content = bytearray([_NUMBERS[name]])
    for field in LAYOUT[name]:
        _put(content, getattr(message, field), STEPS.get(field))
    return bytes(content)


def decode(data: bytes, layout: Layout = LAYOUT) -> list[Message]:
    """The messages that stand behind each other. layout: of the recording.

    Raises ValueError for what is none.
    """
    reader = _Reader(data)
    messages = []
    names = list(layout)
    try:
        while reader.left:
            name = names[reader.byte()]
            values = {field: reader.value() for field in layout[name]}
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
    form, data = _ints(array) if array.dtype.kind in "iu" else _floats(array, step)
    content += struct.pack(f"<BBB{array.ndim}I", _ARRAY, form, array.ndim, *array.shape) + data


def _ints(array: NDArray[Any]) -> tuple[int, bytes]:
    wide = array.astype("<i8")
    short = wide.astype("i1")
    if np.array_equal(short, wide):
        return _SHORT_INTS, short.tobytes()
    return _INTS, wide.tobytes()


def _floats(array: NDArray[Any], step: float | None) -> tuple[int, bytes]:
    """The form of an array of floats and its bytes; the first that gives back every bit."""
    wide = np.ascontiguousarray(array, dtype="<f8")
    for form, pack in ((_MULTIPLES, _multiples), (_STEADY, _steady)):
        data = pack(wide.reshape(-1), step)
        if data is not None and _FORMS[form](data, wide.size).tobytes() == wide.tobytes():
            return form, data
    return _FLOATS, wide.tobytes()


def _multiples(array: NDArray[np.float64], step: float | None) -> bytes | None:
    """Multiples of `step`, 16 bits each: differences where they are small, as of angles."""
    if step is None or not array.size or not np.all(np.abs(array) < 65536 * step):
        return None
    number = np.rint(array / step).astype(np.int64).astype("<u2")
    signed = bool(np.any(array < 0.0))
    if signed:
        number = np.diff(number, prepend=np.zeros(1, "<u2"))
    return struct.pack("<?d", signed, step) + number.tobytes()


def _of_multiples(data: bytes, size: int) -> NDArray[np.float64]:
    signed, step = struct.unpack_from("<?d", data)
    number = np.frombuffer(data, "<u2", size, offset=9)
    if signed:
        return np.asarray(np.cumsum(number, dtype="<u2").astype("<i2") * step)
    return np.asarray(number * step)


def _steady(array: NDArray[np.float64], _: float | None) -> bytes | None:
    """Almost evenly spaced, as times are: two values, and how the rest deviates in last places."""
    if array.size < 8 or not np.all(np.isfinite(array)):
        return None
    places = array.view("<i8")
    bends = np.diff(places, n=2)
    if np.any(np.abs(bends) > 127):
        return None
    return places[:2].tobytes() + bends.astype("i1").tobytes()


def _of_steady(data: bytes, size: int) -> NDArray[np.float64]:
    first, second = struct.unpack_from("<qq", data)
    steps = np.cumsum(np.frombuffer(data, "i1", size - 2, offset=16), dtype="<i8")
    places = np.empty(size, "<i8")
    places[0] = first
    places[1] = second
    places[2:] = second + np.cumsum(steps + (second - first))
    return places.view("<f8")


_FORMS: dict[int, Callable[[bytes, int], NDArray[Any]]] = {
    _FLOATS: lambda data, size: np.frombuffer(data, "<f8", size),
    _INTS: lambda data, size: np.frombuffer(data, "<i8", size),
    _SHORT_INTS: lambda data, size: np.frombuffer(data, "i1", size),
    _MULTIPLES: _of_multiples,
    _STEADY: _of_steady,
}


def _length(form: int, size: int) -> int:
    """Bytes of an array of `size` numbers."""
    return {_FLOATS: 8 * size, _INTS: 8 * size, _SHORT_INTS: size, _MULTIPLES: 9 + 2 * size}.get(
        form, 14 + size
    )


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
        if form not in _FORMS:
            raise ValueError(f"no array has form {form}")
        flat = _FORMS[form](self._take(_length(form, size)), size)
        return flat.reshape(shape).astype(np.float64 if flat.dtype.kind == "f" else np.int64)

    def _take(self, length: int) -> bytes:
        if length > self.left:
            raise ValueError("it ends too early")
        self._place += length
        return self._data[self._place - length : self._place]

    def _unpack(self, layout: str) -> tuple[Any, ...]:
        return struct.unpack(layout, self._take(struct.calcsize(layout)))
