"""One camera, or its replacement: JPEG pictures with their times, and its Health."""

import math
import os
import stat
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from host.config import Camera
from host.drivers.camera.camera_errors import absent, explain_camera, is_video_device
from host.drivers.camera.controls import HELD, Controls
from host.drivers.camera.files import WAIT_S, CameraFrame, FrameSource, Pipe, RecordedFile
from host.drivers.camera.liveness import Liveness
from host.drivers.camera.mjpeg import size_of
from host.drivers.camera.usb import UsbCamera
from host.drivers.health import HealthReporter
from host.drivers.reconnect import keep_connected
from host.errors import UserError
from host.messages import Health

_HEALTH_PERIOD_S = 1.0
_EARLY = 0.25  # of a camera's period: a picture that comes so much before it is due is in time
TORN_SHARE = 0.1  # of the pictures; more of them damaged is a fault


@dataclass(frozen=True, slots=True)
class Picture:
    """A whole JPEG picture. time: of the exposure, host's monotonic s. sequence: counts from 0."""

    time: float
    jpeg: bytes
    sequence: int


class CameraDriver:
    """`run` it in its own thread.

    name: what Health calls it. camera: its source, size and rate. delay_s: from the exposure to the
    time stamp of a camera, or to the arrival where there is no stamp. mains_hz: of the lamps'
    mains. most_hz: what comes live more often is judged, but not emitted. clock: host time in s.
    """

    def __init__(
        self,
        name: str,
        camera: Camera,
        delay_s: float,
        mains_hz: int = 50,
        most_hz: float = math.inf,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._health = HealthReporter(name, clock, _HEALTH_PERIOD_S)
        self._camera = camera
        self._delay_s = delay_s
        self._apart_s = 1.0 / most_hz - _EARLY / camera.rate_hz
        self._due = -math.inf  # time stamp of the next picture that is emitted, at the earliest
        self._clock = clock
        self._controls = Controls(mains_hz)
        self._emit: Callable[[Picture | Health], None] = lambda message: None
        self._stop = threading.Event()
        self._counts = Counter(pictures=0, torn=0, wrong_size=0, connections=0)
        self._sequence = 0
        self._wrong: tuple[int, int] | None = None  # the size that the last picture has instead

    def run(self, emit: Callable[[Picture | Health], None], stop: threading.Event) -> None:
        """Emit every Picture, and Health once per second and at a change of state, until `stop`.

        Failures of the source are reported as Health and tried again; it raises only what is the
        program's own fault. Without a source ("none") it returns at once.
        """
        if self._camera.source == "none":
            return
        self._emit, self._stop = emit, stop
        keep_connected(self._serve, self._report_failure, stop)

    def _serve(self) -> None:
        """One connection: from opening the source to its loss or to the end."""
        source = open_source(self._camera, self._controls, self._clock)
        try:
            self._counts["connections"] += 1
            self._watch(source)
        finally:
            # What the source dropped is kept; what it cut out is not yet what was handed out.
            self._counts.update(_dropped(source))
            source.close()

    def _watch(self, source: FrameSource) -> None:
        """Hand out pictures and judge them, until `stop` is set. Raises UserError."""
        window = max(_HEALTH_PERIOD_S, 3.0 / self._camera.rate_hz)
        checked, before, torn = self._clock(), self._counts.copy(), 0
        self._liveness = Liveness(self._camera.rate_hz, self._counts)
        while not self._stop.is_set():
            with self._health.pace.within(WAIT_S):
                frame = source.read(self._stop)
            if frame is not None:
                self._hand_out(frame, source.live)
            now = self._clock()
            if now - checked < window:
                continue
            news = self._counts - before
            lost = source.counts["torn"] - torn
            self._report(*self._judge(source, news, lost, now - checked), source)
            checked, before, torn = now, self._counts.copy(), torn + lost

    def _hand_out(self, frame: CameraFrame, live: bool) -> None:
        size = size_of(frame.jpeg)
        self._wrong = None if size == (self._camera.width_px, self._camera.height_px) else size
        if self._wrong:
            self._counts["wrong_size"] += 1
            return
        if not self._liveness.is_new(frame.jpeg) and live:
            return
        self._counts["pictures"] += 1
        if live and self._due - self._apart_s <= frame.time < self._due:
            self._counts["not_needed"] += 1
            return
        self._due = frame.time + self._apart_s
        moment = frame.time - self._delay_s if live else frame.time
        self._emit(Picture(moment, frame.jpeg, self._sequence))
        self._sequence += 1

    def _judge(
        self, source: FrameSource, news: "Counter[str]", torn: int, seconds: float
    ) -> tuple[bool, str]:
        """Were the last `seconds` good, and why not? news, torn: what was counted in them."""
        pictures, camera = news["pictures"], self._camera
        if self._wrong:
            return False, (
                "its pictures are {}x{}, ".format(*self._wrong)
                + f"but robot.toml says {camera.width_px}x{camera.height_px}\n"
                "set width_px and height_px to what comes, and the lens for that size"
            )
        if not pictures and not news["repeated"]:
            self._liveness.pause()
            return False, str(source.why_silent())
        if torn > TORN_SHARE * (torn + pictures):
            return False, str(many_torn(torn / (torn + pictures)))
        sent = source.counts
        came = self._counts["pictures"] + sent["torn"] + sent.get("superseded", 0)
        fault = self._liveness.fault(self._clock(), came, source.why_slow if source.live else None)
        if fault is not None:
            return False, str(fault)
        rate = pictures / seconds
        how, said = f"{rate:.{0 if rate >= 3.0 else 1}f} pictures/s", source.remarks()
        if said == [HELD]:
            how, said = f"{how}, {HELD}", []
        return True, "; ".join([how, *said, *self._liveness.remarks()])

    def _report_failure(self, error: UserError) -> None:
        self._health.report(
            self._emit, False, str(error), lambda: self._all_counts(None), certain=True
        )

    def _report(self, ok: bool, reason: str, source: FrameSource) -> None:
        """Emit Health at a change of state and once per second."""
        self._health.report(self._emit, ok, reason, lambda: self._all_counts(source))

    def _all_counts(self, source: FrameSource | None) -> dict[str, int]:
        counts = self._counts + Counter(_dropped(source) if source else {})
        return {**self._counts, **counts}


def many_torn(share: float) -> UserError:
    """So large a share of a camera's pictures is damaged."""
    return UserError(
        f"{100 * share:.0f} % of the pictures arrive torn",
        "",
        "use a short cable, or a powered hub",
    )


def _dropped(source: FrameSource) -> dict[str, int]:
    """What a source counted of what it did not give."""
    return {name: count for name, count in source.counts.items() if name != "pictures"}


def open_source(camera: Camera, controls: Controls, clock: Callable[[], float]) -> FrameSource:
    """Open what `camera.source` names, found out by looking at it. Raises UserError."""
    path = camera.source
    try:
        mode = os.stat(path).st_mode
        if is_video_device(path):
            return UsbCamera(camera, controls, clock)
    except FileNotFoundError as error:
        if path.startswith("/dev/"):
            raise absent(path) from error
        raise UserError(
            f"there is no {path}", "", "check source: a camera, a pipe, or a file of pictures"
        ) from error
    except OSError as error:
        raise explain_camera(path, error) from error
    if stat.S_ISFIFO(mode):
        return Pipe(path, clock)
    if stat.S_ISREG(mode):
        return RecordedFile(path, camera.rate_hz, clock)
    raise UserError(
        f"{path} gives no pictures",
        "it is neither a camera nor a pipe nor a file",
        "check source in robot.toml; ls -l /dev/v4l/by-path lists the cameras",
    )
