"""Where pictures come from when it is not a camera: an MJPEG file, an AVI file, a named pipe."""

import contextlib
import os
import select
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

from host.drivers.camera import avi
from host.drivers.camera.mjpeg import Splitter
from host.errors import UserError

WAIT_S = 0.1  # a source looks at `stop` so often
_CHUNK = 1 << 18
_SLOWEST_S, _FASTEST_S = 10.0, 0.002  # periods that a file may ask for


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """A whole JPEG picture, and the host's monotonic time (s) that its source gives it."""

    jpeg: bytes
    time: float


class FrameSource(Protocol):
    """Something that gives pictures. live: they come from a camera as they are taken."""

    live: bool

    @property
    def counts(self) -> dict[str, int]:
        """What was dropped, by name; what was whole as "pictures"."""

    def read(self, stop: threading.Event) -> CameraFrame | None:
        """The next picture, or None after some WAIT_S without one or when `stop` is set.

        Raises UserError where the source has to be opened again.
        """

    def remarks(self) -> list[str]:
        """What the user should know although pictures come."""

    def why_silent(self) -> UserError:
        """Why no pictures come."""

    def why_slow(self) -> tuple[str, str]:
        """Why fewer come than expected, and what to do; "" where nothing says so."""

    def close(self) -> None:
        """Let go of it."""


class RecordedFile:
    """Pictures of a file, each when its time has come; it is played once.

    Their times are those at which they are due, on `clock`.
    """

    live = False

    def __init__(self, path: str, rate_hz: float, clock: Callable[[], float]) -> None:
        """An AVI file has its own rate; `rate_hz` is for all others. Raises UserError."""
        self._path = path
        self._clock = clock
        self._splitter = Splitter()
        self._period = 1.0 / rate_hz
        self._start = 0.0
        self._turn = 0
        self._over = False
        with contextlib.ExitStack() as opened:
            try:
                file = opened.enter_context(Path(path).open("rb"))
                self._pictures = self._look(file)
            except OSError as error:
                raise UserError(f"cannot read {path}", error.strerror or str(error)) from error
            self._open = opened.pop_all()

    @property
    def counts(self) -> dict[str, int]:
        """Those of the splitter."""
        return self._splitter.counts

    def _look(self, file: BinaryIO) -> Iterator[bytes]:
        """Find out what the file is by its first bytes."""
        head = file.read(12)
        if head[:4] == b"RIFF" and head[8:] == b"AVI ":
            return self._avi(file)
        if head[:2] == b"\xff\xd8":
            return self._mjpeg(file)
        raise UserError(
            f"{self._path} holds no pictures that can be played",
            "it is empty" if not head else "it is neither JPEG pictures in a row nor an AVI",
            f"convert it: ffmpeg -i {self._path} -c:v mjpeg -q:v 3 pictures.avi",
        )

    def _avi(self, file: BinaryIO) -> Iterator[bytes]:
        video = avi.find_video(file)
        if video is None or video.codec not in avi.CODECS:
            codec = "nothing" if video is None else video.codec.decode("ascii", "replace")
            raise UserError(
                f"{self._path} holds no JPEG pictures",
                f"its video is {codec}, not MJPG",
                f"convert it: ffmpeg -i {self._path} -c:v mjpeg -q:v 3 pictures.avi",
            )
        if _FASTEST_S <= video.period_s <= _SLOWEST_S:
            self._period = video.period_s
        return (self._whole(data) for data in avi.pictures_of(file, video))

    def _whole(self, data: bytes) -> bytes:
        found = self._splitter.feed(data) + self._splitter.finish()
        return found[-1] if found else b""

    def _mjpeg(self, file: BinaryIO) -> Iterator[bytes]:
        file.seek(0)
        while data := file.read(_CHUNK):
            yield from self._splitter.feed(data)
        yield from self._splitter.finish()

    def read(self, stop: threading.Event) -> CameraFrame | None:
        """The next picture when it is due."""
        if not self._turn:
            self._start = self._clock()
        due = self._start + self._turn * self._period
        wait = WAIT_S if self._over else due - self._clock()
        if wait > 0.0:
            stop.wait(min(wait, WAIT_S))
        if self._over or self._clock() < due:
            return None
        try:
            jpeg = next(self._pictures, None)
        except OSError as error:
            raise UserError(f"cannot read {self._path}", error.strerror or str(error)) from error
        self._over = jpeg is None
        self._turn += 1
        return CameraFrame(jpeg, due) if jpeg else None

    def remarks(self) -> list[str]:
        """That it is no camera."""
        return [f"played from {self._path}"]

    def why_silent(self) -> UserError:
        """It is over, or holds nothing whole."""
        if self._over:
            return UserError(
                f"{self._path} is played to its end", "", "start again to see it again"
            )
        return UserError(f"{self._path} holds no whole pictures here")

    def why_slow(self) -> tuple[str, str]:
        """It has its own rate."""
        return "", ""

    def close(self) -> None:
        """Close the file."""
        self._open.close()


class Pipe:
    """A named pipe into which another program writes pictures in a row, as they are taken.

    Where several have come at once, the newest is taken.
    """

    live = True

    def __init__(self, path: str, clock: Callable[[], float]) -> None:
        """Open it; a writer need not be there yet. Raises UserError."""
        self._path = path
        self._clock = clock
        self._splitter = Splitter()
        self._superseded = 0
        self._has_writer = False
        self._arrived = clock()  # the last data
        try:
            self._pipe = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise UserError(f"cannot open {path}", error.strerror or str(error)) from error

    @property
    def counts(self) -> dict[str, int]:
        """Those of the splitter, and pictures that were not the newest."""
        return {**self._splitter.counts, "superseded": self._superseded}

    def read(self, stop: threading.Event) -> CameraFrame | None:
        """The newest picture of what has come."""
        ready, _, _ = select.select([self._pipe], [], [], WAIT_S)
        if not ready:
            return None
        data = self._take()
        if data == b"":
            self._lose_writer()
            stop.wait(WAIT_S)
        if not data:
            return None
        self._has_writer = True
        before, self._arrived = self._arrived, self._clock()
        endless = self._splitter.counts["without_end"]
        pictures = self._splitter.feed(data)
        if not pictures:
            return None
        self._superseded += len(pictures) - 1
        # Without its end mark a picture is known only when the next begins, a period later.
        late = self._splitter.counts["without_end"] > endless
        return CameraFrame(pictures[-1], before if late else self._arrived)

    def _take(self) -> bytes | None:
        """What has come; b"" where there is no writer, None where it has written nothing."""
        try:
            return os.read(self._pipe, _CHUNK)
        except BlockingIOError:
            return None
        except OSError as error:
            raise UserError(f"cannot read {self._path}", error.strerror or str(error)) from error

    def _lose_writer(self) -> None:
        if self._has_writer:
            self._splitter.finish()  # what it may find in the remains is old
        self._has_writer = False
        try:
            replaced = not os.path.samestat(os.stat(self._path), os.fstat(self._pipe))
        except OSError:
            replaced = True
        if replaced:
            raise UserError(f"the pipe {self._path} was removed", "", f"mkfifo {self._path}")

    def remarks(self) -> list[str]:
        """None."""
        return []

    def why_silent(self) -> UserError:
        """No writer, or one that writes no pictures."""
        if not self._has_writer:
            return UserError(
                f"no program writes into {self._path}",
                "",
                "start the one that should; it is waited for",
            )
        return UserError(
            f"the program that writes into {self._path} sends no pictures",
            "it sends nothing, or no JPEG",
            "let it write JPEG pictures in a row, as ffmpeg does with -c:v mjpeg -f mjpeg",
        )

    def why_slow(self) -> tuple[str, str]:
        """It is not known why a program writes fewer."""
        return (
            "",
            "let the program that writes into the pipe send more, or set rate_hz to what comes",
        )

    def close(self) -> None:
        """Close this end."""
        os.close(self._pipe)
