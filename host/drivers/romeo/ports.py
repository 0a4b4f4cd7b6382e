"""The board's two USB faces, sketch and bootloader: which port is whose, and why one stays shut."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import serial

from host.drivers.port_access import why_forbidden
from host.drivers.serial_port import find_port, open_port, stable_path, usb_ports
from host.errors import UserError

BOARD = "board"
AUTO = "auto"
# Arduino's two vendor ids. A board that was touched or reset shows the bootloader for 8 s.
SKETCH_IDS = ((0x2341, 0x8036), (0x2A03, 0x8036))
BOOTLOADER_IDS = ((0x2341, 0x0036), (0x2A03, 0x0036))
POLL_S = 0.1
ACCESS_S = 2.0  # a new port is there before the system has set its permissions


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
    return [
        BoardPort(
            port.device,
            (port.vid, port.pid) in BOOTLOADER_IDS,
            (port.location or "").partition(":")[0],
        )
        for port in usb_ports()
        if (port.vid, port.pid) in (*SKETCH_IDS, *BOOTLOADER_IDS)
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
    for port in usb_ports():
        if os.path.realpath(port.device) == os.path.realpath(path):
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
    """Return when this user may use the port. Raises UserError."""
    end = time.monotonic() + ACCESS_S
    while not os.access(path, os.R_OK | os.W_OK):
        if time.monotonic() > end:
            raise UserError(f"cannot open {path}", *why_forbidden(path))
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
        except UserError:
            if time.monotonic() > end:
                raise
        time.sleep(POLL_S)
