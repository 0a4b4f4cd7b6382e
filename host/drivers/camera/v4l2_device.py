"""Video devices of the Linux kernel (V4L2): which are there, and why one gives no pictures.

OpenCV says only that it failed. So after a failure the same steps are taken here, one by one, up
to the one that the kernel refuses, and its error number is explained.
"""

import errno
import fcntl
import os
import stat
import struct
from pathlib import Path

from host.errors import UserError

BY_PATH = Path("/dev/v4l/by-path")
_MAJOR = 81  # of video devices

# Layouts are those of linux/videodev2.h; "0L" and "0P" pad as a C compiler does on this machine.
_FORMAT = "@I0P4I"  # type; width, height, pixel format, field; 200 bytes follow the type
_FORMAT_BYTES = struct.calcsize("@I0P") + 200
_BUFFER = "@5I0Lll2I8B2IL3I0L"
_BUFFERS = "5I"
_CAPABILITY_BYTES = 104


def _request(direction: int, number: int, size: int) -> int:
    """An ioctl number; direction: 1 to the kernel, 2 from it, 3 both."""
    return direction << 30 | size << 16 | ord("V") << 8 | number


QUERYCAP = _request(2, 0, _CAPABILITY_BYTES)
S_FMT = _request(3, 5, _FORMAT_BYTES)
REQBUFS = _request(3, 8, struct.calcsize(_BUFFERS))
QBUF = _request(3, 15, struct.calcsize(_BUFFER))
STREAMON = _request(1, 18, 4)
STREAMOFF = _request(1, 19, 4)

_CAPTURE, _MMAP = 1, 1  # buffer type and memory; the capability bit of capturing is 1, too
MJPG = int.from_bytes(b"MJPG", "little")

_ABSENT = "no such camera is plugged in"
_FORBIDDEN = (
    "this user may not use cameras",
    "run: sudo usermod -aG video $USER    then log in again",
)
_BUSY = (
    "another program uses it",
    "close it (sudo fuser -v {path} names it)",
)
_NO_BANDWIDTH = (
    "USB has no bandwidth left for it",
    "plug it into a port of another USB controller (lsusb -t shows them), not into the other "
    "camera's hub, or lower width_px, height_px and rate_hz in robot.toml",
)
_SILENT = (
    "it does not answer on its USB cable",
    "unplug it and plug it in again; use a short cable, or a hub with a supply of its own",
)
_NO_CAMERA = (
    "it is not a camera",
    "v4l2-ctl --list-devices names the cameras; of each take the first device",
)
_CAUSES = {
    **dict.fromkeys((errno.EACCES, errno.EPERM), _FORBIDDEN),
    errno.EBUSY: _BUSY,
    errno.ENOSPC: _NO_BANDWIDTH,
    **dict.fromkeys((errno.EIO, errno.EPROTO, errno.EPIPE, errno.ETIMEDOUT), _SILENT),
    **dict.fromkeys((errno.ENOTTY, errno.EINVAL), _NO_CAMERA),
}
_GONE = (errno.ENOENT, errno.ENXIO, errno.ENODEV)


def is_video_device(path: str) -> bool:
    """Is this a device of the kernel's video drivers?"""
    mode = os.stat(path)
    return stat.S_ISCHR(mode.st_mode) and os.major(mode.st_rdev) == _MAJOR


def absent(path: str) -> UserError:
    """`path` names no device at present."""
    plugged = sorted(map(str, BY_PATH.glob("*video-index0")))
    there = "plugged in: " + ", ".join(plugged) if plugged else "no camera is plugged in at all"
    return UserError(f"cannot open {path}", _ABSENT, f"check its plug and source ({there})")


def explain_camera(path: str, error: OSError) -> UserError:
    """The error a user reads for what the kernel refused."""
    if error.errno in _GONE:
        return absent(path)
    cause, step = _CAUSES.get(error.errno or 0, (error.strerror or str(error), _SILENT[1]))
    return UserError(f"cannot use {path}", cause, step.format(path=path))


def why_no_pictures(path: str, width: int, height: int) -> UserError:
    """Try the camera that OpenCV failed with, step by step, and say which step fails and why.

    The caller has closed it. width, height: the pictures that were asked for, px.
    """
    try:
        device = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        return explain_camera(path, error)
    try:
        return _try_out(device, path, width, height)
    except OSError as error:
        return explain_camera(path, error)
    finally:
        os.close(device)


def _try_out(device: int, path: str, width: int, height: int) -> UserError:
    answer = _ask(device, QUERYCAP, bytes(_CAPABILITY_BYTES))
    (capabilities,) = struct.unpack_from("I", answer, 88)  # of this device, not its siblings
    if not capabilities & _CAPTURE:
        return UserError(
            f"{path} gives no pictures",
            "it is a camera's second device, for data about its pictures",
            "take the one whose name ends in video-index0",
        )
    asked = struct.pack(_FORMAT, _CAPTURE, width, height, MJPG, 0).ljust(_FORMAT_BYTES, b"\0")
    _, *given, code, _ = struct.unpack_from(_FORMAT, _ask(device, S_FMT, asked))
    if code != MJPG:
        return wrong_format(path, code)
    if given != [width, height]:
        return wrong_size(path, given[0], given[1], width, height)
    _ask(device, REQBUFS, struct.pack(_BUFFERS, 1, _CAPTURE, _MMAP, 0, 0))
    _ask(device, QBUF, struct.pack(_BUFFER, 0, _CAPTURE, *[0] * 16, _MMAP, *[0] * 4))
    _ask(device, STREAMON, struct.pack("i", _CAPTURE))
    _ask(device, STREAMOFF, struct.pack("i", _CAPTURE))
    return UserError(
        f"{path} gives no pictures", "it starts as it should, but no picture comes", _SILENT[1]
    )


def wrong_format(path: str, code: int) -> UserError:
    """The camera gives pictures, but not as JPEG. code: the four characters of its format."""
    name = code.to_bytes(4, "little").decode("ascii", "replace")
    return UserError(
        f"{path} gives no JPEG pictures",
        f"it gives {name} at this size; swarmloc takes MJPG",
        f"v4l2-ctl -d {path} --list-formats-ext shows what it has; set width_px and height_px "
        "to a size under MJPG, or take another camera",
    )


def wrong_size(
    path: str, width: int, height: int, configured_width: int, configured_height: int
) -> UserError:
    """The camera gives pictures of another size (px)."""
    return UserError(
        f"{path} gives pictures of {width}x{height}",
        f"robot.toml says {configured_width}x{configured_height}",
        f"v4l2-ctl -d {path} --list-formats-ext shows its sizes; set width_px and height_px to "
        "one under MJPG, and set the lens in robot.toml for that size",
    )


def _ask(device: int, request: int, data: bytes) -> bytes:
    """The kernel's answer to an ioctl. Raises OSError."""
    return fcntl.ioctl(device, request, data)
