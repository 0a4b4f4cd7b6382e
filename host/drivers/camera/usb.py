"""A USB camera (V4L2): its JPEG pictures as they are, the newest first."""

import contextlib
import errno
import os
import threading
from collections.abc import Callable

from host.config import Camera
from host.drivers.camera.camera_errors import (
    absent,
    explain_camera,
    second_device,
    silent,
    wrong_format,
    wrong_size,
)
from host.drivers.camera.controls import Controls
from host.drivers.camera.files import WAIT_S, CameraFrame
from host.drivers.camera.mjpeg import Splitter
from host.drivers.camera.v4l2_device import MJPG, Buffer, VideoDevice
from host.drivers.pace import Pace
from host.errors import UserError

_OLDEST_S = 1.0  # a picture whose time stamp is older bears another clock's
_FUTURE_S = 0.005
_SILENT_S = 2.0  # without a picture: the camera hangs
_SLOW = 0.9  # of the rate that was asked for
_MANY_LOST = 0.2  # of the pictures


class UsbCamera:
    """One camera, opened. camera: its source, size and rate. controls: outlive replugging."""

    live = True

    def __init__(self, camera: Camera, controls: Controls, clock: Callable[[], float]) -> None:
        """Raises UserError where the camera gives no pictures of that size."""
        self._camera = camera
        self._clock = clock
        self._pace = Pace(clock)
        self._controls = controls
        self._splitter = Splitter()
        self._superseded = self._bad_stamps = self._damaged = self._missed = 0
        self._stamp = 0.0
        self._stamps_true = True
        self._number: int | None = None  # of the last picture, in the driver's count
        self._seen = (0, 0)  # missed, number, when it was last asked why it is slow
        self._settled = False
        try:
            self._device = VideoDevice(camera.source)
        except OSError as error:
            raise explain_camera(camera.source, error) from error
        with contextlib.ExitStack() as on_failure:
            on_failure.callback(self.close)
            try:
                self._set_up()
            except OSError as error:
                raise self._lost(error) from error
            on_failure.pop_all()

    def _set_up(self) -> None:
        """Ask for JPEG pictures of the right size, set the controls, start."""
        device, camera = self._device, self._camera
        if not device.can_capture():
            raise second_device(camera.source)
        wanted = (camera.width_px, camera.height_px)
        code, size = device.set_format(*wanted)
        if code != MJPG:
            raise wrong_format(camera.source, code)
        if size != wanted:
            raise wrong_size(camera.source, size, wanted, device.sizes())
        self._rate_hz = device.set_rate(camera.rate_hz) or camera.rate_hz
        self._controls.begin(device)
        device.start()

    def _lost(self, error: OSError) -> UserError:
        """What it means that the kernel refuses something of an opened camera."""
        gone = error.errno in (errno.EIO, errno.EINVAL) and not os.path.exists(self._camera.source)
        return absent(self._camera.source) if gone else explain_camera(self._camera.source, error)

    @property
    def counts(self) -> dict[str, int]:
        """Those of the splitter, and what was not handed out or is uncertain.

        torn: of them the pictures that the driver calls damaged, too. missed: by the driver's
        numbers, lost before they came here. superseded: not the newest. bad_stamps: of no use.
        """
        counts = self._splitter.counts
        return {
            **counts,
            "torn": counts["torn"] + self._damaged,
            "missed": self._missed,
            "superseded": self._superseded,
            "bad_stamps": self._bad_stamps,
        }

    def read(self, stop: threading.Event) -> CameraFrame | None:
        """The newest picture, with the kernel's time stamp where that is the host's time.

        None while exposure and white balance are still being set.
        """
        try:
            with self._pace.within(WAIT_S):
                newest = self._newest() if self._device.wait(WAIT_S) else None
            if newest is None:
                if self._pace.silent_s > _SILENT_S:
                    raise silent(self._camera.source)
                return None
            time = self._time_of(newest, self._clock())
            pictures = self._splitter.feed(newest.data) + self._splitter.finish()
            if not pictures:
                return None
            self._superseded += len(pictures) - 1
            self._settled = self._controls.advance(self._device, pictures[-1])
        except OSError as error:
            raise self._lost(error) from error
        return CameraFrame(pictures[-1], time) if self._settled else None

    def _newest(self) -> Buffer | None:
        """The last of the buffers that wait, damaged ones apart."""
        newest = None
        while (buffer := self._device.take()) is not None:
            self._pace.heard()
            if self._number is not None:
                self._missed += max(buffer.sequence - self._number - 1, 0)
            self._number = buffer.sequence
            if buffer.damaged:
                self._damaged += 1
                continue
            self._superseded += newest is not None
            newest = buffer
        return newest

    def _time_of(self, buffer: Buffer, arrived: float) -> float:
        """The picture's time stamp, or its arrival where the stamp cannot be true."""
        before, self._stamp = self._stamp, buffer.time
        self._stamps_true = (
            self._stamp > before and -_FUTURE_S <= arrived - self._stamp <= _OLDEST_S
        )
        self._bad_stamps += not self._stamps_true
        return self._stamp if self._stamps_true else arrived

    def remarks(self) -> list[str]:
        """Whether its controls are held, and its time stamps of use."""
        stamps = [] if self._stamps_true else ["its time stamps are unusable: the arrival is used"]
        try:
            return stamps + self._controls.check(self._device)
        except OSError as error:
            raise self._lost(error) from error

    def why_silent(self) -> UserError:
        """What comes is no pictures, or none that are to be used yet."""
        if not self._settled and self._splitter.counts["pictures"]:
            return UserError(
                f"{self._camera.source} sets its exposure and white balance",
                "",
                "this takes some seconds",
            )
        return UserError(
            f"{self._camera.source} gives no whole pictures",
            "its bytes come, but damaged: the cable is poor, or the hub too weak",
            "use a short cable, or a powered hub",
        )

    def why_slow(self) -> tuple[str, str]:
        """Why it gives fewer pictures than asked for, and what to do; "" where nothing says so."""
        exposure_s = self._controls.exposure_s(self._device)
        if exposure_s is not None and exposure_s > _SLOW / self._camera.rate_hz:
            return (
                f"the light is too dim for this exposure: it takes {1e3 * exposure_s:.0f} ms",
                "switch on more light",
            )
        if self._controls.exposure_is_automatic:
            return (
                "the camera keeps its exposure automatic: it lengthens it in dim light",
                "switch on more light",
            )
        lost, given = self._missed - self._seen[0], (self._number or 0) - self._seen[1]
        self._seen = self._missed, self._number or 0
        if lost > _MANY_LOST * given:
            return (
                f"{100 * lost / given:.0f} % are lost before they come here",
                "close other programs; plug it into another port, without a hub",
            )
        if self._rate_hz < _SLOW * self._camera.rate_hz:
            return (
                f"at this size the camera gives {self._rate_hz:.0f} a second",
                "set rate_hz to that, or another size (v4l2-ctl --list-formats-ext)",
            )
        return "", ""

    def close(self) -> None:
        """Leave the camera as it was found."""
        self._controls.release(self._device)
        self._device.close()
