"""The board's two USB faces, sketch and bootloader: which port is whose, and why one stays shut."""

import errno
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from host.drivers.serial_port import find_port, open_port, stable_path
from host.errors import UserError

BOARD = "board"
AUTO = "auto"
# Arduino's two vendor ids. A board that was touched or reset shows the bootloader for 8 s.
SKETCH_IDS = ((0x2341, 0x8036), (0x2A03, 0x8036))
BOOTLOADER_IDS = ((0x2341, 0x0036), (0x2A03, 0x0036))
POLL_S = 0.1
ACCESS_S = 2.0  # a new port is there before the system has set its permissions
PROCESSES = Path("/proc")

_RULE = (
    'ATTRS{idVendor}=="2341|2a03", ATTRS{idProduct}=="0036|8036", '
    'MODE="0666", ENV{ID_MM_DEVICE_IGNORE}="1"'
)
PASTE_RULE = (
    "paste this, then unplug the board and plug it in again:\n"
    f"  echo '{_RULE}' | sudo tee /etc/udev/rules.d/60-romeo.rules\n"
    "  sudo udevadm control --reload"
)


@dataclass(frozen=True, slots=True)
class BoardPort:
    """A port of a board. socket: which USB socket it is plugged into, "" where unknown."""

    path: str
    in_bootloader: bool
    socket: str = ""

    def same_board(self, other: "BoardPort") -> bool:
        """May both be the same board? What is not known speaks for it."""
        return not (self.socket and other.socket) or self.socket == other.socket


def boards() -> list[BoardPort]:
    """Every port that shows a board's sketch or bootloader now."""
    try:
        listed = list_ports.comports()
    except (OSError, TypeError):
        # pyserial reads a port's files one after the other and stumbles when it vanishes between.
        return []
    ids = {**dict.fromkeys(SKETCH_IDS, False), **dict.fromkeys(BOOTLOADER_IDS, True)}
    return [
        BoardPort(port.device, ids[port.vid, port.pid], (port.location or "").partition(":")[0])
        for port in listed
        if port.vid is not None and port.pid is not None and (port.vid, port.pid) in ids
    ]


def find_board(configured: str = AUTO) -> BoardPort:
    """The board to flash: at the path `configured`, or for "auto" the only one plugged in.

    Raises UserError where there is none, where there are several, or where it is another device.
    """
    try:
        path = find_port(BOARD, (*SKETCH_IDS, *BOOTLOADER_IDS), configured)
    except UserError as error:
        raise UserError(
            error.what,
            error.why,
            "plug it in by a USB cable that carries data; of several name one: "
            "swarmloc flash --port PORT",
        ) from error
    if not os.path.exists(path):
        raise UserError(
            f"there is no port {path}",
            f"plugged in: {', '.join(stable_path(one.path) for one in boards()) or 'no board'}",
            "run `swarmloc flash` without --port to have it found",
        )
    for board in boards():
        if os.path.realpath(board.path) == os.path.realpath(path):
            return BoardPort(path, board.in_bootloader, board.socket)
    for port in list_ports.comports():
        if port.vid is not None and os.path.realpath(port.device) == os.path.realpath(path):
            raise UserError(
                f"{path} is not the board",
                f"its USB id is {port.vid:04x}:{port.pid or 0:04x}, which is another device's",
                "run `swarmloc flash` without --port to have the board found",
            )
    return BoardPort(path, in_bootloader=False)


def wait_for(
    wanted: Callable[[BoardPort], bool], patience_s: float, unlike: Sequence[str] = ()
) -> BoardPort | None:
    """The first port that is `wanted`, or None after `patience_s`. unlike: paths to pass over."""
    end = time.monotonic() + patience_s
    while True:
        for board in boards():
            if board.path not in unlike and wanted(board):
                return board
        if time.monotonic() > end:
            return None
        time.sleep(POLL_S)


def wait_for_access(path: str) -> None:
    """Return when this user may use the port. Raises UserError, with the rule to paste."""
    end = time.monotonic() + ACCESS_S
    while not os.access(path, os.R_OK | os.W_OK):
        if time.monotonic() > end:
            raise UserError(
                f"cannot open {path}", "this user may not use the board's port", PASTE_RULE
            )
        time.sleep(POLL_S)


def open_board(path: str, baudrate: int, patience_s: float = 0.0) -> serial.Serial:
    """Open the board's port with DTR on, tried again for `patience_s`.

    Raises UserError, which names the program that holds the port where it is known.
    """
    wait_for_access(path)
    end = time.monotonic() + patience_s
    while True:
        try:
            return open_port(path, baudrate, dtr=True)
        except UserError as error:
            if time.monotonic() > end:
                raise _words(path, error) from error
        time.sleep(POLL_S)


def _words(path: str, error: UserError) -> UserError:
    cause = error.__cause__
    if not isinstance(cause, OSError) or cause.errno not in (errno.EBUSY, errno.EAGAIN):
        return error
    holder = _holder(path)
    if holder == "ModemManager":
        return UserError(error.what, "ModemManager takes it for a modem and holds it", PASTE_RULE)
    why = f"{holder} has it open" if holder else "another program has it open"
    return UserError(error.what, why, "close that program and run `swarmloc flash` again")


def _holder(path: str) -> str:
    """The name of the program that has the port open; "" where that cannot be seen.

    The files of other users' programs are hidden; ModemManager, which is root's, is then taken
    for the holder wherever it runs.
    """
    port = os.path.realpath(path)
    names = {}
    for process in PROCESSES.glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        try:
            names[process] = (process / "comm").read_text("utf-8", "replace").strip()
            if any(os.path.realpath(link) == port for link in (process / "fd").iterdir()):
                return names[process]
        except OSError:  # it has ended, or is another user's
            continue
    return "ModemManager" if "ModemManager" in names.values() else ""
