"""Writes what comes by its standard input to a file: its own process, which outlives the run.

It may wait for a slow disk as long as that takes, and it writes what was handed to it even where
the run is killed. Started as a script; it needs nothing but Python's own library.
"""

import contextlib
import os
import select
import signal
import struct
import sys
import time

SYNC_S = 1.0
FRAME = struct.Struct("<I")  # the length of what follows, which is written whole or not at all
_READ_BYTES = 1 << 16


def copy(pipe: int, file: int) -> None:
    """Append each frame until the pipe ends; whatever is older than SYNC_S survives a power cut.

    Raises OSError where the file cannot be written; it is then cut to whole frames.
    """
    waiting = bytearray()
    written, synced = 0, time.monotonic()
    open_ = True
    while open_:
        if select.select([pipe], [], [], SYNC_S)[0]:
            received = os.read(pipe, _READ_BYTES)
            open_ = bool(received)
            waiting += received
            written += append(file, take_frames(waiting), written)
        if time.monotonic() >= synced + SYNC_S:
            os.fsync(file)
            synced = time.monotonic()
    os.fsync(file)


def take_frames(waiting: bytearray) -> bytes:
    """The content of the whole frames at the front of `waiting`, from which they are taken."""
    content = bytearray()
    place = 0
    while len(waiting) >= place + FRAME.size:
        (length,) = FRAME.unpack_from(waiting, place)
        if len(waiting) < place + FRAME.size + length:
            break
        content += waiting[place + FRAME.size : place + FRAME.size + length]
        place += FRAME.size + length
    del waiting[:place]
    return bytes(content)


def append(file: int, content: bytes, whole: int) -> int:
    """Write all of `content` and return its length; where that fails, cut the file to `whole`."""
    left = memoryview(content)
    try:
        while left:
            left = left[os.write(file, left) :]
    except OSError:
        os.ftruncate(file, whole)
        raise
    return len(content)


def main() -> None:
    """Argument: the file's descriptor. The output is a byte, once SIGTERM is ignored, and why it
    failed.
    """
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the pipe's end ends it
    report("\n")
    try:
        copy(sys.stdin.fileno(), int(sys.argv[1]))
    except OSError as error:
        report(error.strerror or str(error))


def report(words: str) -> None:
    """Say something to the run, if it is still there."""
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), words.encode())


if __name__ == "__main__":
    main()
