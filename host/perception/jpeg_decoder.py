"""JPEG → a quarter of its size in colour, fast, and only where the picture is whole.

At a quarter of the size libjpeg scales brightness and colour each in its own inverse transform, so
that a webcam's picture, whose colour is stored at half size, loses none of the colour it has: what
a strip is found by. A picture cut short is noticed by its end, by its markers and by the decoder.
"""

import ctypes
import ctypes.util
import re
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from host.messages import Image

SCALE = 4  # pixels of the picture in one pixel of the reduced one, along a side
_LEAST_BITS = 2  # of an 8x8 block: one code for its mean, one for the end of the block
_END, _SCAN, _RESTART_INTERVAL = 0xD9, 0xDA, 0xDD
_SEQUENTIAL = (0xC0, 0xC1)
_FRAMES = (*_SEQUENTIAL, 0xC2)
_BGR = 1  # turbojpeg.h: TJPF_BGR
_REST_UNREAD = re.compile(rb"Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd[0-79]")


class UnusableError(Exception):
    """A picture that is not used; its text is the reason under which it is counted."""


@dataclass(frozen=True, slots=True)
class JpegHeader:
    """What stands before the picture's data.

    width, height px; height_at: where the height is written; unit (width, height) px: what is
    coded together; blocks: 8x8 blocks in a unit; scan: where the data begin; restart: units
    between two restart markers, 0 without; plain: sequential, all of it in one scan.
    """

    width: int
    height: int
    height_at: int
    unit: tuple[int, int]
    blocks: int
    scan: int
    restart: int
    plain: bool

    def units(self, height: int) -> int:
        """Coded units in the uppermost `height` rows."""
        return -(-self.width // self.unit[0]) * -(-height // self.unit[1])


def read_header(jpeg: bytes) -> JpegHeader:
    """Read the segments (ITU T.81 annex B) up to the first scan. Raises UnusableError."""
    if jpeg[:2] != b"\xff\xd8":
        raise UnusableError("not_jpeg")
    frame = height_at = kind = None
    restart, place = 0, 2
    while place + 4 <= len(jpeg):
        marker, size = jpeg[place + 1], int.from_bytes(jpeg[place + 2 : place + 4], "big")
        segment = jpeg[place + 4 : place + 2 + size]
        if jpeg[place] != 0xFF or size < 2 or len(segment) != size - 2:
            break
        if marker in _FRAMES and frame is None and len(segment) >= 6:
            frame, height_at, kind = segment, place + 5, marker
        elif marker == _RESTART_INTERVAL and size == 4:
            restart = int.from_bytes(segment, "big")
        elif marker == _SCAN and segment and frame is not None and height_at is not None:
            plain = kind in _SEQUENTIAL and segment[0] == frame[5]
            return _header(frame, height_at, place + 2 + size, restart, plain)
        place += 2 + size
    raise UnusableError("torn")


def _header(frame: bytes, height_at: int, scan: int, restart: int, plain: bool) -> JpegHeader:
    count = frame[5]
    factors = frame[7 : 6 + 3 * count : 3]
    if (
        count not in (1, 3)
        or len(frame) != 6 + 3 * count
        or any(not (1 <= factor >> 4 <= 4 and 1 <= factor & 15 <= 4) for factor in factors)
    ):
        raise UnusableError("torn")
    # A single component is coded block by block, whatever its factors say.
    sampling = [(f >> 4, f & 15) for f in factors] if count == 3 else [(1, 1)]
    return JpegHeader(
        width=int.from_bytes(frame[3:5], "big"),
        height=int.from_bytes(frame[1:3], "big"),
        height_at=height_at,
        unit=(8 * max(h for h, _ in sampling), 8 * max(v for _, v in sampling)),
        blocks=sum(h * v for h, v in sampling),
        scan=scan,
        restart=restart,
        plain=plain,
    )


def check_whole(jpeg: bytes, header: JpegHeader) -> bytes:
    """The picture without the zeros that drivers leave behind it. Raises UnusableError.

    The last marker is the picture's end, and it stands at the end; between it and the header are
    no markers, but for restart markers in their order and number where there are any. A gap in
    the data of a picture without restart markers is not noticed by this.
    """
    jpeg = jpeg.rstrip(b"\0") if jpeg.endswith(b"\0") else jpeg
    if not jpeg.endswith(bytes((0xFF, _END))) or len(jpeg) <= header.scan:
        raise UnusableError("torn")
    if not header.plain:
        return jpeg
    data = np.frombuffer(jpeg, dtype=np.uint8, offset=header.scan)
    after = data[np.flatnonzero(data[:-1] == 0xFF) + 1]
    markers = after[(after != 0) & (after != 0xFF)]
    restarts = (header.units(header.height) - 1) // header.restart if header.restart else 0
    expected = np.append(0xD0 + np.arange(restarts) % 8, _END)
    if not np.array_equal(markers, expected):
        raise UnusableError("torn")
    return jpeg


class JpegDecoder(Protocol):
    """Makes the reduced picture."""

    def decode(self, jpeg: bytes, size: tuple[int, int], rows: int) -> Image:
        """The uppermost `rows` of a picture of `size` (width, height), reduced: (r, w, 3) BGR.

        r and w are rows and width by SCALE. Raises UnusableError with the reason: not_jpeg, torn,
        wrong_size.
        """


def _checked(jpeg: bytes, size: tuple[int, int]) -> tuple[bytes, JpegHeader]:
    header = read_header(jpeg)
    if (header.width, header.height) != size:
        raise UnusableError("wrong_size")
    return check_whole(jpeg, header), header


class OpenCvDecoder:
    """By OpenCV alone: the whole picture is decoded, its warnings are not to be had."""

    def decode(self, jpeg: bytes, size: tuple[int, int], rows: int) -> Image:
        """See `JpegDecoder`."""
        jpeg, _ = _checked(jpeg, size)
        flags = cv2.IMREAD_REDUCED_COLOR_4 | cv2.IMREAD_IGNORE_ORIENTATION
        try:
            picture = cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), flags)
        except cv2.error as error:
            raise UnusableError("torn") from error
        if picture is None or picture.shape[:2] != (-(-size[1] // SCALE), -(-size[0] // SCALE)):
            raise UnusableError("torn")
        return np.asarray(picture[: -(-rows // SCALE)], dtype=np.uint8)


class TurboDecoder:
    """By libturbojpeg: rows below those asked for are not decoded. For one thread.

    Raises OSError where the library is not installed. Its functions are called here and not
    through a package, because the warnings have to be read: the first says whether the rows
    asked for were whole.
    """

    def __init__(self) -> None:
        library = ctypes.CDLL(ctypes.util.find_library("turbojpeg") or "libturbojpeg.so.0")
        try:
            library.tjInitDecompress.restype = ctypes.c_void_p
            library.tjDestroy.argtypes = [ctypes.c_void_p]
            self._decompress, self._error = library.tjDecompress2, library.tjGetErrorStr2
        except AttributeError as error:
            raise OSError("libturbojpeg is older than 2.0") from error
        self._decompress.argtypes = [
            ctypes.c_void_p, ctypes.c_char_p, ctypes.c_ulong, ctypes.c_void_p,
            *[ctypes.c_int] * 5,
        ]  # fmt: skip
        self._error.argtypes, self._error.restype = [ctypes.c_void_p], ctypes.c_char_p
        self._destroy = library.tjDestroy
        self._handle = library.tjInitDecompress()
        if not self._handle:
            raise OSError("libturbojpeg does not start")

    def __del__(self) -> None:
        if getattr(self, "_handle", None):
            self._destroy(self._handle)

    def decode(self, jpeg: bytes, size: tuple[int, int], rows: int) -> Image:
        """See `JpegDecoder`."""
        jpeg, header = _checked(jpeg, size)
        # A smaller height in the header: the decoder stops there, the rows above are the same.
        height = min(-(-rows // header.unit[1]) * header.unit[1], header.height)
        height = height if header.plain else header.height
        at = header.height_at
        short = jpeg[:at] + height.to_bytes(2, "big") + jpeg[at + 2 :]
        picture = np.empty((-(-height // SCALE), -(-size[0] // SCALE), 3), dtype=np.uint8)
        failed = self._decompress(
            self._handle, short, len(short), picture.ctypes.data,
            picture.shape[1], 0, picture.shape[0], _BGR, 0,
        )  # fmt: skip
        message = self._error(self._handle) if failed else b""
        if height == header.height:
            if failed:
                raise UnusableError("torn")
        else:
            _check_rest(message, header, height)
        return picture[: -(-rows // SCALE)]


def _check_rest(message: bytes, header: JpegHeader, height: int) -> None:
    """Raise UnusableError unless the decoder's first warning is that the lower rows were not read.

    And that they are at least as many bytes as so many rows must have.
    """
    rest = _REST_UNREAD.fullmatch(message)
    if rest is None:
        raise UnusableError("torn")
    blocks = (header.units(header.height) - header.units(height)) * header.blocks
    if not header.restart and 8 * int(rest[1]) < _LEAST_BITS * blocks - 8:
        raise UnusableError("torn")


def fastest_decoder() -> JpegDecoder:
    """By libturbojpeg where it is installed, else by OpenCV."""
    try:
        return TurboDecoder()
    except OSError:
        return OpenCvDecoder()
