"""The cameras' pictures in a recording, as `topics` wrote them, read again."""

import math
import struct

from mcap.records import Channel, McapRecord
from mcap.records import Message as McapMessage

from host.messages import Picture
from host.recording.ros.cdr import CdrReader

_BEFORE, _AFTER = "/camera/", "/image/compressed"


def picture_topic(camera: str) -> str:
    """Where the pictures of a camera are."""
    return f"{_BEFORE}{camera}{_AFTER}"


class Pictures:
    """Finds the pictures among the records of a file. unix_s: as in its header.

    cameras: those of which there are any, so far.
    """

    def __init__(self, unix_s: float) -> None:
        self.cameras: set[str] = set()
        self._unix_s = unix_s
        self._topics: dict[int, str] = {}

    def take(self, record: McapRecord) -> Picture | None:
        """The picture that a record is; None where it is something else, or damaged."""
        if isinstance(record, Channel):
            self._topics[record.id] = record.topic
        if not isinstance(record, McapMessage):
            return None
        topic = self._topics.get(record.channel_id, "")
        if not (topic.startswith(_BEFORE) and topic.endswith(_AFTER)):
            return None
        camera = topic.removeprefix(_BEFORE).removesuffix(_AFTER)
        try:
            picture = self._read(record.data, camera)
        except struct.error:
            return None
        self.cameras.add(camera)
        return picture

    def _read(self, data: bytes, camera: str) -> Picture:
        cdr = CdrReader(data)
        second, nanosecond = cdr.number("i"), cdr.number("I")
        cdr.octets()  # frame
        cdr.octets()  # format
        fraction, whole = math.modf(self._unix_s)
        return Picture(second - whole + (nanosecond * 1e-9 - fraction), camera, cdr.octets())
