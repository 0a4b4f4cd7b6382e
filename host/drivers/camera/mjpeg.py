"""A stream of JPEG pictures, cut into whole ones: bytes in, pictures out.

The cut follows the markers of ITU-T T.81 (annex B), so that an end-of-image mark within a segment
(a thumbnail, a comment) ends nothing, and what is not whole from its first mark to its last is
counted and never handed out. Some cameras leave the last mark out: then only the decoder can say
whether the data were complete when the next picture began.
"""

import re

import simplejpeg

MAX_BYTES = 16 << 20  # of one picture
_END_MARK = b"\xff\xd9"
_PIXELS_PER_BYTE = 256  # at the most: a block of 8x8 takes two bits
_START = b"\xff\xd8\xff"
_SOI, _EOI, _SOS = 0xD8, 0xD9, 0xDA
_OPAQUE = {0xFE, *range(0xE0, 0xF0)}  # comments and application data may hold anything
_TABLES = {0xC4, 0xCC, 0xDB, 0xDC, 0xDD, *_OPAQUE}
_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_IN_HEADER = _TABLES | _FRAMES | {_SOS, 0xDE, 0xDF}
_AFTER_SCAN = _TABLES | {_SOS}
# In a scan 0xFF is followed by 0 where it is data, by D0 to D7 at a restart, by itself as filling.
_MARK_IN_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


class Splitter:
    """Incremental; takes any bytes.

    counts: pictures, those of them without their end mark, torn (begun but not whole),
    bytes_skipped.
    """

    def __init__(self) -> None:
        self.counts = {"pictures": 0, "without_end": 0, "torn": 0, "bytes_skipped": 0}
        self._buffer = bytearray()  # begins with the picture while inside one
        self._begin(inside=False)

    def _begin(self, inside: bool) -> None:
        self._inside = inside
        self._at = 2  # where the next marker, or the rest of the scan, is expected
        self._last_segment = 2
        self._in_scan = self._has_frame = self._has_scan = False

    def feed(self, data: bytes) -> list[bytes]:
        """The pictures that `data` completes, in order."""
        self._buffer += data
        pictures: list[bytes] = []
        while self._advance(pictures):
            pass
        return pictures

    def finish(self) -> list[bytes]:
        """The stream ends, or is broken, here: what is begun is torn, or lacks its end mark only.

        Returns the latter, and the pictures that were taken for a part of a torn one. `feed` may
        follow.
        """
        pictures: list[bytes] = []
        while self._inside:
            if not self._end_here(len(self._buffer), pictures):
                self._tear(self._last_segment)
            pictures += self.feed(b"")
        self._skip(len(self._buffer))
        return pictures

    def _skip(self, count: int) -> None:
        self.counts["bytes_skipped"] += count
        del self._buffer[:count]
        self._begin(inside=False)

    def _tear(self, resume: int) -> bool:
        """Give this picture up, and look for another from `resume` on."""
        self.counts["torn"] += 1
        self._skip(resume)
        return True

    def _advance(self, pictures: list[bytes]) -> bool:
        """One step; False where it takes more bytes."""
        if not self._inside:
            return self._seek()
        if self._at > MAX_BYTES:
            return self._tear(self._last_segment)
        if self._in_scan:
            return self._cross_scan(pictures)
        return self._cross_segment(pictures)

    def _seek(self) -> bool:
        start = self._buffer.find(_START)
        found = start >= 0
        self._skip(start if found else max(0, len(self._buffer) - len(_START) + 1))
        self._begin(inside=found)
        return found

    def _cross_scan(self, pictures: list[bytes]) -> bool:
        mark = _MARK_IN_SCAN.search(self._buffer, self._at)
        if mark is None:
            self._at = max(self._at, len(self._buffer) - 1)
            return False
        self._at = mark.start()
        code = self._buffer[self._at + 1]
        if code == _EOI:
            return self._hand_out(pictures)
        if code not in _AFTER_SCAN:  # no start of a picture can lie before this mark
            return self._end_here(self._at, pictures) or self._tear(self._at)
        self._in_scan, self._last_segment = False, self._at
        return True

    def _cross_segment(self, pictures: list[bytes]) -> bool:
        buffer, at = self._buffer, self._at
        if at + 2 > len(buffer):
            return False
        code = buffer[at + 1]
        if buffer[at] == code == 0xFF:  # filling
            self._at += 1
            return True
        if buffer[at] == 0xFF and code in (_SOI, _EOI):
            if code == _EOI and self._has_scan:
                return self._hand_out(pictures)
            return self._end_here(at, pictures) or self._tear(at)
        if buffer[at] != 0xFF or code not in _IN_HEADER:
            # The last segment may be a torn one that swallowed the start of another picture. The
            # segments before it were followed by a marker, so a thumbnail in them stays hidden.
            return self._tear(self._last_segment)
        return self._enter_segment(code)

    def _enter_segment(self, code: int) -> bool:
        buffer, at = self._buffer, self._at
        length = int.from_bytes(buffer[at + 2 : at + 4], "big")
        end = at + 2 + length
        # Of tables and headers all is looked at, and a byte beyond: they are short.
        if len(buffer) < (at + 4 if code in _OPAQUE else max(at + 5, end + 1)):
            return False
        if not self._fits(code, length):
            return self._tear(self._last_segment)
        swallowed = -1 if code in _OPAQUE else buffer.find(_START, at, end + 1)
        if swallowed >= 0:
            return self._tear(swallowed)
        self._last_segment = at
        self._has_frame |= code in _FRAMES
        self._has_scan |= code == _SOS
        self._in_scan = code == _SOS
        self._at = end
        return True

    def _fits(self, code: int, length: int) -> bool:
        """Does a segment of this length make sense here? A short one's bytes are all there."""
        if code == _SOS:
            components = self._buffer[self._at + 4]
            return self._has_frame and 1 <= components <= 4 and length == 6 + 2 * components
        if code in _FRAMES:
            components = self._buffer[self._at + 9] if length > 8 else 0
            size = _size(self._buffer, self._at)
            return (
                not self._has_frame and min(*size, components) > 0 and length == 8 + 3 * components
            )
        return length >= 2

    def _hand_out(self, pictures: list[bytes]) -> bool:
        end = self._at + 2
        pictures.append(bytes(self._buffer[:end]))
        del self._buffer[:end]
        self.counts["pictures"] += 1
        self._begin(inside=False)
        return True

    def _end_here(self, end: int, pictures: list[bytes]) -> bool:
        """Hand the picture out with an end mark, if it is whole without what begins at `end`.

        Zeros behind the data are what fills a buffer up.
        """
        if not self._has_scan:
            return False
        data = bytes(self._buffer[:end]).rstrip(b"\0")
        jpeg = data + (b"\0" if data.endswith(b"\xff") else b"") + _END_MARK
        if not _is_complete(jpeg):
            return False
        pictures.append(jpeg)
        self.counts["pictures"] += 1
        self.counts["without_end"] += 1
        self.counts["bytes_skipped"] += end - (len(jpeg) - len(_END_MARK))
        del self._buffer[:end]
        self._begin(inside=False)
        return True


def _is_complete(jpeg: bytes) -> bool:
    """Are there as many data as the header says? To be asked where the end mark was missing."""
    width, height = size_of(jpeg)
    if width * height > _PIXELS_PER_BYTE * len(jpeg):
        return False
    try:
        simplejpeg.decode_jpeg(jpeg, "GRAY", min_width=1, min_height=1)
    except ValueError:
        return False
    return True


def size_of(jpeg: bytes) -> tuple[int, int]:
    """Width and height (px) of a picture that a `Splitter` handed out, from its header."""
    at = 2
    while jpeg[at + 1] not in _FRAMES:
        filling = jpeg[at + 1] == 0xFF
        at += 1 if filling else 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
    return _size(jpeg, at)


def _size(data: bytes | bytearray, at: int) -> tuple[int, int]:
    """Width and height of the frame header at `at`."""
    return (
        int.from_bytes(data[at + 7 : at + 9], "big"),
        int.from_bytes(data[at + 5 : at + 7], "big"),
    )
