"""Whether recordings have a place: room, and a disk that is fast, by a few megabytes written."""

import errno
import itertools
import os
import tempfile
import time
from pathlib import Path

from host.doctor.findings import Finding, Level, failed
from host.errors import UserError
from host.sources.recording import DELETE, OTHER_DISK, room

PART = "disk"
_PIECE, _PIECES = bytes(1 << 20), 8
_SLOW, _TOO_SLOW = 4e6, 4e5  # bytes/s; a run with mocap and bearings records some 30 kB/s
_LONG_S = 2.0  # of one flush: the queue of messages lasts 3 s


def findings(folder: Path) -> list[Finding]:
    """Of its speed, and of its room where there is little."""
    full, little = room(folder)
    if full is not None:
        return [failed(PART, full)]
    remarks = [Finding(PART, Level.WARN, *remark.rsplit(": ", 1)) for remark in little]
    return [measure(folder), *remarks]


def measure(folder: Path) -> Finding:
    """Write a file that is gone afterwards, flushed to the disk piece by piece."""
    try:
        longest, seconds = _write(folder)
    except OSError as error:
        step = "start swarmloc in a folder that can be written, or name one: --record FILE"
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            step = DELETE
        why = error.strerror or str(error)
        return failed(PART, UserError(f"nothing can be recorded in {folder.absolute()}", why, step))
    rate = len(_PIECE) * _PIECES / seconds
    what = f"writes {rate / 1e6:.3g} MB/s, at most {longest:.2f} s for 1 MB, to {folder.absolute()}"
    if rate < _TOO_SLOW or longest > _LONG_S:
        return Finding(PART, Level.FAIL, f"too slow to record: it {what}", OTHER_DISK)
    if rate < _SLOW:
        return Finding(PART, Level.WARN, f"slow: it {what}", OTHER_DISK)
    return Finding(PART, Level.OK, what)


def _write(folder: Path) -> tuple[float, float]:
    """The longest time (s) of a piece, and the whole time."""
    times = [time.monotonic()]
    with tempfile.TemporaryFile(dir=folder) as file:
        for _ in range(_PIECES):
            file.write(_PIECE)
            file.flush()
            os.fsync(file.fileno())
            times.append(time.monotonic())
            if times[-1] - times[0] > 2.0 * _LONG_S:  # it is known to be slow by now
                break
    pieces = len(times) - 1
    longest = max(after - before for before, after in itertools.pairwise(times))
    return longest, max((times[-1] - times[0]) * _PIECES / pieces, 1e-9)
