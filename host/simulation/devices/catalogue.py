"""Lidars and boards by name: each with what a robot, its simulation and a replay need of it."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from host.config import Lidar, Motors, RobotConfig
from host.drivers.romeo.device import Romeo
from host.drivers.romeo.session import BoardSession
from host.drivers.x4.commands import RESET, SCAN
from host.drivers.x4.device import X4, X4Pro
from host.drivers.x4.protocol import ScanDecoder
from host.messages import Message, Scan
from host.registry import BOARDS, LIDARS
from host.simulation.devices.board import STAND_IN, BoardKind, best_board
from host.simulation.devices.x4 import Sense, X4Emulator, X4ProEmulator
from host.simulation.world.raycast import BeamsOf, straight_beams, x4_beams


class Driver(Protocol):
    """A device on its port, for its own thread."""

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit what the device measures, and its Health, until `stop` is set."""


class BoardDriver(Driver, Protocol):
    """A board on its port, which also obeys."""

    def command(self, speed_mps: float, turn_rate_radps: float, /) -> None:
        """Drive so for a moment, from any thread; call again to go on."""


class LidarDecoder(Protocol):
    """The lidar's bytes → scans, without a device: pure and incremental."""

    def feed(self, data: bytes, arrival: float, /) -> Sequence[Scan]:
        """Take bytes that arrived at host time `arrival` (s); return the completed scans."""


class Emulator(Protocol):
    """The device's side of the line: bytes in, timed bytes out."""

    def receive(self, data: bytes, now: float, /) -> None:
        """Take the host's bytes at `now`, s."""

    def transmit(self, now: float, /) -> list[tuple[float, bytes]]:
        """Return what was sent up to `now` (s), with the time at which each part was complete."""


@runtime_checkable
class Returning(Protocol):
    """A lidar's driver or decoder that reports returns before its revolution is complete.

    last_return: when anything last came back to it, host time, s.
    """

    last_return: float


def last_return(lidar: object) -> Callable[[], float] | None:
    """When anything last came back to a driver or decoder, host time (s); None: unknown."""
    return (lambda: lidar.last_return) if isinstance(lidar, Returning) else None


@dataclass(frozen=True, slots=True)
class LidarEntry:
    """A lidar. driver: from its [lidar] section. decoder: a new one.

    emulator(sense, revolutions per s, seed, delay_s): a new simulated lidar. sense(times (n,) s,
    raw angles (n,) rad, clockwise from the lidar's zero) gives the ranges (n,) m, 0 without a
    return; delay_s: how much later its bytes come than over a plain line. start: the bytes after
    which it sends scans, power_on: those that put it into the state it has when power comes.
    beams: where its light starts and goes, from the axis by default.
    """

    driver: Callable[[Lidar], Driver]
    decoder: Callable[[], LidarDecoder]
    emulator: Callable[[Sense, float, int, float], Emulator]
    start: bytes = b""
    power_on: bytes = b""
    beams: BeamsOf = straight_beams


@dataclass(frozen=True, slots=True)
class BoardEntry:
    """A board that counts ticks and drives the motors.

    driver: of one robot. session: the host's side of the conversation, without a port. stand_in:
    the simulated board of recordings; best: the truest that this computer can run.
    """

    driver: Callable[[RobotConfig], BoardDriver]
    session: Callable[[RobotConfig], BoardSession]
    stand_in: BoardKind
    best: Callable[[Motors], BoardKind]


LIDARS.register("x4", LidarEntry(X4, ScanDecoder, X4Emulator, SCAN, RESET, x4_beams))
LIDARS.register("x4pro", LidarEntry(X4Pro, ScanDecoder, X4ProEmulator, beams=x4_beams))
BOARDS.register("romeo", BoardEntry(Romeo, BoardSession, STAND_IN, best_board))


def lidar_entry(model: str) -> LidarEntry:
    """The entry of a lidar. Raises UserError for a model that is not registered."""
    entry: LidarEntry = LIDARS.get(model)
    return entry


def board_entry(model: str) -> BoardEntry:
    """The entry of a board. Raises UserError for a model that is not registered."""
    entry: BoardEntry = BOARDS.get(model)
    return entry
