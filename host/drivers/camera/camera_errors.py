"""What the kernel refuses of a camera, as text: what happened, why, and the next step."""

import errno
import os
import stat
from pathlib import Path

from host.drivers.port_access import holder, why_forbidden
from host.errors import UserError

BY_PATH = Path("/dev/v4l/by-path")
_MAJOR = 81  # of video devices

_ABSENT = "no such camera is plugged in"
_NO_BANDWIDTH = (
    "USB has no bandwidth left for it",
    "plug it into a port of another USB controller (lsusb -t shows them), not into the other "
    "camera's hub, or lower width_px, height_px and rate_hz in robot.toml",
)
_SILENT = (
    "it does not answer on its USB cable",
    "unplug it and plug it in again; use a short cable, or a powered hub",
)
_NO_CAMERA = (
    "it is not a camera",
    "v4l2-ctl --list-devices names the cameras; of each take the first device",
)
_CAUSES = {
    errno.ENOSPC: _NO_BANDWIDTH,
    **dict.fromkeys((errno.EIO, errno.EPROTO, errno.EPIPE, errno.ETIMEDOUT), _SILENT),
    **dict.fromkeys((errno.ENOTTY, errno.EINVAL), _NO_CAMERA),
}
_FORBIDDEN = (errno.EACCES, errno.EPERM)
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
    if error.errno in _FORBIDDEN:
        return UserError(f"cannot use {path}", *why_forbidden(path))
    if error.errno == errno.EBUSY:
        user = holder(path) or "another program"
        return UserError(
            f"cannot use {path}", f"{user} uses it", f"close it (sudo fuser -v {path} names it)"
        )
    cause, step = _CAUSES.get(error.errno or 0, (error.strerror or str(error), _SILENT[1]))
    return UserError(f"cannot use {path}", cause, step)


def second_device(path: str) -> UserError:
    """The device at `path` has no pictures, but what belongs to them."""
    return UserError(
        f"{path} gives no pictures",
        "it is a camera's second device, for data about its pictures",
        "take the one whose name ends in video-index0",
    )


def silent(path: str) -> UserError:
    """The camera was started, and nothing comes."""
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
    path: str, given: tuple[int, int], configured: tuple[int, int], sizes: list[tuple[int, int]]
) -> UserError:
    """The camera gives pictures of another size. All (width, height), px; sizes: that it has."""
    listed = ", ".join(f"{width}x{height}" for width, height in sizes)
    return UserError(
        "{} gives pictures of {}x{}".format(path, *given),
        "robot.toml says {}x{}".format(*configured),
        (f"it has, as MJPG: {listed}; " if listed else "")
        + "set width_px and height_px to a size that it has, and the lens in robot.toml for it",
    )
