"""Commands to the YDLidar X4, and its replies other than samples.

Source: YDLidar X4 Development Manual 1.6, sections 2 and 3; the official SDK where they differ.
"""

import re
from dataclasses import dataclass

SCAN = b"\xa5\x60"
FORCE_SCAN = b"\xa5\x61"
STOP = b"\xa5\x65"
FORCE_STOP = b"\xa5\x00"
INFO = b"\xa5\x90"
HEALTH = b"\xa5\x91"
HEALTH_OF_SDK = b"\xa5\x92"  # the manual has 91, every official SDK sends 92
RESET = b"\xa5\x80"
RESET_OF_MANUAL = b"\xa5\x40"

# What DeviceInfo.model says; the X4's manual has 6, an older one 4.
X4_MODELS = (4, 6)
OTHER_MODELS = {5: "G4", 8: "F4 Pro"}

REPLY_HEADER = b"\xa5\x5a"
# Length (30 bits) and mode (2 bits: 1 = continuous), then the type. The length of the scan reply
# means nothing: packets follow it without end.
_SCAN_HEADER = b"\xa5\x5a\x05\x00\x00\x40\x81"
_INFO_HEADER = b"\xa5\x5a\x14\x00\x00\x00\x04"
_HEALTH_HEADER = b"\xa5\x5a\x03\x00\x00\x00\x06"
_CONTENT_LENGTH = {_SCAN_HEADER: 0, _INFO_HEADER: 20, _HEALTH_HEADER: 3}


@dataclass(frozen=True, slots=True)
class ScanBegins:
    """The lidar took the scan command; packets follow as soon as its motor has its speed."""


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """Which lidar answers. firmware as "major.minor", serial: 16 digits."""

    model: int
    firmware: str
    hardware: int
    serial: str


@dataclass(frozen=True, slots=True)
class DeviceHealth:
    """The lidar's own health report. status 0 good, 1 warning, 2 fault; error: its code."""

    status: int
    error: int


Reply = ScanBegins | DeviceInfo | DeviceHealth


def reply_length(start: bytes) -> int:
    """Bytes of the reply whose first bytes are `start`; 0 where no reply starts like this.

    With fewer than the 7 bytes of a header: 7 as long as they may become one.
    """
    header = start[:7]
    if len(header) < 7:
        return 7 if any(known.startswith(header) for known in _CONTENT_LENGTH) else 0
    length = _CONTENT_LENGTH.get(header)
    return 0 if length is None else 7 + length


def parse_reply(data: bytes) -> Reply | None:
    """The reply in `data`, as long as `reply_length` says; None where it cannot be."""
    header, content = data[:7], data[7:]
    if header == _SCAN_HEADER:
        return ScanBegins()
    if header == _HEALTH_HEADER:
        status, error = content[0], int.from_bytes(content[1:3], "little")
        return DeviceHealth(status, error) if status <= 2 else None
    if header == _INFO_HEADER:
        # A byte for each digit; max() keeps line noise from passing as a serial number.
        if max(content[4:20]) > 9:
            return None
        serial = "".join(str(digit) for digit in content[4:20])
        # The manual has the bytes the other way round; devices send the minor number first.
        return DeviceInfo(content[0], f"{content[2]}.{content[1]}", content[3], serial)
    return None


def encode_reply(reply: Reply) -> bytes:
    """The bytes a lidar sends for `reply`. Raises ValueError for an impossible firmware/serial."""
    if isinstance(reply, ScanBegins):
        return _SCAN_HEADER
    if isinstance(reply, DeviceHealth):
        return _HEALTH_HEADER + bytes([reply.status]) + reply.error.to_bytes(2, "little")
    version = re.fullmatch(r"(\d+)\.(\d+)", reply.firmware)
    if version is None or re.fullmatch(r"\d{16}", reply.serial) is None:
        raise ValueError(f"not a firmware version and a serial number of 16 digits: {reply}")
    numbers = [reply.model, int(version[2]), int(version[1]), reply.hardware]
    return _INFO_HEADER + bytes(numbers) + bytes(int(digit) for digit in reply.serial)
