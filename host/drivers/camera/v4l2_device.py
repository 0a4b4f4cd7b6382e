"""A video device of the Linux kernel (V4L2) by its ioctls: format, buffers, controls.

OpenCV's capture could give the pictures, too, but not what the driver says of each of them: that it
is damaged (V4L2_BUF_FLAG_ERROR; since 2024 uvcvideo hands damaged ones over), and its number in the
stream. Nor has it all controls, nor the error number of what failed. Layouts and numbers are those
of linux/videodev2.h and linux/v4l2-controls.h.
"""

import contextlib
import errno
import fcntl
import mmap
import os
import select
import struct
from dataclasses import dataclass

# "0L" and "0P" pad as a C compiler does on this machine.
_CAPABILITY_BYTES = 104
_FORMAT = "@I0P4I"  # type; width, height, pixel format, field; 200 bytes follow the type
_FORMAT_BYTES = struct.calcsize("@I0P") + 200
_RATE = "@6I"  # type; capability, mode, period (numerator, denominator), extended mode
_RATE_BYTES = 204
_REQUEST = "@5I"  # count, type, memory, capabilities, flags
# index, type, bytes used, flags, field; seconds, microseconds; timecode; sequence, memory; offset;
# length, reserved, request
_BUFFER = "@5I0Lll2I8B2IL3I0L"
_SIZES = "@11I"  # index, pixel format, kind; width, height, or two ranges of them
_DESCRIPTION = "@2I32s5i2I"  # id, type, name, minimum, maximum, step, default, flags
_VALUE = "@Ii"  # id, value


def _request(direction: int, number: int, size: int) -> int:
    """An ioctl number; direction: 1 to the kernel, 2 from it, 3 both."""
    return direction << 30 | size << 16 | ord("V") << 8 | number


QUERYCAP = _request(2, 0, _CAPABILITY_BYTES)
S_FMT = _request(3, 5, _FORMAT_BYTES)
REQBUFS = _request(3, 8, struct.calcsize(_REQUEST))
QUERYBUF = _request(3, 9, struct.calcsize(_BUFFER))
QBUF = _request(3, 15, struct.calcsize(_BUFFER))
DQBUF = _request(3, 17, struct.calcsize(_BUFFER))
STREAMON = _request(1, 18, 4)
STREAMOFF = _request(1, 19, 4)
S_PARM = _request(3, 22, _RATE_BYTES)
G_CTRL = _request(3, 27, struct.calcsize(_VALUE))
S_CTRL = _request(3, 28, struct.calcsize(_VALUE))
QUERYCTRL = _request(3, 36, struct.calcsize(_DESCRIPTION))
ENUM_FRAMESIZES = _request(3, 74, struct.calcsize(_SIZES))

GONE = (errno.ENODEV, errno.ENXIO, errno.EBADF)  # the device is no longer there
MJPG = int.from_bytes(b"MJPG", "little")
_CAPTURE, _MMAP = 1, 1  # buffer type and memory; the capability bit of capturing is 1, too
_DAMAGED = 0x40  # V4L2_BUF_FLAG_ERROR
_DISABLED, _READ_ONLY = 0x1, 0x4  # flags of a control
_DISCRETE = 1  # V4L2_FRMSIZE_TYPE_DISCRETE
_BUFFERS = 4
_MOST_SIZES = 64


@dataclass(frozen=True, slots=True)
class Buffer:
    """What the driver filled. time: its stamp, s. sequence: its number in the stream.

    damaged: the driver knows that a part is missing.
    """

    data: bytes
    time: float
    sequence: int
    damaged: bool


@dataclass(frozen=True, slots=True)
class ControlRange:
    """What a control can be set to, and what it is by default."""

    minimum: int
    maximum: int
    default: int


class VideoDevice:
    """One opening of a video device. Whatever the kernel refuses raises OSError."""

    def __init__(self, path: str) -> None:
        """Open the device at `path`."""
        self._device = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._memory: list[mmap.mmap] = []
        self._streaming = False

    def can_capture(self) -> bool:
        """Has it pictures? Not so the second device of a camera, nor one that plays them."""
        answer = self._ask(QUERYCAP, bytes(_CAPABILITY_BYTES))
        (capabilities,) = struct.unpack_from("I", answer, 88)  # of this device, not its siblings
        return bool(capabilities & _CAPTURE)

    def set_format(self, width: int, height: int) -> tuple[int, tuple[int, int]]:
        """Ask for JPEG pictures of this size. Returns the format's code and the size it has now."""
        asked = struct.pack(_FORMAT, _CAPTURE, width, height, MJPG, 0).ljust(_FORMAT_BYTES, b"\0")
        answer = self._ask(S_FMT, asked)
        _, given_width, given_height, code, _ = struct.unpack_from(_FORMAT, answer)
        return code, (given_width, given_height)

    def sizes(self) -> list[tuple[int, int]]:
        """The sizes (width, height) of its JPEG pictures, as far as it lists them."""
        found: list[tuple[int, int]] = []
        with contextlib.suppress(OSError):  # no more of them
            for index in range(_MOST_SIZES):
                asked = struct.pack(_SIZES, index, MJPG, *[0] * 9)
                _, _, kind, width, height, *_ = struct.unpack(
                    _SIZES, self._ask(ENUM_FRAMESIZES, asked)
                )
                if kind != _DISCRETE:
                    break
                found.append((width, height))
        return found

    def set_rate(self, rate_hz: float) -> float:
        """Ask for so many pictures per second; returns how many it will give, 0 where unknown."""
        asked = struct.pack(_RATE, _CAPTURE, 0, 0, 1000, round(1000 * rate_hz), 0)
        try:
            answer = self._ask(S_PARM, asked.ljust(_RATE_BYTES, b"\0"))
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):  # its rate cannot be set
                return 0.0
            raise
        _, _, _, numerator, denominator, _ = struct.unpack_from(_RATE, answer)
        return denominator / numerator if numerator else 0.0

    def start(self) -> None:
        """Have the driver fill buffers from now on."""
        answer = self._ask(REQBUFS, struct.pack(_REQUEST, _BUFFERS, _CAPTURE, _MMAP, 0, 0))
        for index in range(struct.unpack(_REQUEST, answer)[0]):
            *_, offset, length, _, _ = self._buffer(QUERYBUF, index)
            self._memory.append(
                mmap.mmap(self._device, length, mmap.MAP_SHARED, prot=mmap.PROT_READ, offset=offset)
            )
            self._buffer(QBUF, index)
        self._ask(STREAMON, struct.pack("i", _CAPTURE))
        self._streaming = True

    def wait(self, seconds: float) -> bool:
        """Wait for a filled buffer, or for what makes `take` fail; False where neither comes."""
        ready, _, _ = select.select([self._device], [], [], seconds)
        return bool(ready)

    def take(self) -> Buffer | None:
        """The oldest filled buffer, None where there is none; the driver gets it back at once."""
        try:
            index, _, used, flags, _, seconds, micros, *_, sequence, _, _, _, _, _ = self._buffer(
                DQBUF, 0
            )
        except BlockingIOError:
            return None
        data = self._memory[index][:used]
        self._buffer(QBUF, index)
        return Buffer(data, seconds + 1e-6 * micros, sequence, bool(flags & _DAMAGED))

    def range_of(self, control: int) -> ControlRange | None:
        """What the control can be set to; None where the device has none that answers."""
        asked = struct.pack(_DESCRIPTION, control, 0, b"", *[0] * 7)
        try:
            answer = struct.unpack(_DESCRIPTION, self._ask(QUERYCTRL, asked))
        except OSError as error:
            if error.errno in GONE:
                raise
            return None
        _, _, _, minimum, maximum, _, default, flags, _, _ = answer
        if flags & (_DISABLED | _READ_ONLY):
            return None
        return ControlRange(minimum, maximum, default)

    def get(self, control: int) -> int:
        """The control's value now."""
        value: int = struct.unpack(_VALUE, self._ask(G_CTRL, struct.pack(_VALUE, control, 0)))[1]
        return value

    def set(self, control: int, value: int) -> None:
        """Set it."""
        self._ask(S_CTRL, struct.pack(_VALUE, control, value))

    def close(self) -> None:
        """Stop, and let go of the device."""
        if self._streaming:
            with contextlib.suppress(OSError):  # it may be gone
                self._ask(STREAMOFF, struct.pack("i", _CAPTURE))
        for memory in self._memory:
            memory.close()
        os.close(self._device)

    def _buffer(self, request: int, index: int) -> tuple[int, ...]:
        """Ask of one buffer; returns its description."""
        asked = struct.pack(_BUFFER, index, _CAPTURE, *[0] * 16, _MMAP, *[0] * 4)
        return struct.unpack(_BUFFER, self._ask(request, asked))

    def _ask(self, request: int, data: bytes) -> bytes:
        """The kernel's answer to an ioctl."""
        return ask(self._device, request, data)


def ask(device: int, request: int, data: bytes) -> bytes:
    """The kernel's answer to an ioctl. Raises OSError."""
    return fcntl.ioctl(device, request, data)
