"""A Romeo board that runs its sketch's real machine code, in virtual time, on a simulated USB."""

import ctypes
import math
import weakref
from pathlib import Path

from host.errors import UserError
from host.flashing.elf import flash_image, symbols
from host.simulation.devices import romeo_library
from host.simulation.devices.romeo_figures import (
    InterruptTime,
    PassTime,
    interrupts,
    longest_interrupts_off,
    passes,
)

CYCLES_PER_S = 16_000_000
LEFT, RIGHT = 0, 1
CHANNEL_A, CHANNEL_B = 0, 1
STEPS_PER_COUNT = {2: 2, 4: 1}  # quadrature steps, by the edges a sketch counts in four of them
EEPROM_BYTES = 1024

_PACKET_BYTES, _DESCRIPTOR_BYTES = 64, 512
_USB_TICK_S = 1e-4


class RomeoElf:
    """A board with the sketch of an ELF file, switched on at virtual time 0 and run on demand.

    All times are virtual, s. The same calls give the same bytes at the same times. The USB cable
    is plugged in: 0.11 s after the sketch attaches, the host has configured it. After a reset the
    host finds it again, with the port closed. One thread at a time may use it.

    reading: whether the host reads what the board sends, while the port is open.
    """

    def __init__(self, elf: Path, encoder_edges: int = 2, eeprom: bytes | None = None) -> None:
        """encoder_edges: 2 or 4, how the encoders are wired (the sketch's wiring.h).

        eeprom: its first bytes; the rest, or all of it, is erased (0xFF).
        Raises UserError where the file is no program for the board, or the simulator is missing.
        """
        self._library = romeo_library.load()
        image = flash_image(elf)
        board = self._library.romeo_new(image, len(image), encoder_edges)
        if not board:
            raise UserError(
                "cannot simulate the board", f"{elf} does not fit its flash", "use another program"
            )
        self._board = ctypes.c_void_p(board)
        weakref.finalize(self, self._library.romeo_free, self._board)
        self._elf = elf
        self._symbols: dict[str, int] | None = None
        self._reading = True
        if eeprom is not None:
            self.eeprom = eeprom

    @property
    def now(self) -> float:
        """Virtual time, s."""
        return int(self._library.romeo_cycle(self._board)) / CYCLES_PER_S

    def run(self, until: float) -> None:
        """Run to the first instruction at or after this time.

        Raises UserError where the sketch crashes.
        """
        if self._library.romeo_run(self._board, _cycle(until)) != 0:
            error = self._library.romeo_error(self._board).decode(errors="replace")
            raise UserError(
                f"the board's program crashed at {self.now:.6f} s",
                " ".join(error.replace("\x1b[31m", "").replace("\x1b[0m", "").split()),
                "look at what it did last",
            )

    # ---- the serial port

    def open_port(self, baudrate: int = 115200) -> None:
        """Set the baud rate, then DTR and RTS, as a host does that opens the port.

        It takes effect as time goes on, a millisecond or so after the board is configured.
        """
        self._set_line(baudrate, ready=True)

    def close_port(self, baudrate: int = 115200) -> None:
        """Drop DTR and RTS; with 1200 the board goes for its bootloader."""
        self._set_line(baudrate, ready=False)

    def _set_line(self, baudrate: int, ready: bool) -> None:
        if self._library.romeo_set_line(self._board, baudrate, ready) != 0:
            raise UserError(
                "cannot open or close the simulated port",
                "too many such requests are waiting",
                "let time go on in between",
            )

    def request(self, setup: bytes, abandoned: bool = False) -> None:
        """Let the host make a control request: its setup packet (USB 2.0, table 9-2), 8 bytes.

        abandoned: nothing follows it, as where a host program or a cable fails.
        """
        if len(setup) != 8:
            raise ValueError(f"a setup packet has 8 bytes, not {len(setup)}")
        if self._library.romeo_request(self._board, setup, abandoned) != 0:
            raise UserError(
                "cannot make a control request of the simulated host",
                "too many are waiting, or it has more than 8 bytes for the board",
                "let time go on in between",
            )

    def slow_control(self, gap: float) -> None:
        """Let the host wait so long (s) before each stage of a control request."""
        self._library.romeo_set_stage_gap(self._board, round(gap / _USB_TICK_S))

    @property
    def configured(self) -> bool:
        """Has the host found the board and set it up?"""
        return bool(self._library.romeo_configured(self._board))

    @property
    def port_open(self) -> bool:
        """Is the port open at this time?"""
        return bool(self._library.romeo_open(self._board))

    @property
    def reading(self) -> bool:
        """Does the host read while the port is open?"""
        return self._reading

    @reading.setter
    def reading(self, reading: bool) -> None:
        self._reading = reading
        self._library.romeo_set_reading(self._board, reading)

    def send(self, data: bytes) -> None:
        """Give the host bytes to send: when the port is open, as fast as the board takes them."""
        if self._library.romeo_send(self._board, data, len(data)) != 0:
            raise MemoryError

    @property
    def unsent(self) -> int:
        """Bytes that the board has not taken yet."""
        return int(self._library.romeo_unsent(self._board))

    def take(self) -> list[tuple[float, bytes]]:
        """Return what the host read since the last call: (time of arrival, a packet's bytes)."""
        packets = []
        data = ctypes.create_string_buffer(_PACKET_BYTES)
        cycle = ctypes.c_uint64()
        while size := self._library.romeo_take(self._board, data, ctypes.byref(cycle)):
            packets.append((cycle.value / CYCLES_PER_S, data.raw[:size]))
        return packets

    @property
    def device_descriptor(self) -> bytes:
        """Its own description (USB 2.0, table 9-8); empty until the host has read it."""
        return self._descriptor(1)

    @property
    def configuration_descriptor(self) -> bytes:
        """Its configuration with interfaces and endpoints; empty until the host has read it."""
        return self._descriptor(2)

    def _descriptor(self, which: int) -> bytes:
        data = ctypes.create_string_buffer(_DESCRIPTOR_BYTES)
        size = self._library.romeo_descriptor(self._board, which, data)
        return data.raw[:size]

    # ---- wheels

    def turn(self, wheel: int, steps: int, until: float) -> None:
        """Turn LEFT or RIGHT by quadrature steps, forward positive, evenly from now to `until`.

        The last step comes at `until`. What is left of an earlier rotation is dropped.
        """
        self._library.romeo_turn(self._board, wheel, steps, _cycle(until))

    def disturb(
        self, wheel: int, channel: int, width: float, period: float = 1.0, count: int = 1
    ) -> None:
        """Noise on CHANNEL_A or CHANNEL_B of an encoder: `count` pulses that invert its level.

        Each `width` (s) long, the first from now on, the others `period` (s > width) apart. Noise
        before on this channel is given up; count 0 ends it.
        """
        cycles = round(width * CYCLES_PER_S), round(period * CYCLES_PER_S)
        self._library.romeo_disturb(self._board, wheel, channel, *cycles, count)

    @property
    def steps(self) -> tuple[int, int]:
        """Quadrature steps (left, right) made since the start, forward positive."""
        left, right = (self._library.romeo_steps(self._board, wheel) for wheel in (LEFT, RIGHT))
        return int(left), int(right)

    @property
    def motors(self) -> tuple[float, float]:
        """Duty (left, right) in [-1, 1]; positive while the direction pin is high."""
        left, right = (self._library.romeo_motor(self._board, wheel) for wheel in (LEFT, RIGHT))
        return float(left), float(right)

    # ---- resets

    def reset(self) -> None:
        """Press the reset button. The bootloader's wait of 8 s is left out."""
        self._library.romeo_reset(self._board)

    @property
    def restarts(self) -> int:
        """How often the watchdog has reset the board."""
        return int(self._library.romeo_watchdog_resets(self._board))

    @property
    def bootloader_asked(self) -> bool:
        """Did a watchdog reset find the key for the bootloader?

        There is none: from then on time passes and nothing happens.
        """
        return bool(self._library.romeo_bootloader(self._board))

    # ---- memory

    def ram(self, place: int | str, size: int) -> bytes:
        """Return bytes of RAM from an address, or from a symbol of the program."""
        return ctypes.string_at(self._ram(place, size), size)

    def poke(self, place: int | str, data: bytes) -> None:
        """Overwrite bytes of RAM from an address, or from a symbol of the program."""
        ctypes.memmove(self._ram(place, len(data)), data, len(data))

    def _ram(self, place: int | str, size: int) -> int:
        address = self._address(place)
        first = self._library.romeo_ram(self._board, address)
        if size < 1 or not first or not self._library.romeo_ram(self._board, address + size - 1):
            raise ValueError(f"no {size} bytes of RAM at {place!r}")
        return int(first)

    def _address(self, place: int | str) -> int:
        if isinstance(place, int):
            return place
        if self._symbols is None:
            self._symbols = symbols(self._elf)
        if place not in self._symbols:
            raise UserError(
                f"the board's program has no symbol {place!r}", f"in {self._elf}", "check its name"
            )
        return self._symbols[place]

    def patch(self, place: int | str, code: bytes) -> None:
        """Overwrite the program in flash from a byte address, or a symbol: to make it fail."""
        if self._library.romeo_patch(self._board, self._address(place), code, len(code)) != 0:
            raise ValueError(f"no {len(code)} bytes of flash at {place!r}")

    @property
    def eeprom(self) -> bytes:
        """The EEPROM's 1024 bytes; what is assigned goes to its first bytes."""
        data = ctypes.create_string_buffer(EEPROM_BYTES)
        self._library.romeo_eeprom(self._board, data, EEPROM_BYTES, 0)
        return data.raw

    @eeprom.setter
    def eeprom(self, content: bytes) -> None:
        if len(content) > EEPROM_BYTES:
            raise ValueError(f"the EEPROM has {EEPROM_BYTES} bytes, not {len(content)}")
        self._library.romeo_eeprom(self._board, content, len(content), 1)

    # ---- figures

    @property
    def interrupts(self) -> dict[str, InterruptTime]:
        """Figures of the interrupts that ran since the last clear_figures(), by name."""
        return interrupts(self._library, self._board)

    def watch(self, place: int | str | None) -> None:
        """Measure from one pass of this code address (bytes), or symbol, to the next; None ends it.

        It slows the simulation down.
        """
        self._library.romeo_watch(self._board, -1 if place is None else self._address(place))

    @property
    def passes(self) -> PassTime:
        """Figures of the watched place since watch() or clear_figures()."""
        return passes(self._library, self._board)

    @property
    def interrupts_off(self) -> tuple[int, int]:
        """While a place is watched: most cycles with interrupts off, and their byte address."""
        return longest_interrupts_off(self._library, self._board)

    def clear_figures(self) -> None:
        """Forget the figures of interrupts and passes, as after the start or the enumeration."""
        self._library.romeo_clear_figures(self._board)


def _cycle(time: float) -> int:
    """The first cycle that is not before `time`, by the division that `now` makes as well."""
    cycle = max(0, math.ceil(time * CYCLES_PER_S))
    return cycle if cycle / CYCLES_PER_S >= time else cycle + 1
