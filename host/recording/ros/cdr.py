"""ROS 2's serialization of messages: CDR, little-endian, as OMG DDSI-RTPS 2.3 section 10 has it.

Numbers stand at multiples of their size behind the four bytes of the encapsulation header. A text
or a sequence begins with its length as uint32; a text ends with a zero byte that counts.
"""

import struct
from typing import Any

from numpy.typing import NDArray

_LITTLE_ENDIAN = b"\0\1\0\0"


def nanoseconds(seconds: float) -> int:
    """A time as MCAP and ROS have it; 0 for what has no place there."""
    whole = seconds * 1e9
    return round(whole) if 0.0 <= whole < 2.0**63 else 0


class CdrBuilder:
    """Puts the fields of one message behind each other; `data` is the message."""

    def __init__(self) -> None:
        self._data = bytearray(_LITTLE_ENDIAN)

    @property
    def data(self) -> bytes:
        """What has been put together."""
        return bytes(self._data)

    def numbers(self, kind: str, *values: float) -> None:
        """Numbers of one kind: a letter of `struct`, as "d" for float64."""
        self._align(struct.calcsize(kind))
        self._data += struct.pack(f"<{len(values)}{kind}", *values)

    def text(self, text: str) -> None:
        """A string."""
        self.octets(text.encode("utf-8", "replace") + b"\0")

    def octets(self, data: bytes) -> None:
        """A sequence of bytes."""
        self.numbers("I", len(data))
        self._data += data

    def floats(self, array: NDArray[Any]) -> None:
        """A sequence of numbers of the array's type."""
        self.numbers("I", array.size)
        if array.size:
            self._align(array.dtype.itemsize)
            self._data += array.astype(array.dtype.newbyteorder("<")).tobytes()

    def _align(self, size: int) -> None:
        self._data += bytes(-(len(self._data) - len(_LITTLE_ENDIAN)) % size)


class CdrReader:
    """Takes the fields of a message, one after the other. Raises struct.error where it is short."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = len(_LITTLE_ENDIAN)

    def number(self, kind: str) -> Any:
        """A number: a letter of `struct`, as "d" for float64."""
        size = struct.calcsize(f"<{kind}")
        self._place += -(self._place - len(_LITTLE_ENDIAN)) % size
        (value,) = struct.unpack_from(f"<{kind}", self._data, self._place)
        self._place += size
        return value

    def octets(self) -> bytes:
        """A sequence of bytes, or a text with the zero byte at its end."""
        length = self.number("I")
        (octets,) = struct.unpack_from(f"{length}s", self._data, self._place)
        self._place += length
        return bytes(octets)
