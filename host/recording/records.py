"""The records of a recording: numbered, checked, and small; each is written at once.

A record is one message of `swarmloc_msgs/msg/Record` in an MCAP file. Its data are a piece of a
deflate stream (RFC 1951) that is flushed after each record, as WebSockets do it (RFC 7692): what
was said before costs little to say again. The stream restarts every RENEWAL records, so that a
program may begin to read there. The CRC covers number, time and data, and each record carries the
CRC of what the file holds for other tools since the record before.
"""

import struct
import zlib
from dataclasses import dataclass

from mcap.records import Attachment, Channel, McapRecord, Metadata, Schema
from mcap.records import Message as McapMessage

from host.recording.ros.cdr import CdrBuilder

TOPIC, TYPE = "/swarmloc/records", "swarmloc_msgs/msg/Record"
RENEWAL = 400  # some 4 s
_FRESH, _OTHERS = 1, 2
_END_OF_FLUSH = b"\0\0\xff\xff"  # of each piece the same, so it is left out
_HEAD, _CHECKED, _COUNTED = struct.Struct("<4xII"), struct.Struct("<IQ"), struct.Struct("<HI")
_LARGEST = 1 << 26  # of a record's content


@dataclass(slots=True)
class Others:
    """How many records for other tools came since the last one of ours, and their CRC."""

    count: int = 0
    crc: int = 0

    def take(self, record: McapRecord) -> None:
        """Count a record. Ours are checked by themselves, and indexes say nothing new."""
        if isinstance(record, McapMessage):
            head = struct.pack("<IQQ", record.sequence, record.log_time, record.publish_time)
            content = head + record.data
        elif (isinstance(record, Schema) and record.name == TYPE) or (
            isinstance(record, Channel) and record.topic == TOPIC
        ):
            return
        elif isinstance(record, Schema | Attachment):
            content = record.name.encode() + record.data
        elif isinstance(record, Channel):
            content = repr((record.topic, record.message_encoding, record.metadata)).encode()
        elif isinstance(record, Metadata):
            content = repr((record.name, sorted(record.metadata.items()))).encode()
        else:
            return
        self.count = (self.count + 1) & 0xFFFF
        self.crc = zlib.crc32(content, self.crc)


class Packer:
    """Makes the records' data, in order."""

    def __init__(self) -> None:
        self._deflate = zlib.compressobj(wbits=-zlib.MAX_WBITS, memLevel=9)
        self._count = 0

    def pack(self, content: bytes, number: int, time_ns: int, others: Others) -> bytes:
        """The CDR of the record with this number and time."""
        fresh = self._count % RENEWAL == 0
        if fresh:
            self._deflate = zlib.compressobj(wbits=-zlib.MAX_WBITS, memLevel=9)
        self._count += 1
        piece = self._deflate.compress(content) + self._deflate.flush(zlib.Z_SYNC_FLUSH)
        flags = _FRESH * fresh | _OTHERS * (others.count > 0)
        data = bytes([flags])
        if others.count:
            data += _COUNTED.pack(others.count, others.crc)
        data += piece.removesuffix(_END_OF_FLUSH)
        cdr = CdrBuilder()
        cdr.numbers("I", zlib.crc32(_CHECKED.pack(number, time_ns) + data))
        cdr.octets(data)
        return cdr.data


class Unpacker:
    """The content of records, in order. intact: are those for other tools as they were written?"""

    def __init__(self) -> None:
        self._inflate = zlib.decompressobj(-zlib.MAX_WBITS)
        self.intact = True

    def unpack(self, record: McapMessage, others: Others | None) -> bytes:
        """The content of a record. others: those since the last one, None: not to be compared.

        Raises ValueError.
        """
        if len(record.data) < _HEAD.size:
            raise ValueError("it is too short")
        crc, length = _HEAD.unpack_from(record.data)
        data = record.data[_HEAD.size :]
        if length != len(data) or not data:
            raise ValueError("its length is wrong")
        if crc != zlib.crc32(_CHECKED.pack(record.sequence, record.log_time) + data):
            raise ValueError("its content does not fit its checksum")
        counted, place = Others(), 1
        if data[0] & _OTHERS:
            counted, place = Others(*_COUNTED.unpack_from(data, 1)), 1 + _COUNTED.size
        self.intact = self.intact and others in (None, counted)
        if data[0] & _FRESH:
            self._inflate = zlib.decompressobj(-zlib.MAX_WBITS)
        try:
            return self._inflate.decompress(data[place:] + _END_OF_FLUSH, _LARGEST)
        except zlib.error as error:
            raise ValueError("records before it are missing") from error
