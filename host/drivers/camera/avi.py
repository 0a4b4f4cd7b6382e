"""AVI files with JPEG pictures (RIFF, "Motion JPEG"): their rate and their pictures, in order."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

CODECS = (b"MJPG", b"mjpg", b"JPEG", b"jpeg")
_MAX_CHUNK = 16 << 20


@dataclass(frozen=True, slots=True)
class Video:
    """The video stream of a file. prefix: of its chunks' names. codec: four characters.

    period_s: between two pictures, 0 where the file does not say.
    """

    prefix: bytes
    codec: bytes
    period_s: float


def find_video(file: BinaryIO) -> Video | None:
    """The first video stream that the file's header names, None without one."""
    stream = -1
    period, is_video = 0.0, False
    for name, size in _chunks(file):
        if name == b"movi":
            break
        if name not in (b"strh", b"strf"):
            continue
        head = file.read(min(size, 64))
        if name == b"strh" and len(head) >= 28:
            stream += 1
            scale, rate = struct.unpack_from("<2I", head, 20)
            is_video = head[:4] == b"vids"
            period = scale / rate if scale and rate else 0.0
        elif name == b"strf" and is_video and len(head) >= 20:
            return Video(b"%02d" % stream, head[16:20], period)
    return None


def pictures_of(file: BinaryIO, video: Video) -> Iterator[bytes]:
    """What the file holds for each picture, in order; b"" where one was left out.

    A file that breaks off, or whose index was never written, gives what is there.
    """
    names = (video.prefix + b"dc", video.prefix + b"db")
    for name, size in _chunks(file):
        if name in names:
            yield file.read(size) if size <= _MAX_CHUNK else b""


def _chunks(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Name and size of each chunk, the file standing at its content.

    Lists are entered, not skipped; for each its type comes, with size 0: their own sizes are
    wrong where the recording was cut short.
    """
    at = 0
    while True:
        file.seek(at)
        head = file.read(8)
        if len(head) < 8:
            return
        name, size = struct.unpack("<4sI", head)
        if name in (b"RIFF", b"LIST"):
            yield file.read(4), 0
            at += 12
        else:
            yield name, size
            at += 8 + size + size % 2
