"""The board's frames on the line: COBS, a CRC-16 and a zero byte (see protocol.toml). Pure."""

from binascii import crc_hqx
from dataclasses import dataclass

from cobs import cobs

from host.drivers.romeo.protocol import FRAMES, LARGEST_ENCODED, Frame

DELIMITER = b"\0"


def encode(frame: Frame) -> bytes:
    """The bytes of one frame, delimiter included. Raises struct.error where a field overflows."""
    content = frame.LAYOUT.pack(frame.ID, *(getattr(frame, name) for name in frame.__slots__))
    crc = crc_hqx(content, 0).to_bytes(2, "little")
    return bytes(cobs.encode(content + crc)) + DELIMITER


@dataclass(slots=True)
class Counts:
    """What a decoder made of its bytes since it was made, in frames."""

    accepted: int = 0
    broken: int = 0  # no COBS, or too long for any frame: torn on the line, or not of this protocol
    bad_crc: int = 0
    unknown: int = 0  # the CRC is right, but there is no frame of this id and length

    @property
    def refused(self) -> int:
        """Frames that gave no value."""
        return self.broken + self.bad_crc + self.unknown


class BoardDecoder:
    """Bytes, cut anywhere, to frames. Never raises on what it is fed; counts what it refused."""

    def __init__(self) -> None:
        self.counts = Counts()
        self._partial = bytearray()

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that end in `data`, in order."""
        *ended, rest = data.split(DELIMITER)
        frames = []
        for piece in ended:
            self._grow(piece)
            if self._partial:
                frame = self._decode(bytes(self._partial))
                if frame is not None:
                    frames.append(frame)
            self._partial.clear()
        self._grow(rest)
        return frames

    def _grow(self, piece: bytes) -> None:
        """Keep the piece, but no more than shows that it is too long for any frame."""
        self._partial += piece[: LARGEST_ENCODED - len(self._partial)]

    def _decode(self, encoded: bytes) -> Frame | None:
        if len(encoded) >= LARGEST_ENCODED:
            self.counts.broken += 1
            return None
        try:
            raw = cobs.decode(encoded)
        except cobs.DecodeError:
            self.counts.broken += 1
            return None
        content, crc = raw[:-2], raw[-2:]
        if crc_hqx(content, 0).to_bytes(2, "little") != crc:
            self.counts.bad_crc += 1
            return None
        kind = FRAMES.get(content[0]) if content else None
        if kind is None or kind.LAYOUT.size != len(content):
            self.counts.unknown += 1
            return None
        self.counts.accepted += 1
        return kind(*kind.LAYOUT.unpack(content)[1:])
