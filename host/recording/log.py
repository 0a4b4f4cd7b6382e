"""A run on disk: one JSON object a line, in the order in which the localizer consumed it.

The first line is the header; every other is one message. A line is written at once and carries
the CRC-32 of its content, so that a run that was killed loses its last line at most and damage is
found. Arrays are base64 of little-endian values: what is read is bit for bit what was written.
"""

import base64
import binascii
import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from pydantic import ValidationError

from host.config import RobotConfig
from host.config_errors import NOT_REGISTERED, explain_settings
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


@dataclass(frozen=True, slots=True)
class RecordingHeader:
    """What a run was: the configuration in effect, the sensors in use, the scenario if any."""

    config: RobotConfig
    sensors: str
    scenario: str | None = None


class Recorder:
    """Writes a recording. Raises UserError where the file exists already or cannot be written."""

    def __init__(self, path: str | Path, header: RecordingHeader) -> None:
        self._path = Path(path)
        try:
            self._file = self._path.open("xb", buffering=0)
        except FileExistsError as error:
            raise UserError(
                f"the recording {path} exists already",
                "recordings are never overwritten",
                "choose another name, or remove the file first",
            ) from error
        except OSError as error:
            raise self._unwritable(error) from error
        self._write(
            {
                "kind": "header",
                "version": FORMAT_VERSION,
                "robot": header.config.name,
                "sensors": header.sensors,
                "scenario": header.scenario,
                "config": header.config.model_dump(mode="json"),
            }
        )

    def write(self, message: Message) -> None:
        """Append one message. Raises UserError where that fails, for example on a full disk."""
        kind = type(message)
        values = {
            _ON_DISK.get(field.name, field.name): getattr(message, field.name)
            for field in fields(kind)
        }
        self._write({"kind": kind.__name__.lower(), **values})

    def _write(self, content: dict[str, Any]) -> None:
        body = json.dumps(content, separators=(",", ":"), default=_encode).encode()
        line = b"%b%08x%b%b\n" % (_BEFORE_CRC, zlib.crc32(body), _AFTER_CRC, body[1:])
        try:
            while line:
                line = line[self._file.write(line) :]
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> UserError:
        return UserError(
            f"cannot write the recording {self._path}",
            error.strerror or str(error),
            "check the folder and the free space on its disk",
        )

    def close(self) -> None:
        """End the recording; a second call does nothing."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class Recording:
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
                f"give the path of a {SUFFIX} file",
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

    def _read_header(self, number: int, line: bytes) -> RecordingHeader:
        if not line.startswith(_BEFORE_CRC):
            raise UserError(
                f"{self.path} is not a swarmloc recording",
                "its first line is not a header",
                f"give a {SUFFIX} file, as `swarmloc run --record` and `swarmloc simulate` write",
            )
        content = self._content(number, line)
        if content.get("version") != FORMAT_VERSION:
            raise UserError(
                f"{self.path} is of recording version {content.get('version')}",
                f"this swarmloc reads version {FORMAT_VERSION}",
                "use the swarmloc that wrote it",
            )
        try:
            config = RobotConfig.model_validate(content["config"])
            return RecordingHeader(config, content["sensors"], content["scenario"])
        except KeyError as error:
            raise self._damaged(number, f"its header has no {error}") from error
        except ValidationError as error:
            unknown = any(each["type"] == NOT_REGISTERED for each in error.errors())
            raise UserError(
                f"{self.path}: the configuration cannot be read",
                "\n".join(explain_settings(error, RobotConfig)[:5]),
                "load the plugin it was made with: swarmloc --plugin FILE.py ..."
                if unknown
                else "use the swarmloc that wrote it",
            ) from error

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


def _encode(value: Any) -> Any:
    """An array as [type, shape, base64]; a numpy number as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    array = np.asarray(value)
    name = "i8" if array.dtype.kind in "iu" else "f8"
    data = array.astype(f"<{name}").tobytes()
    return [name, list(array.shape), base64.b64encode(data).decode()]


def _decode(value: Any) -> Any:
    """A list that begins with a name is an array, any other a tuple."""
    if not isinstance(value, list):
        return value
    if not isinstance(value[0], str):
        return tuple(value)
    name, shape, data = value
    flat = np.frombuffer(base64.b64decode(data, validate=True), dtype=f"<{name}")
    return flat.reshape(shape).astype({"f8": np.float64, "i8": np.int64}[name])
