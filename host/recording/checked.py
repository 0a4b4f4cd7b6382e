"""An MCAP file of ours read record by record, with every fault in words."""

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    Schema,
)
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC as MAGIC
from zstandard import ZstdError

from host.errors import UserError
from host.recording.records import TOPIC, Others, Unpacker

REPAIRED = "swarmloc repaired"  # the metadata of a file that `swarmloc record --repair` made
_END = b"\xfe"
_LARGEST = 1 << 31
_HEAD = struct.Struct("<BQ")
_READ: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.FOOTER: Footer.read,
    Opcode.HEADER: Header.read,
    Opcode.METADATA: Metadata.read,
    Opcode.SCHEMA: Schema.read,
}
_KNOWN = set(Opcode)
_NO_INDEX = "the index at its end is damaged or missing: `swarmloc record --repair` makes a new one"
_UNREADABLE = (
    *(McapError, ValueError, KeyError, IndexError, TypeError, OverflowError, RuntimeError),
    *(struct.error, zlib.error, ZstdError, OSError),  # OSError: of a disk's bad sector
)


def is_mcap(path: Path) -> bool:
    """Does a file begin as MCAP does? Raises UserError where it cannot be read."""
    with _opened(path) as file:
        return file.read(len(MAGIC)) == MAGIC


class CheckedMcap:
    """Reads a file to its end, or to its first fault.

    remarks: what is wrong but loses nothing that was written, known once `records` has ended.
    finished: was the end record there?
    """

    def __init__(self, path: Path) -> None:
        self.remarks: list[str] = []
        self.finished = False
        self._path = path
        self._place = self._size = 0  # of the record that is being read, and of the file
        self._crc = zlib.crc32(MAGIC)  # of what was read
        self._unpacker = Unpacker()
        self._others = Others()
        self._number = 0  # of our next record
        self._repaired = ""

    @property
    def share(self) -> float:
        """How much of the file has been read, 0 to 1."""
        return self._place / self._size if self._size else 0.0

    def records(self) -> Iterator[tuple[McapMessage, bytes]]:
        """Our records with their content."""
        for record, data in self.all_records():
            if isinstance(record, McapMessage) and data is not None:
                yield record, data

    def all_records(self) -> Iterator[tuple[McapRecord, bytes | None]]:
        """Every schema, channel, message, metadata and attachment; with its content where it is
        ours. Raises UserError where the file is damaged."""
        channels: dict[int, str] = {}
        seen: set[tuple[type[McapRecord], int]] = set()
        for record in self._mcap_records():
            if isinstance(record, Schema | Channel):
                if (type(record), record.id) in seen:
                    continue  # each chunk may repeat them
                seen.add((type(record), record.id))
            if isinstance(record, Channel):
                channels[record.id] = record.topic
            if isinstance(record, Metadata) and record.name == REPAIRED:
                self._repaired = record.metadata.get("fault", "?")  # its chunks have their CRCs
                continue
            if isinstance(record, McapMessage) and channels.get(record.channel_id) == TOPIC:
                with self.checking():
                    data = self._ours(record)
                if data is not None:
                    yield record, data
                continue
            self._others.take(record)
            yield record, None
        self._conclude()

    @contextlib.contextmanager
    def checking(self) -> Iterator[None]:
        """Whatever is wrong in this block is damage of the file."""
        try:
            yield
        except _UNREADABLE as error:
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise self._damaged(why) from error

    def _ours(self, record: McapMessage) -> bytes | None:
        """The content of a record of ours, None where it comes again."""
        number = record.sequence
        if number < self._number:
            self.remarks.append(f"record {number} comes twice, or too late; it is not used")
            return None
        if number > self._number:
            last = f" to {number - 1}" if number - 1 > self._number else ""
            raise ValueError(f"record {self._number}{last} is missing before record {number}")
        data = self._unpacker.unpack(record, None if self._repaired else self._others)
        self._others = Others()
        self._number += 1
        self.finished = self.finished or data == _END
        return data

    def _mcap_records(self) -> Iterator[McapRecord]:
        """Every record as it stands in the file. What follows our end record is an index."""
        with _opened(self._path) as file:
            self._size = file.seek(0, 2)
            file.seek(len(MAGIC))
            try:
                while (record := self._next(file)) is not None:
                    with self.checking():
                        yield from (
                            breakup_chunk(record, True) if isinstance(record, Chunk) else [record]
                        )
                    if isinstance(record, Footer):
                        with self.checking():
                            indexed = self._has_index(file, record)
                        self.remarks += [] if indexed else [_NO_INDEX]
                        return
                if self.finished:
                    self.remarks.append(_NO_INDEX)
            except UserError:
                if not self.finished:
                    raise
                self.remarks.append(_NO_INDEX)

    def _next(self, file: BinaryIO) -> McapRecord | None:
        """The next record; None where the file ends before or within it."""
        self._place = file.tell()
        with self.checking():
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return None
            opcode, length = _HEAD.unpack(head)
            if opcode not in _KNOWN or length > _LARGEST:
                raise ValueError(f"no record is of kind {opcode} and has {length} bytes")
            if length > self._size - file.tell():
                return None
            body = file.read(length)
            if opcode == Opcode.DATA_END:
                self._check_data(body)
            self._crc = zlib.crc32(head + body, self._crc)
            stream = ReadDataStream(BytesIO(body))
            if opcode == Opcode.MESSAGE:
                message: McapRecord = McapMessage.read(stream, length)
                return message
            kind = _READ.get(opcode)
            found: McapRecord = McapRecord() if kind is None else kind(stream)
            return found

    def _check_data(self, body: bytes) -> None:
        """Compare the checksum of all that stands before the index, where there is one."""
        crc = DataEnd.read(ReadDataStream(BytesIO(body))).data_section_crc
        if crc not in (0, self._crc):
            self.remarks.append("a byte of it was changed where our records are not")

    def _has_index(self, file: BinaryIO, footer: Footer) -> bool:
        """Does the index fit its checksum, where it has one, and the file end as MCAP does?"""
        begin, end = footer.summary_start or self._place, self._place + _HEAD.size + 16
        file.seek(min(begin, end))
        checked = file.read(end - file.tell())
        file.seek(-len(MAGIC), 2)
        fits = footer.summary_crc in (0, zlib.crc32(checked))
        return fits and file.read() == MAGIC

    def _conclude(self) -> None:
        """Say what is not as it should be."""
        left = self._size - self._place
        if self._repaired:
            self.remarks.append(f"repaired: {self._repaired}")
        elif not self.finished:
            lost = f"; of the last record {left} bytes are there" if left else ""
            self.remarks.append(f"unfinished: the run was killed or its disk was full{lost}")
        if not self._unpacker.intact:
            self.remarks.append(
                "its topics for other tools are damaged or were changed; the records are whole"
            )

    def _damaged(self, why: str) -> UserError:
        return UserError(
            f"{self._path} is damaged at byte {self._place} of {self._size}",
            why,
            f"`swarmloc record --repair {self._path}` saves the {self._number} records before",
        )


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise UserError(
            f"cannot read the recording {path}",
            error.strerror or str(error),
            "give the path of a recording, as `swarmloc run --record` writes it",
        ) from error
