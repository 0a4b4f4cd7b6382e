"""An MCAP file that grows message by message, and is whole up to the last one at any time."""

import os
from importlib import metadata
from pathlib import Path
from typing import Protocol

from mcap.records import Attachment, Channel, McapRecord, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.writer import CompressionType, Writer

from host.errors import UserError
from host.recording.records import Others
from host.recording.ros.definitions import schema

PROFILE = "ros2"
# rosbag2's words for a topic whose last message a late reader gets, too.
_LATCHED = {
    "offered_qos_profiles": "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n"
    "  deadline:\n    sec: 0\n    nsec: 0\n  lifespan:\n    sec: 0\n    nsec: 0\n"
    "  liveliness: 1\n  liveliness_lease_duration:\n    sec: 0\n    nsec: 0\n"
    "  avoid_ros_namespace_conventions: false\n"
}


class AppendedFile(Protocol):
    """What the MCAP writer writes to. After a failure it writes nothing more.

    failed: a failure was raised. Every method may raise UserError; what was written is then cut to
    whole records.
    """

    failed: bool

    def write(self, data: bytes) -> int:
        """Append bytes; return how many."""

    def tell(self) -> int:
        """How many bytes were written."""

    def flush(self) -> None:
        """For the MCAP writer."""

    def whole(self) -> None:
        """Up to here all records are whole."""

    def close(self) -> None:
        """Write no more; a second call does nothing."""


class AppendedMcap:
    """Writes without chunks. Raises UserError where nothing can be written any more."""

    def __init__(self, stream: AppendedFile) -> None:
        self._stream = stream
        self._writer = Writer(
            self._stream,  # type: ignore[arg-type]
            compression=CompressionType.NONE,
            use_chunking=False,
            enable_data_crcs=True,
        )
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequences: dict[str, int] = {}
        self._others = Others()
        self._writer.start(profile=PROFILE, library=f"swarmloc {metadata.version('swarmloc')}")

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Append names and values."""
        self._writer.add_metadata(name, values)
        self._wrote(Metadata(name, values))

    def add_attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Append a file."""
        self._writer.add_attachment(time_ns, time_ns, name, media_type, data)
        self._wrote(Attachment(time_ns, time_ns, name, media_type, data))

    def take_others(self) -> Others:
        """What was written for other tools since this was asked last."""
        others, self._others = self._others, Others()
        return others

    def next_number(self, topic: str) -> int:
        """The number that the next message of a topic gets."""
        return self._sequences.get(topic, 0)

    def add_message(
        self, topic: str, kind: str, data: bytes, time_ns: int, ours: bool = False
    ) -> None:
        """Append a message. ours: not one of those for other tools."""
        if topic not in self._channels:
            self._open_channel(topic, kind)
        number = self.next_number(topic)
        self._sequences[topic] = (number + 1) & 0xFFFFFFFF
        channel = self._channels[topic]
        self._writer.add_message(channel, time_ns, data, time_ns, number)
        self._wrote(None if ours else McapMessage(channel, time_ns, data, time_ns, number))

    def _open_channel(self, topic: str, kind: str) -> None:
        if kind not in self._schemas:
            text = schema(kind)
            number = self._writer.register_schema(kind, "ros2msg", text)
            self._schemas[kind] = number
            self._others.take(Schema(number, text, "ros2msg", kind))
        latched = _LATCHED if topic == "/tf_static" else {"offered_qos_profiles": ""}
        number = self._writer.register_channel(topic, "cdr", self._schemas[kind], latched)
        self._channels[topic] = number
        self._others.take(Channel(number, topic, "cdr", latched, self._schemas[kind]))

    def _wrote(self, record: McapRecord | None) -> None:
        self._stream.whole()
        if record is not None:
            self._others.take(record)

    @property
    def failed(self) -> bool:
        """Has a message found that nothing can be written any more?"""
        return self._stream.failed

    def finish(self) -> None:
        """Write the index and close. Raises UserError where that fails."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.whole()
        self.close()

    def close(self) -> None:
        """Close without the index; a second call does nothing."""
        self._stream.close()


class DirectFile:
    """Writes at once, however long that takes."""

    def __init__(self, path: Path) -> None:
        """Raises UserError where the file exists already or cannot be made."""
        self._path = path
        self._size = self._whole = 0
        self._closed = False
        self.failed = False
        self._handle = created(path)

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        try:
            while left:
                written = os.write(self._handle, left)
                self._size += written
                left = left[written:]
        except OSError as error:
            self.failed = True
            os.ftruncate(self._handle, self._whole)
            raise unwritable(self._path, error.strerror or str(error)) from error
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def whole(self) -> None:
        self._whole = self._size

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            os.close(self._handle)


def created(path: Path) -> int:
    """A new file's descriptor. Raises UserError where it exists already or cannot be made."""
    try:
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    except FileExistsError as error:
        raise UserError(
            f"the recording {path} exists already",
            "recordings are never overwritten",
            "choose another name, or remove the file first",
        ) from error
    except OSError as error:
        raise unwritable(path, error.strerror or str(error)) from error


def unwritable(path: Path, reason: str) -> UserError:
    """What a user reads of a file that cannot be written."""
    return UserError(
        f"cannot write the recording {path}",
        reason,
        "check the folder and the free space on its disk",
    )
