"""A camera behind the kernel's ioctls: controls, buffers, pictures that follow light and exposure.

Its device is a file, whose content is the buffers: what the driver maps is real.
"""

import errno
import os
import struct
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from host.drivers.camera import held_controls as c
from host.drivers.camera import v4l2_device as v4l2
from tests.drivers.camera.camera_bench import HEIGHT, WIDTH

LENGTH = 1 << 16  # of a buffer; offsets of mappings are whole pages
MOST_BUFFERS = 8
BUFFER = "<5I4xqq2I8B2IQ3I4x"  # struct v4l2_buffer on 64-bit machines


@dataclass
class Control:
    """One control. sticks: it takes every value and keeps its own. step: it rounds to that."""

    value: int
    minimum: int = 0
    maximum: int = 255
    default: int = 0
    refuses: bool = False
    sticks: bool = False
    step: int = 1


def usual_controls() -> dict[int, Control]:
    """As a webcam has them, at its defaults, in automatic."""
    return {
        c.AUTO_EXPOSURE: Control(3, 0, 3, 3),
        c.EXPOSURE: Control(157, 3, 2047, 250),
        c.DYNAMIC_RATE: Control(1, 0, 1, 0),
        c.AUTO_WHITE: Control(1, 0, 1, 1),
        c.WHITE: Control(4600, 2000, 6500, 4000),
        c.GAIN: Control(12, 0, 255, 12),
        c.MAINS: Control(2, 0, 2, 2),
        c.AUTO_FOCUS: Control(1, 0, 1, 1),
        c.FOCUS: Control(30, 0, 250, 0),
        0x980900: Control(128, 0, 255, 128),
    }


def refusal(number: int) -> OSError:
    return OSError(number, os.strerror(number))


@dataclass
class FakeCamera:
    """What is plugged in, and how it fails. light: 1 is exposed well in 10 ms at gain 12."""

    path: Path
    fourcc: int = v4l2.MJPG
    size: tuple[int, int] = (WIDTH, HEIGHT)
    rate_hz: float = 200.0
    light: float = 1.0
    warmth: float = 1.0  # of the scene's red, of all that is seen
    follows: bool = True  # do pictures get darker with a shorter exposure?
    controls: dict[int, Control] = field(default_factory=usual_controls)
    errors: dict[int, int] = field(default_factory=dict)  # ioctl → error number
    capabilities: int = 1
    stamp_offset: float = 0.0
    padding: bytes = b""
    lost: int = 0  # pictures that the driver loses between two
    damaged: bool = False
    frozen: bool = False
    blank: int | None = None  # level of all pixels
    waiting: int = 0  # pictures that came while nobody looked
    ioctls: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.now, self.sleep = time.monotonic, time.sleep
        self.opened = self.number = 0
        self._queue: list[int] = []
        self._gave = False
        self.sent: list[bytes] = []
        self.plug()

    def plug(self) -> None:
        self.path.write_bytes(bytes(MOST_BUFFERS * LENGTH))

    def unplug(self) -> None:
        self.path.unlink()

    def ioctl(self, device: int, request: int, data: bytes) -> bytes:
        """As the kernel answers, by linux/videodev2.h on a 64-bit machine."""
        self.ioctls.append(request)
        if request in self.errors:
            raise refusal(self.errors[request])
        if not self.path.exists():
            raise refusal(errno.ENODEV)
        answers = {
            v4l2.QUERYCAP: self._capability,
            v4l2.S_FMT: self._format,
            v4l2.ENUM_FRAMESIZES: self._frame_size,
            v4l2.S_PARM: self._rate,
            v4l2.REQBUFS: self._buffers,
            v4l2.QUERYBUF: self._describe,
            v4l2.QBUF: self._enqueue,
            v4l2.DQBUF: self._dequeue,
            v4l2.QUERYCTRL: self._query,
            v4l2.G_CTRL: self._get,
            v4l2.S_CTRL: self._set,
            v4l2.STREAMON: bytes,
            v4l2.STREAMOFF: bytes,
        }
        return answers[request](data)

    def _capability(self, data: bytes) -> bytes:
        self.opened += 1
        return bytes(84) + struct.pack("2I", 1 | 1 << 31, self.capabilities) + bytes(12)

    def _format(self, data: bytes) -> bytes:
        kind, width, height, code = struct.unpack_from("<I4x3I", data)
        assert (kind, width, height) == (1, WIDTH, HEIGHT)
        assert code == int.from_bytes(b"MJPG", "little")
        return struct.pack("<I4x3I", 1, *self.size, self.fourcc).ljust(208, b"\0")

    def _frame_size(self, data: bytes) -> bytes:
        index, code = struct.unpack_from("<2I", data)
        if index > 1:
            raise refusal(errno.EINVAL)
        return struct.pack("<5I", index, code, 1, *[(320, 240), self.size][index]).ljust(44, b"\0")

    def _rate(self, data: bytes) -> bytes:
        return struct.pack("<5I", 1, 0, 0, 100, round(100 * self.rate_hz)).ljust(204, b"\0")

    def _buffers(self, data: bytes) -> bytes:
        count, kind, memory = struct.unpack_from("<3I", data)
        assert (kind, memory) == (1, 1)
        self._queue.clear()
        return struct.pack("<5I", min(count, MOST_BUFFERS), 1, 1, 0, 0)

    def _describe(self, data: bytes, used: int = 0, flags: int = 0, stamp: float = 0.0) -> bytes:
        index = struct.unpack_from("<I", data)[0]
        seconds, micros = divmod(round(1e6 * stamp), 1_000_000)
        return struct.pack(
            BUFFER, index, 1, used, flags, 1, seconds, micros, *[0] * 10,
            self.number, 1, index * LENGTH, LENGTH, 0, 0,
        )  # fmt: skip

    def _enqueue(self, data: bytes) -> bytes:
        self._queue.append(struct.unpack_from("<I", data)[0])
        return data

    def _dequeue(self, data: bytes) -> bytes:
        if self._gave and not self.waiting:
            self._gave = False
            raise refusal(errno.EAGAIN)
        if self.waiting:
            self.waiting -= 1
            age = (self.waiting + 0.5) / self.rate_hz
        else:
            self.sleep(1.0 / self.rate_hz)
            age = 0.001
        self._gave = True
        self.number += 1 + self.lost
        index = self._queue.pop(0)
        jpeg = self._picture()
        self.sent.append(jpeg)
        content = jpeg + self.padding
        with self.path.open("r+b") as file:
            file.seek(index * LENGTH)
            file.write(content)
        stamp = self.now() - age + self.stamp_offset
        flags = v4l2._DAMAGED if self.damaged else 0
        return self._describe(struct.pack("<I", index), len(content), flags, max(stamp, 0.0))

    def _picture(self) -> bytes:
        seed = 0 if self.frozen else self.number
        level = 110.0 * self.light
        if self.follows and self.controls[c.AUTO_EXPOSURE].value == c.MANUAL_EXPOSURE:
            gain = self.controls[c.GAIN].value if c.GAIN in self.controls else 12
            level *= self.controls[c.EXPOSURE].value / 100.0 * (20 + gain) / 32.0
        scene = np.random.default_rng(1).random((8, 8, 1)) ** 2
        shape = (self.size[1], self.size[0], 3)
        scene = np.kron(scene, np.ones((-(-shape[0] // 8), -(-shape[1] // 8), 1)))
        scene = scene[: shape[0], : shape[1]] * np.array([1.0, 1.0, self.warmth])
        noise = np.random.default_rng(seed).normal(0.0, 2.0, shape)
        image = np.clip(2.0 * level * scene + noise, 0.0, 255.0).astype(np.uint8)
        if self.blank is not None:
            image[:] = self.blank
            image[0, 0] = self.number % 256
        return bytes(cv2.imencode(".jpg", image)[1])

    def _control(self, data: bytes) -> Control:
        number = struct.unpack_from("<I", data)[0]
        if number not in self.controls:
            raise refusal(errno.EINVAL)
        return self.controls[number]

    def _query(self, data: bytes) -> bytes:
        control = self._control(data)
        return struct.pack(
            "<2I32s5i2I", *struct.unpack_from("<I", data), 1, b"", control.minimum,
            control.maximum, control.step, control.default, 0, 0, 0,
        )  # fmt: skip

    def _get(self, data: bytes) -> bytes:
        return data[:4] + struct.pack("<i", self._control(data).value)

    def _set(self, data: bytes) -> bytes:
        control, value = self._control(data), struct.unpack_from("<Ii", data)[1]
        if control.refuses:
            raise refusal(errno.EIO)
        if not control.minimum <= value <= control.maximum:
            raise refusal(errno.ERANGE)
        if not control.sticks:
            control.value = max(value // control.step * control.step, control.minimum)
        return data
