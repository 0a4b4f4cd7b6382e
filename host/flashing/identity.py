"""The identity of a board: what it says of its firmware, and what a build will say."""

import re
import time
from pathlib import Path

import serial

from host.drivers.romeo.checks import firmware_version
from host.drivers.romeo.device import BAUDRATE
from host.drivers.romeo.framing import DELIMITER, BoardDecoder, encode
from host.drivers.romeo.ports import open_board
from host.drivers.romeo.protocol import (
    BOARD_ROMEO_V2,
    PROTOCOL_HASH,
    HelloFrame,
    IdentityFrame,
)
from host.drivers.romeo.session import ASK_PERIOD_S
from host.drivers.serial_port import explain, read_available
from host.errors import UserError
from host.flashing.firmware import PROJECT

IDENTITY_S = 4.0


def identity_of(project: Path = PROJECT) -> IdentityFrame:
    """What firmware built from the project's sources will say of itself.

    Raises UserError if they cannot be read or are of another protocol than this host's.
    """
    try:
        text = "".join(
            (project / "include" / name).read_text("utf-8") for name in ("version.h", "protocol.h")
        )
    except OSError as error:
        raise UserError(
            "cannot find out the firmware's version",
            f"{error.filename}: {error.strerror}",
            "restore its include/ folder, or install swarmloc again",
        ) from error
    values = dict(re.findall(r"^#define (\w+) (0x[0-9a-f]+|\d+)", text, re.MULTILINE))
    names = ("PROTOCOL_HASH", *(f"FIRMWARE_VERSION_{part}" for part in ("MAJOR", "MINOR", "PATCH")))
    missing = [name for name in names if name not in values]
    if missing:
        raise UserError(
            "cannot find out the firmware's version",
            f"{project / 'include'} does not define {', '.join(missing)}",
            "restore version.h, and run python tools/generate_protocol.py",
        )
    found, major, minor, patch = (int(values[name], 0) for name in names)
    if found != PROTOCOL_HASH:
        raise UserError(
            "this firmware would not understand this host",
            f"its protocol.h speaks {found:08x}, the host speaks {PROTOCOL_HASH:08x}",
            "run: python tools/generate_protocol.py",
        )
    return IdentityFrame(found, major, minor, patch, BOARD_ROMEO_V2, _edges_per_period(project))


def _edges_per_period(project: Path) -> int:
    """Edges that the project's wiring.h counts in a period of an encoder; 2 where it has none."""
    try:
        wiring = (project / "include/wiring.h").read_text("utf-8")
    except OSError:
        return 2
    found = re.search(r"^#define ENCODER_EDGES (\d+)$", wiring, re.MULTILINE)
    return int(found[1]) if found else 2


def read_identity(path: str) -> IdentityFrame:
    """What the board at the port says of itself. Raises UserError if it does not answer."""
    try:
        with open_board(path, BAUDRATE, patience_s=IDENTITY_S) as port:
            return _greet(port)
    except OSError as error:
        raise UserError(
            "the board does not introduce itself",
            explain(error),
            "unplug the board, plug it in again, then run `swarmloc flash` again",
        ) from error


def _greet(port: serial.Serial) -> IdentityFrame:
    decoder = BoardDecoder()
    heard = 0
    end = time.monotonic() + IDENTITY_S
    next_hello = 0.0
    over = False
    while not over:
        over = time.monotonic() > end  # then it reads once more: this computer may have stood still
        if time.monotonic() >= next_hello:
            port.write(DELIMITER + encode(HelloFrame()))
            next_hello = time.monotonic() + ASK_PERIOD_S
        data = read_available(port)
        heard += len(data)
        for frame in decoder.feed(data):
            if isinstance(frame, IdentityFrame):
                return frame
    raise UserError(
        "the board does not introduce itself",
        f"it sent {heard} bytes in {IDENTITY_S:.0f} s and no identity among them",
        "run `swarmloc flash` again",
    )


def compare(found: IdentityFrame, built: IdentityFrame) -> None:
    """Raise UserError unless the board runs what was built."""
    if found != built:
        raise UserError(
            "the board does not run what was built",
            f"it runs {in_words(found)}; built was {in_words(built)}",
            "run `swarmloc flash` again; if another board answers, name one: --port PORT",
        )


def in_words(identity: IdentityFrame) -> str:
    """Version, protocol and kind of board, for the screen."""
    board = "a Romeo V2" if identity.board == BOARD_ROMEO_V2 else f"board {identity.board}"
    version = firmware_version(identity)
    return f"firmware {version} with protocol {identity.protocol_hash:08x} on {board}"
