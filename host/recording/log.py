"""Recordings: what a run measured and estimated, in the order in which the localizer consumed it.

An MCAP file (https://mcap.dev) of profile ros2 holds each message twice: in our records, bit for
bit, which replay reads; and as topics that other tools draw. docs/recordings.md describes both.
"""

import contextlib
import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, Self

from pydantic import ValidationError

from host.config import RobotConfig, recorded_config
from host.config.errors import NOT_REGISTERED, explain_settings
from host.errors import UserError
from host.messages import (
    DeviceBytes,
    DeviceIdentity,
    Displacement,
    Health,
    Message,
    Picture,
    Positions,
    Scan,
)
from host.recording import content, json_lines
from host.recording.appended import AppendedFile, AppendedMcap, DirectFile
from host.recording.checked import CheckedMcap, is_mcap
from host.recording.records import TOPIC, TYPE, Packer
from host.recording.ros.cdr import nanoseconds
from host.recording.ros.pictures import Pictures
from host.recording.ros.topics import Topics

FORMAT_VERSION = 2
SUFFIX = ".mcap"
SUFFIXES = (SUFFIX, json_lines.SUFFIX)  # of what `Recording` reads
LIDAR, BOARD = "lidar", "board"
HEADER, END = b"\xff", b"\xfe"  # before the content of the first and of the last record
_MOST_BYTES = 4096  # of a device that are kept back for its next message
_VERSIONS = ("swarmloc", "numpy", "scipy", "opencv-python-headless")


@dataclass(frozen=True, slots=True)
class RecordingHeader:
    """What a run was: the configuration in effect, the sensors in use, the scenario if any.

    unix_s: what to add to the messages' times for the seconds since 1970.
    """

    config: RobotConfig
    sensors: str
    scenario: str | None = None
    unix_s: float = 0.0


class Recorder:
    """Writes a recording, each message at once; a device's bytes with the message made of them.

    file: what it is written to, else a new one at `path`. Raises UserError where that exists
    already or cannot be written.
    """

    def __init__(
        self, path: str | Path, header: RecordingHeader, file: AppendedFile | None = None
    ) -> None:
        file = file or DirectFile(Path(path))
        self._packer = Packer()
        self._topics = Topics(header.config, header.unix_s)
        self._unix_s = header.unix_s
        self._time_ns = 0  # of the newest message
        self._bytes: dict[str, list[DeviceBytes]] = {}  # by device, not yet written
        self._closed = False
        with contextlib.ExitStack() as on_failure:
            on_failure.callback(file.close)
            self._file = AppendedMcap(file)
            self._begin(header)
            on_failure.pop_all()

    def _begin(self, header: RecordingHeader) -> None:
        config = header.config.model_dump(mode="json")
        versions = {name: _version(name) for name in _VERSIONS}
        about = {
            "version": FORMAT_VERSION,
            "robot": header.config.name,
            "sensors": header.sensors,
            "scenario": header.scenario,
            "unix_s": header.unix_s,
            "software": versions,
        }
        rest = {"config": config, "layout": content.LAYOUT}
        self._write(HEADER + json.dumps({**about, **rest}).encode())
        words = {name: str(value) for name, value in about.items() if name != "software"}
        self._file.add_metadata("swarmloc", {**words, **versions})
        text = json.dumps(config, indent=1).encode()
        self._file.add_attachment("robot.json", "application/json", text, self._time_ns)

    def write(self, message: Message) -> None:
        """Append one message. Raises UserError where that fails, for example on a full disk."""
        self._time_ns = max(self._time_ns, nanoseconds(message.time + self._unix_s))
        if isinstance(message, Picture):  # large: once is enough
            self._publish_all(message)
            return
        if isinstance(message, DeviceBytes):
            self._keep_back(message)
            return
        self._write(self._sent(_device(message)) + content.encode(message))
        if isinstance(message, DeviceIdentity):
            self._file.add_metadata(f"device {message.device}", message.values)
        if isinstance(message, Scan) and not self._file.next_number("/tf_static"):
            self._publish(self._topics.mounting(message.time))
        self._publish_all(message)

    def _publish_all(self, message: Message) -> None:
        for published in self._topics.of(message):
            self._publish(published)

    def _keep_back(self, part: DeviceBytes) -> None:
        kept = self._bytes.setdefault(part.device, [])
        kept.append(part)
        if sum(len(each.data) for each in kept) > _MOST_BYTES:
            self._write(self._sent(part.device))

    def _sent(self, device: str) -> bytes:
        """What was kept back of a device; it is not any more."""
        kept = self._bytes.pop(device, None)
        return content.encode_sent(kept) if kept else b""

    def _publish(self, published: tuple[str, str, bytes]) -> None:
        self._file.add_message(*published, self._time_ns)

    def _write(self, data: bytes) -> None:
        number = self._file.next_number(TOPIC)
        packed = self._packer.pack(data, number, self._time_ns, self._file.take_others())
        self._file.add_message(TOPIC, TYPE, packed, self._time_ns, ours=True)

    def close(self) -> None:
        """End the recording; nothing where it has ended, or a failure was raised before."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._file.failed:
                for device in list(self._bytes):
                    self._write(self._sent(device))
                self._write(END)
                self._file.finish()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Leave the recording as it is, without its end; nothing where it has ended."""
        self._closed = True
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        if error is None:
            self.close()
        else:
            self.abandon()


def _device(message: Message) -> str:
    """The device that a message is made of the bytes of."""
    if isinstance(message, Health | DeviceIdentity):
        return message.device
    if isinstance(message, Scan | Positions):
        return LIDAR
    return BOARD if isinstance(message, Displacement) else ""


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:  # as of Debian's OpenCV
        return "unknown"


class Recording:
    """A recording on disk, or one of the JSON lines that swarmloc wrote before.

    remarks: in words, what is not as it should be but costs nothing of what was written; cameras:
    those of which it has pictures. Both are known once `messages` has ended. Raises UserError for a
    file that is none or cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.remarks: list[str] = []
        self.cameras: list[str] = []
        self.share = 0.0  # of the file that `messages` has read
        self._old = None if is_mcap(self.path) else json_lines.JsonLines(self.path)
        if self._old is not None:
            self.header = _header(self.path, self._old.header, json_lines.FORMAT_VERSION)
            return
        about, self._layout = self._about()
        self.header = _header(self.path, about, FORMAT_VERSION)

    def messages(self, with_pictures: bool = False) -> Iterator[Message]:
        """Yield the messages in the order they were written.

        with_pictures: also those of the cameras, which no localizer reads. Raises UserError where
        the file is damaged, after the messages before the damage.
        """
        if self._old is not None:
            yield from self._old.messages()
            self.remarks = ["its last line is torn: the run was cut short"] * self._old.torn
            return
        file = CheckedMcap(self.path)
        pictures = Pictures(self.header.unix_s)
        for record, data in file.all_records():
            if data is None:
                picture = pictures.take(record)
                self.cameras = sorted(pictures.cameras)
                if picture is not None and with_pictures:
                    yield picture
            elif not data.startswith((HEADER, END)):
                with file.checking():
                    made = content.decode(data, self._layout)
                self.share = file.share
                yield from made
        self.remarks = file.remarks

    def _about(self) -> tuple[dict[str, Any], content.Layout]:
        for _, data in CheckedMcap(self.path).records():
            if data.startswith(HEADER):
                about = json.loads(data[1:])
                return about, about["layout"]
            break
        raise UserError(
            f"{self.path} holds no recording of swarmloc",
            f"no record is in it on {TOPIC}",
            "a run that was killed at its start left it; or it is another robot's: give it as "
            f"bag:{self.path}",
        )


def _header(path: Path, about: dict[str, Any], version: int) -> RecordingHeader:
    """The header, its configuration checked."""
    if about.get("version") != version:
        raise UserError(
            f"{path} is of recording version {about.get('version')}",
            f"this swarmloc reads versions {json_lines.FORMAT_VERSION} and {FORMAT_VERSION}",
            "use the swarmloc that wrote it",
        )
    try:
        config = recorded_config(about["config"])
        names = [field.name for field in dataclasses.fields(RecordingHeader)][1:]
        return RecordingHeader(config, **{name: about[name] for name in names if name in about})
    except ValidationError as error:
        unknown = any(each["type"] == NOT_REGISTERED for each in error.errors())
        raise UserError(
            f"{path}: the configuration cannot be read",
            explain_settings(error, RobotConfig),
            "load the plugin it was made with: swarmloc --plugin FILE.py ..."
            if unknown
            else "use the swarmloc that wrote it",
        ) from error
    except (KeyError, TypeError) as error:
        raise UserError(
            f"{path}: its header is incomplete", f"no {error}", "use a copy of the recording"
        ) from error
