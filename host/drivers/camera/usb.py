"""A USB camera through OpenCV's V4L2 capture: its JPEG pictures as they are, the newest first."""

import os
import threading
from collections.abc import Callable

import cv2

from host.config import Camera
from host.drivers.camera.controls import Controls
from host.drivers.camera.files import CameraFrame
from host.drivers.camera.mjpeg import Splitter
from host.drivers.camera.v4l2_device import MJPG, why_no_pictures, wrong_size
from host.errors import UserError

SETTLE_S = 1.0  # for the camera's automatics, before they are locked
_AT_ONCE_S = 0.001  # a picture that came so soon had been waiting
_BUFFERS = 4  # that OpenCV has the kernel fill
_OLDEST_S = 1.0  # a picture whose time stamp is older bears another clock's
_FUTURE_S = 0.005
_TIMEOUT_S = 2  # for a picture; OpenCV's own is 10 s, too long for a program that is to end


def quieten() -> None:
    """Keep OpenCV's own warnings off the terminal: what matters of them is reported as Health."""
    if hasattr(cv2, "setLogLevel"):  # until 4.x
        cv2.setLogLevel(0)
    elif hasattr(cv2, "utils"):
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class Capture:
    """cv2.VideoCapture as far as a camera is concerned. What fails returns False or nothing."""

    def __init__(self, path: str) -> None:
        """Open the device at `path`."""
        quieten()
        os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", str(_TIMEOUT_S))
        self._capture = cv2.VideoCapture(path, cv2.CAP_V4L2)

    @property
    def opened(self) -> bool:
        """Is the device there and fit for pictures?"""
        return self._capture.isOpened()

    def get(self, control: int) -> float:
        """The value of a control or setting, -1 where there is none."""
        return self._capture.get(control)

    def set(self, control: int, value: float) -> bool:
        """Set it; False where the camera refuses."""
        try:
            return self._capture.set(control, value)
        except cv2.error:
            return False

    def grab(self) -> bool:
        """Wait for the next picture; False where none comes within 2 s or the camera is gone."""
        try:
            return self._capture.grab()
        except cv2.error:  # what the driver reported of its buffers made no sense
            return False

    def retrieve(self) -> bytes:
        """The bytes of the picture that was grabbed."""
        try:
            done, picture = self._capture.retrieve()
        except cv2.error:
            return b""
        return picture.tobytes() if done and picture is not None else b""

    def close(self) -> None:
        """Let go of the device."""
        self._capture.release()


class UsbCamera:
    """One camera, opened. camera: its source, size and rate. controls: outlive replugging."""

    live = True

    def __init__(self, camera: Camera, controls: Controls, clock: Callable[[], float]) -> None:
        """Raises UserError where the camera gives no pictures of that size."""
        self._camera = camera
        self._clock = clock
        self._controls = controls
        self._remarks: list[str] = []
        self._locked = False
        self._splitter = Splitter()
        self._superseded = self._bad_stamps = 0
        self._stamp = 0.0
        self._stamps_true = True
        self._capture = Capture(camera.source)
        self._opened_at = clock()
        self._set_up()

    def _set_up(self) -> None:
        """Ask for JPEG pictures of the right size, undecoded."""
        capture, camera = self._capture, self._camera
        if not capture.opened:
            raise self._fail()
        capture.set(cv2.CAP_PROP_FOURCC, MJPG)
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.width_px)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.height_px)
        capture.set(cv2.CAP_PROP_FPS, camera.rate_hz)
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        if int(capture.get(cv2.CAP_PROP_FOURCC)) != MJPG:
            raise self._fail()
        width = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
        height = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if (width, height) != (camera.width_px, camera.height_px):
            capture.close()
            raise wrong_size(camera.source, width, height, camera.width_px, camera.height_px)
        rate_hz = capture.get(cv2.CAP_PROP_FPS)
        self._period = 1.0 / (rate_hz if rate_hz > 0.0 else camera.rate_hz)

    def _fail(self) -> UserError:
        """Close the camera and find out what is wrong with it."""
        self._capture.close()
        return why_no_pictures(self._camera.source, self._camera.width_px, self._camera.height_px)

    @property
    def counts(self) -> dict[str, int]:
        """Those of the splitter, pictures not the newest, pictures with useless time stamps."""
        return {
            **self._splitter.counts,
            "superseded": self._superseded,
            "bad_stamps": self._bad_stamps,
        }

    def read(self, stop: threading.Event) -> CameraFrame | None:
        """The newest picture, with the kernel's time stamp where that is the host's time."""
        time = self._grab_newest(stop)
        jpeg = self._splitter.feed(self._capture.retrieve()) + self._splitter.finish()
        if not self._locked and (
            self._controls.known or self._clock() - self._opened_at > SETTLE_S
        ):
            self._locked = True
            self._remarks = self._controls.lock(self._capture)
        return CameraFrame(jpeg[0], time) if jpeg else None

    def _grab_newest(self, stop: threading.Event) -> float:
        """Grab pictures until one had to be waited for or is too young for a successor."""
        for attempt in range(_BUFFERS + 1):
            asked = self._clock()
            if not self._capture.grab():
                raise self._fail()
            arrived = self._clock()
            time = self._time_of(arrived)
            waited = arrived - asked > _AT_ONCE_S
            young = self._stamps_true and arrived - time < self._period
            if waited or young or stop.is_set() or attempt == _BUFFERS:
                break
            self._superseded += 1
        return time

    def _time_of(self, arrived: float) -> float:
        """The picture's time stamp, or its arrival where the stamp cannot be true."""
        before, stamp = self._stamp, self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
        self._stamp = stamp
        self._stamps_true = stamp > before and -_FUTURE_S <= arrived - stamp <= _OLDEST_S
        self._bad_stamps += not self._stamps_true
        return stamp if self._stamps_true else arrived

    def remarks(self) -> list[str]:
        """Whether its controls are held, and its time stamps of use."""
        held = ["exposure, white balance and gain held"] if self._locked else []
        stamps = [] if self._stamps_true else ["its time stamps are of no use: arrival counts"]
        return stamps + (self._remarks or held)

    def why_silent(self) -> UserError:
        """What comes is no pictures."""
        return UserError(
            f"{self._camera.source} gives no whole pictures",
            "its bytes come, but damaged: the cable is poor, or the hub too weak",
            "use a short cable, or a hub with a supply of its own",
        )

    def close(self) -> None:
        """Leave the camera as it was found."""
        self._controls.release(self._capture)
        self._capture.close()
