"""Recordings as swarmloc wrote them before MCAP: one JSON object a line, to be read only.

The first line is the header; every other is one message. A line carries the CRC-32 of its content,
so that a torn last line and damage are found. Arrays are base64 of little-endian values.
"""

import base64
import binascii
import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from host.errors import UserError
from host.messages import (
    Bearings,
    Bodies,
    Displacement,
    Estimate,
    Health,
    Message,
    Positions,
    Scan,
    Truth,
)

FORMAT_VERSION = 1
SUFFIX = ".swarmloc"
_KINDS: dict[str, type[Message]] = {
    kind.__name__.lower(): kind
    for kind in (Scan, Positions, Bearings, Displacement, Estimate, Truth, Bodies, Health)
}
_ON_DISK = {"camera": "eye"}  # fields by another name in the file, as its first version has them
_FROM_DISK = {there: here for here, there in _ON_DISK.items()}
_BEFORE_CRC, _AFTER_CRC = b'{"crc":"', b'",'
_CRC_END = len(_BEFORE_CRC) + 8


class JsonLines:
    """A recording on disk. torn: its last line is incomplete (known once `messages` has ended).

    Raises UserError with the line number for whatever else is wrong with it.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.torn = False
        for number, line in self._lines():
            self.header = self._read_header(number, line)
            return
        raise UserError(
            f"{path} holds no recording", "its first line is missing", "the run ended at its start"
        )

    def messages(self) -> Iterator[Message]:
        """Yield the messages in the order they were written."""
        for number, line in self._lines():
            if number > 1:
                yield self._read_message(number, line)

    def _lines(self) -> Iterator[tuple[int, bytes]]:
        """The complete lines with their numbers, from 1."""
        try:
            with self.path.open("rb") as file:
                for number, line in enumerate(file, 1):
                    if not line.endswith(b"\n"):
                        self.torn = True
                        return
                    yield number, line
        except OSError as error:
            raise UserError(
                f"cannot read the recording {self.path}",
                error.strerror or str(error),
                "give the path of a recording",
            ) from error

    def _content(self, number: int, line: bytes) -> dict[str, Any]:
        """The object of one line, its CRC proved."""
        body = b"{" + line[_CRC_END + len(_AFTER_CRC) : -1]
        expected = b"%b%08x%b" % (_BEFORE_CRC, zlib.crc32(body), _AFTER_CRC)
        if not line.startswith(expected):
            raise self._damaged(number, "its content does not fit its checksum")
        content = json.loads(body)
        if not isinstance(content, dict):
            raise self._damaged(number, "it holds no object")
        return content

    def _read_header(self, number: int, line: bytes) -> dict[str, Any]:
        if not line.startswith(_BEFORE_CRC):
            raise UserError(
                f"{self.path} is not a swarmloc recording",
                "its first line is not a header",
                "give a .mcap file, as `swarmloc run --record` and `swarmloc simulate` write",
            )
        return self._content(number, line)

    def _read_message(self, number: int, line: bytes) -> Message:
        content = self._content(number, line)
        name = content.pop("kind", None)
        kind = _KINDS.get(str(name))
        if kind is None:
            raise self._damaged(number, f"there is no message of kind {name!r}")
        try:
            return kind(
                **{_FROM_DISK.get(field, field): _decode(value) for field, value in content.items()}
            )
        except (TypeError, ValueError, KeyError, IndexError, binascii.Error) as error:
            raise self._damaged(number, f"no {name}: {error}") from error

    def _damaged(self, number: int, why: str) -> UserError:
        return UserError(
            f"{self.path}, line {number}: the recording is damaged",
            why,
            f"`head -n {number - 1}` saves what stands before it"
            if number > 2
            else "nothing stands before it that could be saved: use a copy",
        )


def _decode(value: Any) -> Any:
    """A list that begins with a name is an array, any other a tuple."""
    if not isinstance(value, list):
        return value
    if not isinstance(value[0], str):
        return tuple(value)
    name, shape, data = value
    flat = np.frombuffer(base64.b64decode(data, validate=True), dtype=f"<{name}")
    return flat.reshape(shape).astype({"f8": np.float64, "i8": np.int64}[name])
