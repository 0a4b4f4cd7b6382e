"""A computer with a Romeo on its USB, as far as flashing sees it. Only USB itself is played.

The ports are real pseudo-terminals: the touch is read off the terminal's own speed, the bootloader
answers the real avrdude byte by byte, and the sketch's port is the stand-in board's.
"""

import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Self

from host.simulation.devices.romeo_stand_in import RomeoStandIn
from host.simulation.live import Terminal

ARDUINO = 0x2341
SKETCH, BOOTLOADER = 0x8036, 0x0036
PAGE_BYTES = 128
FLASH_BYTES = 32768
SIGNATURE = bytes((0x87, 0x95, 0x1E))  # the ATmega32U4's, last byte first


class Bootloader:
    """Atmel's AVR109 as the Leonardo's bootloader speaks it. flash: what was written."""

    def __init__(self) -> None:
        self.flash = bytearray(b"\xff" * FLASH_BYTES)
        self.left = False
        self._address = 0  # in words
        self._waiting = bytearray()

    def receive(self, data: bytes) -> bytes:
        """The answers to what the host sent."""
        self._waiting += data
        answers = b""
        while self._waiting:
            size = self._size()
            if len(self._waiting) < size:
                break
            command = bytes(self._waiting[:size])
            del self._waiting[:size]
            answers += self._answer(command)
        return answers

    def _size(self) -> int:
        """Bytes of the command that has begun."""
        kind = chr(self._waiting[0])
        if kind == "B" and len(self._waiting) >= 3:
            return 4 + int.from_bytes(self._waiting[1:3], "big")
        return {"B": 4, "g": 4, "A": 3, "T": 2, "x": 2, "y": 2}.get(kind, 1)

    def _answer(self, command: bytes) -> bytes:
        kind = chr(command[0])
        done = b"\r"
        if kind == "A":
            self._address = int.from_bytes(command[1:], "big")
        elif kind == "B":
            start = 2 * self._address
            self.flash[start : start + len(command) - 4] = command[4:]
            self._address += (len(command) - 4) // 2
        elif kind == "g":
            count = int.from_bytes(command[1:3], "big")
            start = 2 * self._address
            self._address += count // 2
            return bytes(self.flash[start : start + count])
        elif kind == "E":
            self.left = True
        elif kind not in "PLTxye":
            return {
                "S": b"CATERIN",
                "V": b"10",
                "p": b"S",
                "a": b"Y",
                "b": b"Y" + PAGE_BYTES.to_bytes(2, "big"),
                "t": b"\x44\0",
                "s": SIGNATURE,
                "r": b"\x2f",
                "F": b"\xff",
                "N": b"\xd8",
                "Q": b"\xcb",
                "\x1b": b"",
            }.get(kind, b"?")
        return done


class Machine:
    """Runs from entry to exit as a context manager.

    comports: what pyserial's list of ports would give. obeys: does the sketch follow a touch?
    Faults, to be set before they are due: lost (after a touch it is gone from USB), mute (the
    bootloader takes bytes and answers none), forgetful (one byte of the flash does not take),
    stuck (the sketch does not start after the upload).
    """

    def __init__(
        self,
        folder: Path,
        in_bootloader: bool = False,
        obeys: Callable[[], bool] = lambda: True,
    ) -> None:
        self.bootloader = Bootloader()
        self.obeys = obeys
        self.board = RomeoStandIn(lambda now: (0, 0), start=time.monotonic())
        self.lost = self.mute = self.forgetful = self.stuck = False
        self.touches = 0
        self.reset_button = threading.Event()  # set: it is pressed
        self.sketch = Terminal(folder / "ttyACM0")
        # The system gives the bootloader another name where the sketch's is still in use.
        self.loader = Terminal(folder / "ttyACM1")
        self._shown = BOOTLOADER if in_bootloader else SKETCH
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="machine", daemon=True)

    def __enter__(self) -> Self:
        self._port.plug()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        self.sketch.unplug()
        self.loader.unplug()

    @property
    def _port(self) -> Terminal:
        return self.sketch if self._shown == SKETCH else self.loader

    def comports(self) -> list[SimpleNamespace]:
        port, shown = self._port, self._shown
        if not port.plugged:
            return []
        return [
            SimpleNamespace(device=str(port.path), vid=ARDUINO, pid=shown, location="1-1.2:1.0")
        ]

    def _run(self) -> None:
        while not self._stop.wait(0.0003):
            if self._shown == SKETCH:
                self._run_sketch()
            else:
                self._run_bootloader()

    def _run_sketch(self) -> None:
        now = time.monotonic()
        if self.reset_button.is_set():
            self._show(BOOTLOADER)
            return
        if not self.sketch.listening:
            if self.sketch.plugged and self._speed() == termios.B1200:
                self.touches += 1
                self._set_speed(termios.B9600)
                if self.lost:
                    self.sketch.unplug()
                elif self.obeys():
                    self._show(BOOTLOADER)
            return
        self.board.receive(self.sketch.read(), now)
        self.sketch.write(b"".join(data for _, data in self.board.transmit(now)))

    def _run_bootloader(self) -> None:
        data = self.loader.read()
        if data and not self.mute:
            answers = self.bootloader.receive(data)
            if self.forgetful:
                self.bootloader.flash[100] = 0xFF
            self.loader.write(answers)
        if self.bootloader.left and not self.loader.listening and not self.stuck:
            self.board.reset(time.monotonic())
            self._show(SKETCH)

    def _show(self, kind: int) -> None:
        self._port.unplug()
        self._shown = kind
        self._port.plug()

    def _speed(self) -> int:
        """The speed that the port was last opened with."""
        return int(termios.tcgetattr(self._handle)[5])

    def _set_speed(self, speed: int) -> None:
        settings = termios.tcgetattr(self._handle)
        settings[4] = settings[5] = speed
        termios.tcsetattr(self._handle, termios.TCSANOW, settings)

    @property
    def _handle(self) -> int:
        handle = self.sketch._master
        assert handle is not None
        return handle
