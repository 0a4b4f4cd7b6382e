"""Boards behind one face, for tests that any of them must pass: the real ELF and the stand-in."""

import math
import random
from binascii import crc_hqx
from pathlib import Path
from typing import Protocol

from cobs import cobs

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import DisplacementFrame, Frame, IdentityFrame, VelocityFrame
from host.simulation.devices.romeo_elf import LEFT, RIGHT, STEPS_PER_COUNT, RomeoElf
from host.simulation.devices.romeo_stand_in import DEFAULTS, RomeoStandIn

Received = list[tuple[float, Frame]]
START_S = 0.2  # switched on, found by the host, port opened


class BoardUnderTest(Protocol):
    """A board, its host's end of the line and its wheels, in virtual time.

    now: s. decoder: the host's, of all that came. edges_per_period: as its encoders are counted.
    """

    decoder: BoardDecoder
    edges_per_period: int

    @property
    def now(self) -> float: ...

    def send(self, data: bytes) -> None:
        """Bytes from the host."""

    def run(self, seconds: float) -> Received:
        """What it sent in the next `seconds`, with the times of arrival."""

    def turn(self, left: int, right: int, seconds: float) -> Received:
        """The same, while the wheels turn evenly by so many ticks, forward positive."""

    @property
    def driving(self) -> tuple[int, int]:
        """The sense in which each wheel is driven: 1 forward, -1 backward, 0 not at all."""

    def restart(self) -> None:
        """Reset it, and open its port again."""

    def lose_settings(self) -> None:
        """Damage what it has stored, and restart it."""


class StandInBoard:
    """host.simulation.devices.romeo_stand_in.RomeoStandIn."""

    edges_per_period = 2

    def __init__(self, clock_us: int = 0) -> None:
        self.decoder = BoardDecoder()
        self.now = 0.0
        self._ticks = (0, 0)
        self._motion: tuple[float, float, int, int] | None = None
        self._board = RomeoStandIn(self._counts, 0.0, clock_us)
        self.run(START_S)

    def _counts(self, time: float) -> tuple[int, int]:
        left, right = self._ticks
        if self._motion is None:
            return left, right
        begin, end, by_left, by_right = self._motion
        share = min(max((time - begin) / (end - begin), 0.0), 1.0)
        return left + math.trunc(share * by_left), right + math.trunc(share * by_right)

    def send(self, data: bytes) -> None:
        self._board.receive(data, self.now)

    def run(self, seconds: float) -> Received:
        self.now += seconds
        return [
            (at, frame)
            for at, data in self._board.transmit(self.now)
            for frame in self.decoder.feed(data)
        ]

    def turn(self, left: int, right: int, seconds: float) -> Received:
        self._motion = self.now, self.now + seconds, left, right
        received = self.run(seconds)
        self._ticks = self._ticks[0] + left, self._ticks[1] + right
        self._motion = None
        return received

    @property
    def driving(self) -> tuple[int, int]:
        left, right = self._board.wheel_speeds(self.now)
        return _sign(left), _sign(right)

    def restart(self) -> None:
        self._board.reset(self.now)
        self.run(START_S)

    def lose_settings(self) -> None:
        self._board.settings, self._board.settings_defaulted = DEFAULTS, True
        self.restart()


class ElfBoard:
    """The firmware's machine code in the simulator."""

    def __init__(self, elf: Path, encoder_edges: int, clock_us: int = 0) -> None:
        self.decoder = BoardDecoder()
        self.elf = RomeoElf(elf, encoder_edges)
        self.edges_per_period = encoder_edges
        self._steps = STEPS_PER_COUNT[encoder_edges]
        self.elf.run(0.01)
        # The core's clock counts overflows of 1024 us each.
        overflows = int.from_bytes(self.elf.ram("timer0_overflow_count", 4), "little")
        overflows += clock_us // 1024
        self.elf.poke("timer0_overflow_count", overflows.to_bytes(4, "little"))
        self._open()

    def _open(self) -> None:
        self.elf.open_port()
        self.run(START_S)

    @property
    def now(self) -> float:
        return self.elf.now

    def send(self, data: bytes) -> None:
        self.elf.send(data)

    def run(self, seconds: float) -> Received:
        self.elf.run(self.now + seconds)
        return [(at, frame) for at, data in self.elf.take() for frame in self.decoder.feed(data)]

    def turn(self, left: int, right: int, seconds: float) -> Received:
        end = self.now + seconds
        self.elf.turn(LEFT, self._steps * left, end)
        self.elf.turn(RIGHT, self._steps * right, end)
        return self.run(seconds)

    @property
    def driving(self) -> tuple[int, int]:
        left, right = self.elf.motors
        return _sign(left), _sign(right)

    def restart(self) -> None:
        self.elf.reset()
        self._open()

    def lose_settings(self) -> None:
        self.elf.eeprom = b"\xff" * 64
        self.restart()


def on_the_line(content: bytes) -> bytes:
    """The bytes of a frame with any content, known or not."""
    return bytes(cobs.encode(content + crc_hqx(content, 0).to_bytes(2, "little"))) + b"\0"


def mutated(rng: random.Random) -> bytes:
    """A velocity frame with bytes changed, cut, doubled or put in, up to its delimiter."""
    data = bytearray(encode(VelocityFrame(rng.randrange(-3000, 3000), rng.randrange(-3000, 3000))))
    del data[-1]
    for _ in range(rng.randrange(1, 4)):
        place = rng.randrange(len(data))
        kind = rng.randrange(4)
        if kind == 0:
            data[place] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[place] = rng.randrange(256)
        elif kind == 2 and len(data) > 1:
            del data[place]
        else:
            data.insert(place, rng.randrange(256))
    return bytes(data) + b"\0"


def refused_by_board(data: bytes) -> tuple[int, list[Frame]]:
    """How many frames of `data` a board must refuse, and the whole ones in it."""
    decoder = BoardDecoder()
    frames = decoder.feed(data)
    misdirected = [f for f in frames if isinstance(f, IdentityFrame | DisplacementFrame)]
    return decoder.counts.refused + len(misdirected), frames


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
