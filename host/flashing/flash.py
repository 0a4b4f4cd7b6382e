"""Firmware onto the board: into the bootloader, avrdude, and back from the board what it runs."""

import contextlib
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from host.drivers.romeo.ports import (
    BoardPort,
    boards,
    find_board,
    open_board,
    wait_for,
    wait_for_access,
)
from host.drivers.romeo.protocol import IdentityFrame
from host.drivers.serial_port import stable_path
from host.drivers.udev import PASTE
from host.errors import UserError
from host.flashing.firmware import PROJECT, Firmware
from host.flashing.identity import compare, identity_of, read_identity
from host.flashing.platformio import platformio_folder
from host.folders import build_folder

TOUCH_BAUDRATE = 1200  # opened and closed at this speed, the sketch gives way to the bootloader
UPLOAD_BAUDRATE = 57600
BOOTLOADER_S = 8.0  # to appear, and about as long it stays
BUTTON_S = 30.0  # for a person to press the reset button
UPLOAD_S = 20.0  # avrdude alone would retry for 50 s if the bootloader does not answer
SKETCH_S = 10.0
LOG = "avrdude.log"  # in build_folder()

_BY_HAND = (
    "press its reset button (twice in quick succession if once does nothing) and run "
    "`swarmloc flash` again within 8 s"
)
# A pattern in avrdude's output, the cause, and what to do.
_AVRDUDE_CAUSES = (
    (r"permission denied", "this user may not use the bootloader's port", PASTE),
    (
        r"verif|mismatch",
        "what was read back from the board is not what was written",
        "run `swarmloc flash` again; if it fails again, use another USB cable",
    ),
    (
        r"not respond|recv|timeout|initiali[sz]ation failed|programmer id",
        "the bootloader did not answer: its 8 s were over, or another program (ModemManager?) "
        "spoke to it",
        f"stop that program, {_BY_HAND}",
    ),
    (r"cannot open|can't open|no such", "the bootloader's port disappeared", _BY_HAND),
)


@dataclass(frozen=True, slots=True)
class Flashed:
    """A board after the upload. identity: what it said of itself."""

    port: str
    identity: IdentityFrame


def flash(
    firmware: Firmware, port: str, report: Callable[[str], None], project: Path = PROJECT
) -> Flashed:
    """Upload the firmware and see that the board runs it.

    port: a path, or "auto". report: takes a line for each step. project: what it was built from.
    Raises UserError at the first step that fails.
    """
    expected = identity_of(project)
    avrdude = find_avrdude()
    board = find_board(port)
    if board.in_bootloader:
        report(f"the board is in its bootloader: {board.path}")
    else:
        report(f"found the board: {board.path}")
        board = enter_bootloader(board, report)
        report(f"its bootloader is there: {board.path}")
    upload(avrdude, firmware.hex, board.path)
    report(f"uploaded and verified {firmware.flash_bytes} bytes")
    path = stable_path(_sketch_of(board).path)
    report(f"the firmware has started: {path}")
    identity = read_identity(path)
    compare(identity, expected)
    return Flashed(path, identity)


def find_avrdude() -> list[str]:
    """The command avrdude: the system's, else PlatformIO's. Raises UserError."""
    found = shutil.which("avrdude")
    if found:
        return [found]
    for package in sorted((platformio_folder() / "packages").glob("tool-avrdude*")):
        programs = [path for path in package.rglob("avrdude") if path.is_file()]
        if programs:
            configuration = [f"-C{path}" for path in package.rglob("avrdude.conf")]
            return [str(programs[0]), *configuration[:1]]
    raise UserError(
        "cannot upload the firmware",
        "avrdude is not installed",
        "run: sudo apt-get install -y avrdude",
    )


def enter_bootloader(board: BoardPort, report: Callable[[str], None]) -> BoardPort:
    """Have the sketch give way to the bootloader; the bootloader's port, open to this user.

    If the touch does nothing, it asks for the reset button. Raises UserError if the bootloader
    does not appear within BUTTON_S after that either.
    """
    before = [one.path for one in boards() if one.in_bootloader]
    touch(board.path)

    def expected(one: BoardPort) -> bool:
        return one.in_bootloader and one.same_board(board)

    found = wait_for(expected, BOOTLOADER_S, unlike=before)
    if found is None:
        report(
            "its bootloader does not answer the touch at 1200 baud: press the board's reset button "
            "now (twice in quick succession if once does nothing)"
        )
        found = wait_for(expected, BUTTON_S, unlike=before)
    if found is None:
        still = os.path.exists(board.path)
        raise UserError(
            "the bootloader did not appear",
            "neither after the touch at 1200 baud nor after the reset button; "
            + (
                f"the sketch still has {board.path}: it may hang, or not be an Arduino sketch"
                if still
                else "the board is gone from USB and has not come back"
            ),
            _BY_HAND,
        )
    wait_for_access(found.path)
    return found


def touch(path: str) -> None:
    """Open the port at 1200 baud and close it with DTR off. Raises UserError."""
    port = open_board(path, TOUCH_BAUDRATE)
    # A fast board disappears from USB before the port is closed.
    with contextlib.suppress(OSError):
        port.dtr = False
    with contextlib.suppress(OSError):
        port.close()


def upload(avrdude: list[str], image: Path, port: str) -> None:
    """Write the .hex and verify it; avrdude's output is kept in LOG. Raises UserError."""
    command = [
        *avrdude,
        *("-p", "atmega32u4", "-c", "avr109", "-P", port, "-b", str(UPLOAD_BAUDRATE)),
        *("-D", "-U", f"flash:w:{image}:i"),
    ]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=UPLOAD_S,
            env={**os.environ, "LC_ALL": "C"},  # its errors are looked up below
            check=False,
        )
        said, failed = done.stdout, done.returncode != 0
    except subprocess.TimeoutExpired as error:
        said, failed = (error.stdout or b"") + b"\nstopped: timeout\n", True
    text = said.decode("utf-8", "replace")
    log = build_folder() / LOG
    kept = f" ({log} has all it said)"
    try:
        log.write_text(f"{' '.join(command)}\n{text}", "utf-8")
    except OSError:  # a full disk: the board does not need it
        kept = ""
    if failed:
        why, next_step = _avrdude_failure(text)
        raise UserError("avrdude could not upload the firmware", why + kept, next_step)


def _avrdude_failure(text: str) -> tuple[str, str]:
    for pattern, why, next_step in _AVRDUDE_CAUSES:
        if re.search(pattern, text, re.IGNORECASE):
            return why, next_step
    lines = [line.strip() for line in text.splitlines() if "error" in line.lower()]
    return (lines or ["it did not say why"])[0], _BY_HAND


def _sketch_of(board: BoardPort) -> BoardPort:
    """The port of the sketch that the bootloader has started."""
    found = wait_for(lambda one: not one.in_bootloader and one.same_board(board), SKETCH_S)
    if found is None:
        stays = any(one.in_bootloader and one.same_board(board) for one in boards())
        raise UserError(
            "the firmware was uploaded but has not started",
            "the board is still in its bootloader" if stays else "the board is gone from USB",
            "unplug the board, plug it in again, then run `swarmloc flash` again",
        )
    return found
