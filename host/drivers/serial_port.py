"""Serial ports shared by the device drivers: find, open and read, failures in words."""

import errno
import os
import select
import termios
from collections.abc import Iterable
from pathlib import Path

import serial
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from host.drivers.port_access import why_busy, why_forbidden
from host.errors import UserError

BY_ID = Path("/dev/serial/by-id")

_ABSENT = ("no such device is plugged in", "")
_GONE = ("the device was unplugged or its adapter reset", "")
_OTHER = (
    "it is not a serial port that takes these settings",
    "check port in robot.toml; ls -l /dev/serial/by-id lists what is plugged in",
)
_FORBIDDEN, _BUSY = (errno.EACCES, errno.EPERM), (errno.EBUSY, errno.EAGAIN)
# Error number: (cause, next step).
_CAUSES = {
    **dict.fromkeys((errno.ENOENT, errno.ENXIO, errno.ENODEV), _ABSENT),
    **dict.fromkeys((errno.EIO, errno.EBADF), _GONE),
    **dict.fromkeys((errno.ENOTTY, errno.EINVAL, errno.EISDIR), _OTHER),
}


def find_port(device_name: str, vid_pids: Iterable[tuple[int, int]], configured: str) -> str:
    """Path of the port to open: `configured`, or for "auto" the one with a known USB id.

    device_name: the device as messages and robot.toml call it ("lidar", "board").
    vid_pids: USB (vendor, product) ids the device may have. Raises UserError where none or
    several are plugged in.
    """
    if configured != "auto":
        return configured
    wanted = set(vid_pids)
    found = sorted(
        stable_path(port.device) for port in usb_ports() if (port.vid, port.pid) in wanted
    )
    if len(found) == 1:
        return found[0]
    if not found:
        ids = ", ".join(f"{vendor:04x}:{product:04x}" for vendor, product in sorted(wanted))
        raise UserError(
            f"the {device_name} was not found",
            f"no serial port has its USB id ({ids})",
            f"plug it in, or set port in [{device_name}] of robot.toml",
        )
    raise UserError(
        f"the {device_name} is one of {len(found)} ports with its USB id",
        ", ".join(found),
        f"set port in [{device_name}] of robot.toml to one of them",
    )


def usb_ports() -> list[ListPortInfo]:
    """The serial ports on USB that are plugged in now; none where one is just being unplugged."""
    try:
        listed = list_ports.comports()
    except (OSError, TypeError):
        # pyserial reads a port's files one after the other and stumbles when it vanishes between.
        return []
    return [port for port in listed if port.vid is not None]


def stable_path(device: str) -> str:
    """The /dev/serial/by-id name of a port, which outlives replugging; or `device` itself."""
    target = os.path.realpath(device)
    links = sorted(BY_ID.glob("*"))
    return next((str(link) for link in links if os.path.realpath(link) == target), device)


def open_port(path: str, baudrate: int, dtr: bool | None = None) -> serial.Serial:
    """Open `path` for this process alone, reads limited to 0.05 s and writes to 1 s.

    dtr: level of the DTR line from the moment of opening; None leaves the system's default.
    Raises UserError with the cause and the next step.
    """
    port = serial.Serial()
    port.port, port.baudrate = path, baudrate
    port.timeout, port.write_timeout, port.exclusive = 0.05, 1.0, True
    if dtr is not None:
        port.dtr = dtr
    try:
        port.open()
    except OSError as error:
        raise UserError(f"cannot open {path}", *_why_closed(path, error)) from error
    except termios.error as error:
        raise UserError(f"cannot open {path}", str(error), "unplug it and plug it in again") from (
            error
        )
    except ValueError as error:  # pyserial's for a speed or a name that the system cannot take
        raise UserError(f"cannot open {path!r}", str(error), _OTHER[1]) from error
    return port


def read_available(port: serial.Serial, timeout_s: float = 0.05) -> bytes:
    """Whatever has arrived (at most 4096 bytes), waiting up to `timeout_s` for the first byte.

    Unlike pyserial's `read(size)` it never waits for the rest, so that the time of return is a
    time of arrival. Raises OSError where the device is gone.
    """
    handle = port.fileno()
    ready, _, _ = select.select([handle], [], [], timeout_s)
    if not ready:
        return b""
    try:
        data = os.read(handle, 4096)
    except BlockingIOError:
        return b""
    if not data:
        # Linux reports a vanished USB adapter as for ever readable and for ever empty.
        raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
    return data


def _why_closed(path: str, error: OSError) -> tuple[str, str]:
    """Why a port does not open, and what to do, by what the system shows of it."""
    if _number(error) in _FORBIDDEN:
        return why_forbidden(path)
    if _number(error) in _BUSY:
        return why_busy(path)
    return explain(error), next_step(error)


def explain(error: OSError) -> str:
    """Why a port does not open, read or write, as text."""
    if isinstance(error, serial.SerialTimeoutException):
        return "the device takes no more bytes"
    cause, _ = _CAUSES.get(_number(error) or 0, ("", ""))
    return cause or error.strerror or str(error)


def next_step(error: OSError) -> str:
    """What to do about it, as text."""
    _, step = _CAUSES.get(_number(error) or 0, ("", ""))
    return step or "check the plug and the cable; it is tried again by itself"


def _number(error: OSError) -> int | None:
    """The error's number; pyserial keeps some only as the cause of its own exception."""
    if error.errno is not None:
        return error.errno
    cause = error.__context__
    if isinstance(cause, OSError):
        return cause.errno
    if isinstance(cause, termios.error) and cause.args and isinstance(cause.args[0], int):
        return cause.args[0]
    return None
