"""Recording beside a run that must not wait for a disk, and that may be killed.

What is recorded is handed to a pipe in the thread that made it; from then on it is the kernel's. A
process of its own (`disk_process`) carries it to the disk.
"""

import array
import contextlib
import fcntl
import os
import select
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path
from typing import Self

from host.errors import UserError
from host.messages import Bearings, Message, Picture
from host.recording import disk_process
from host.recording.appended import created, unwritable
from host.recording.log import Recorder, RecordingHeader

PIPE_BYTES = 1 << 20  # some 25 s of a recording: a disk may take so long
_LEFT_BYTES = 1 << 20  # that the pipe had no room for; more, and the disk is too slow
_PICTURES_BYTES = 1 << 18  # waiting in the pipe: no pictures behind them
_CLOSE_S = 1.5  # to write what is left
_WORDS = 1000  # at most, of a failure


class BackgroundRecorder:
    """Records from any thread, and waits for no disk. A failure ends the recording.

    A recording that was given up has no end, so that its readers say so. pid: of the process that
    writes. Raises UserError where the file exists already or cannot be made.
    """

    def __init__(self, path: Path, header: RecordingHeader) -> None:
        self._file = BackgroundFile(path)
        self.pid = self._file.pid
        self._recorder = Recorder(path, header, self._file)
        self._lock = threading.Lock()
        self.failure: Exception | None = None  # that ended it

    def write(self, message: Message) -> None:
        """Record a message. Raises UserError where the recording has ended."""
        with self._lock:
            if self.failure is not None:
                raise self.failure
            try:
                self._recorder.write(message)
            except Exception as failure:
                self.failure = failure
                self._recorder.abandon()
                raise

    def picture(self, jpeg: bytes, found: Bearings) -> None:
        """Record the picture in which bearings were found; left out where the disk lags."""
        if self.failure is None and not self.leaves_out_pictures:
            self.write(Picture(found.time, found.camera, jpeg))

    @property
    def written(self) -> int:
        """How many bytes it has so far."""
        return self._file.tell()

    @property
    def waiting(self) -> int:
        """How many of them the disk is behind."""
        return self._file.waiting

    @property
    def leaves_out_pictures(self) -> bool:
        """Whether the disk is too far behind to record pictures, too."""
        return self.waiting >= _PICTURES_BYTES

    def close(self) -> None:
        """End the recording. Raises UserError where that fails."""
        with self._lock:
            if self.failure is None:
                self._recorder.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class BackgroundFile:
    """A file that another process writes. What lies between two calls of `whole` is written whole.

    pid: of that process, which holds the file's lock (flock) as long as it writes. Raises UserError
    where the file exists already or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = 0
        self._record = bytearray()  # not yet whole
        self._left = bytearray()  # of frames, for which the pipe had no room
        self._closed = False
        self.failed = False
        self._process = _started(path)
        self.pid = self._process.pid
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._pipe, self._words = self._process.stdin, self._process.stdout
        with contextlib.suppress(PermissionError):  # of this user's pipes, the system has a limit
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(self._pipe.fileno(), False)
        self._words.read(1)  # it is ready

    @property
    def waiting(self) -> int:
        """How many bytes the disk is behind."""
        in_pipe = array.array("i", [0])
        if not self._closed:
            fcntl.ioctl(self._pipe, termios.FIONREAD, in_pipe)
        return in_pipe[0] + len(self._left)

    def write(self, data: bytes) -> int:
        """Add to the record that is being made."""
        self._record += data
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        """How many bytes were written."""
        return self._size

    def flush(self) -> None:
        """Records go as soon as they are whole."""

    def whole(self) -> None:
        """Hand the record on. Raises UserError where the disk has failed, or is too slow."""
        self._left += disk_process.FRAME.pack(len(self._record)) + self._record
        self._record.clear()
        self._push()
        if len(self._left) > _LEFT_BYTES:
            waiting, self.failed = self.waiting, True
            self._left.clear()
            raise _too_slow(waiting)

    def _push(self) -> None:
        """Give the pipe what it has room for."""
        try:
            while self._left:
                del self._left[: os.write(self._pipe.fileno(), self._left)]
        except BlockingIOError:
            return
        except BrokenPipeError as error:
            self.failed = True
            self._left.clear()
            raise self._failure(self._words.read(_WORDS)) from error

    def _failure(self, words: bytes) -> UserError:
        return unwritable(self._path, words.decode() or "the process that writes it was killed")

    def close(self) -> None:
        """Let the other process write what is left. Raises UserError where it cannot, in time."""
        if self._closed:
            return
        self._closed = True
        end = time.monotonic() + (0.0 if self.failed else _CLOSE_S)
        with self._words:
            with self._pipe:
                while self._left and select.select([], [self._pipe], [], _until(end))[1]:
                    self._push()
            known, self.failed = self.failed, True
            try:
                self._process.wait(_until(end))
            except subprocess.TimeoutExpired:  # it goes on for as long as the disk takes
                threading.Thread(target=self._process.wait, name="recording", daemon=True).start()
                if not known:
                    raise _too_slow(len(self._left)) from None
            else:
                words = self._words.read(_WORDS)
                if not known and (words or self._process.returncode):
                    raise self._failure(words)


def _started(path: Path) -> subprocess.Popen[bytes]:
    """The process that writes a new file. Raises UserError, and leaves no file."""
    file = created(path)
    try:
        fcntl.flock(file, fcntl.LOCK_EX)
        # In a session of its own, Ctrl-C does not reach it.
        return subprocess.Popen(
            [sys.executable, "-I", "-S", disk_process.__file__, str(file)],
            pass_fds=(file,),
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
    except OSError as error:
        path.unlink()
        raise UserError(
            f"the recording {path} cannot begin",
            f"no process can be started to write it: {error.strerror}",
            "close other programs, then try again",
        ) from error
    finally:
        os.close(file)


def _until(end: float) -> float:
    return max(0.0, end - time.monotonic())


def _too_slow(waiting: int) -> UserError:
    return UserError(
        "the recording was ended: its disk is too slow",
        f"{waiting} bytes waited to be written",
        "record to another disk; what was written before can be replayed",
    )
