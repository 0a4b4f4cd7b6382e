"""Arrays ↔ bytes, in the smallest form that gives back every bit, else as they are."""

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

# The forms; _SHORT_FLOATS is only read any more.
_FLOATS, _INTS, _SHORT_INTS, _MULTIPLES, _STEADY, _NANOSECONDS, _SHORT_FLOATS, _PLANES = range(8)
# A lidar counts its ranges, and angles are rounded, in these steps: 16 bits instead of 64.
STEPS = {"ranges": 0.00025, "angles": math.tau / 65536}


def pack(array: NDArray[Any], step: float | None) -> tuple[int, bytes]:
    """The form and the bytes of an array. step: of which its numbers may be multiples."""
    return _ints(array) if array.dtype.kind in "iu" else _floats(array, step)


def unpack(form: int, data: bytes, size: int) -> NDArray[Any]:
    """The numbers (size,) of what `pack` made; `packed_length(form, size)` bytes of data."""
    return _FORMS[form](data, size)


def _ints(array: NDArray[Any]) -> tuple[int, bytes]:
    wide = array.astype("<i8")
    short = wide.astype("i1")
    if np.array_equal(short, wide):
        return _SHORT_INTS, short.tobytes()
    return _INTS, wide.tobytes()


def _floats(array: NDArray[Any], step: float | None) -> tuple[int, bytes]:
    """The form of an array of floats and its bytes; the first that gives back every bit."""
    if array.dtype == np.float32:
        return _PLANES, _planes(array)
    wide = np.ascontiguousarray(array, dtype="<f8")
    forms = ((_MULTIPLES, _multiples), (_STEADY, _steady), (_NANOSECONDS, _nanoseconds))
    for form, pack in forms:
        data = pack(wide.reshape(-1), step)
        if data is not None and _FORMS[form](data, wide.size).tobytes() == wide.tobytes():
            return form, data
    return _FLOATS, wide.tobytes()


def rounded(array: NDArray[np.float64], bits: int) -> NDArray[np.float32]:
    """The nearest float32 with `bits` significant bits (at most 24); all others of it are 0."""
    with np.errstate(over="ignore"):
        short = np.ascontiguousarray(array, dtype=np.float32)
    unit = 1 << (24 - bits)
    places = short.view("<u4")
    near = (places + np.uint32(unit // 2)) & np.uint32(2**32 - unit)
    return np.where(np.isfinite(short), near.view("<f4"), short)


def _planes(array: NDArray[Any]) -> bytes:
    """All first bytes of float32, then all second ones, ...: what is alike stands together."""
    return array.astype(">f4").reshape(-1, 1).view("u1").T.tobytes()


def _of_planes(data: bytes, size: int) -> NDArray[Any]:
    return np.ascontiguousarray(np.frombuffer(data, "u1").reshape(4, size).T).view(">f4").ravel()


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


def _nanoseconds(array: NDArray[np.float64], _: float | None) -> bytes | None:
    """Times of the host's clock, which counts nanoseconds: the first, and 32 bits for each step."""
    if not array.size or not np.all(np.abs(array) < 2.0**53 * 1e-9):
        return None
    number = np.rint(array * 1e9).astype("<i8")
    steps = np.diff(number)
    if np.any((steps < 0) | (steps >> 32 > 0)):
        return None
    return number[:1].tobytes() + steps.astype("<u4").tobytes()


def _of_nanoseconds(data: bytes, size: int) -> NDArray[np.float64]:
    (first,) = struct.unpack_from("<q", data)
    steps = np.frombuffer(data, "<u4", size - 1, offset=8).astype(np.int64)
    return np.concatenate(([first], first + np.cumsum(steps))) / 1e9


_FORMS: dict[int, Callable[[bytes, int], NDArray[Any]]] = {
    _FLOATS: lambda data, size: np.frombuffer(data, "<f8", size),
    _INTS: lambda data, size: np.frombuffer(data, "<i8", size),
    _SHORT_INTS: lambda data, size: np.frombuffer(data, "i1", size),
    _MULTIPLES: _of_multiples,
    _STEADY: _of_steady,
    _NANOSECONDS: _of_nanoseconds,
    _SHORT_FLOATS: lambda data, size: np.frombuffer(data, "<f4", size),
    _PLANES: _of_planes,
}


def packed_length(form: int, size: int) -> int:
    """The bytes of `size` numbers. Raises ValueError for a form that is none."""
    if form not in _FORMS:
        raise ValueError(f"no array has form {form}")
    return {
        **{_FLOATS: 8 * size, _INTS: 8 * size, _SHORT_INTS: size, _MULTIPLES: 9 + 2 * size},
        **{_STEADY: 14 + size, _NANOSECONDS: 4 + 4 * size, _SHORT_FLOATS: 4 * size},
        _PLANES: 4 * size,
    }[form]
