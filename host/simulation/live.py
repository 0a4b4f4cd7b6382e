"""The simulated robot in real time: its lidar and board on pseudo-terminals.

The real drivers open the terminals as they would open serial ports. Its cameras are two streams of
pictures in named pipes or, where the scenario renders none, a thread that reports their bearings.
Motion capture, where the scenario has it, is a NatNet server on this computer.
"""

import contextlib
import functools
import math
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from host.config import RobotConfig
from host.errors import UserError
from host.messages import Bearings, FloatArray, IntArray, Truth
from host.simulation.devices.board import BoardKind
from host.simulation.devices.catalogue import Emulator
from host.simulation.devices.link_senders import LinkSenders
from host.simulation.devices.live_cameras import LiveCameras
from host.simulation.devices.natnet_server import NatNetServer
from host.simulation.devices.workers import Workers
from host.simulation.live_bearings import CAMERA, LiveCamera
from host.simulation.offline import Simulation
from host.simulation.pictures.render import Surroundings
from host.simulation.world.arena import ARENA_STEP_S, Contact
from host.simulation.world.scenarios import Scenario

PUMP_S = 0.002  # more would make every message look later than it is
_STANDSTILL_S = 1.0  # behind the clock: the process was suspended, or the computer is too slow
MEMORY_S = 60.0  # longer than anyone asks back for: a run may go on for days
LIDAR, BOARD = "lidar", "board"

Interval = tuple[float, float]


class Terminal:
    """A serial port that is not there: the host opens `path`, the device reads and writes here."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._master: int | None = None

    @property
    def plugged(self) -> bool:
        """Is there a port under the path?"""
        return self._master is not None

    def plug(self) -> None:
        """Make a new port under the path, as a USB adapter does that was plugged in."""
        if self._master is not None:
            return
        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.path.symlink_to(os.ttyname(slave))
        os.close(slave)
        self._master = master  # last: whoever sees it plugged finds its path

    def unplug(self) -> None:
        """Remove the port: a host that has it open gets an input/output error."""
        if self._master is None:
            return
        master, self._master = self._master, None
        self.path.unlink()
        os.close(master)

    @property
    def listening(self) -> bool:
        """Whether a host has the port open; else bytes are lost."""
        if self._master is None:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def read(self) -> bytes:
        """Whatever the host has written since the last call, be it the last before it closed."""
        if self._master is None:
            return b""
        try:
            return os.read(self._master, 4096)
        except OSError:  # nothing there, or no host has the port open
            return b""

    def write(self, data: bytes) -> None:
        """Send to the host; what it does not make room for is lost, as in a UART's buffer."""
        if self._master is not None and data and self.listening:
            with contextlib.suppress(OSError):
                os.write(self._master, data)


class LiveSimulation(Workers):
    """A scenario that runs by the clock, with the devices of its robot plugged in and out.

    unplugged: by "lidar", "board" or "camera" (both), the intervals (s since the start) without it.
    Times of messages and of `truth` are the host's, by `clock` (s). config: the caller's, with the
    simulated devices in place of the real ones. As a context manager it runs from entry to exit,
    where it raises UserError if the board's program crashed. driven: the robot obeys its board, and
    so the host; else it follows its scripted path.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: RobotConfig,
        unplugged: Mapping[str, Sequence[Interval]] | None = None,
        board: BoardKind | None = None,
        clock: Callable[[], float] = time.monotonic,
        driven: bool = False,
    ) -> None:
        self._simulation = Simulation(scenario, config, board, driven=driven)
        self._driven = driven
        self._unplugged = unplugged or {}
        unknown = set(self._unplugged) - {LIDAR, BOARD, CAMERA}
        if unknown:
            raise UserError(
                f"cannot unplug {min(unknown)!r}",
                f"known: {LIDAR}, {BOARD}, {CAMERA}",
                "write it as in --unplug lidar=2-4",
            )
        self.clock = clock
        self._start = clock()
        self._lock = threading.Lock()
        self._failure: UserError | None = None
        self.config = self._simulation.config
        self.camera = LiveCamera(self)
        with contextlib.ExitStack() as opened:
            folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="swarmloc-")))
            self._ports: dict[str, tuple[Terminal, Emulator]] = {
                # The board first: its motors move what the lidar sees.
                BOARD: (Terminal(folder / BOARD), self._simulation.board),
                LIDAR: (Terminal(folder / LIDAR), self._simulation.lidar),
            }
            for name, (terminal, _) in self._ports.items():
                opened.callback(terminal.unplug)
                self._configure(name, port=str(terminal.path))
            self._others = self._other_devices(scenario, folder)
            super().__init__({"simulation": self._run}, opened)

    def _other_devices(self, scenario: Scenario, folder: Path) -> list[Workers]:
        """Cameras, motion capture and other robots' radios, as far as the scenario has them."""
        others: list[Workers] = []
        if scenario.rendered:
            pictures = LiveCameras(
                folder,
                scenario,
                self.config.camera,
                self._simulation.built.camera,
                self._surroundings,
                self.clock,
                lambda: self._start,
                functools.partial(self.absent, CAMERA),
            )
            self.config = self.config.model_copy(update={"camera": pictures.camera})
            others.append(pictures)
        if scenario.mocap_hz:
            server = NatNetServer(self._bodies, scenario.mocap_hz, self.clock)
            self._configure("mocap", source="natnet", natnet=server.config)
            others.append(server)
        if scenario.link_hz:
            link = LinkSenders(self._floor_poses, scenario.link_hz, scenario.seed, self.clock)
            self.config = self.config.model_copy(update={"link": link.settings})
            others.append(link)
        return others

    def _configure(self, section: str, **values: object) -> None:
        changed = getattr(self.config, section).model_copy(update=values)
        self.config = self.config.model_copy(update={section: changed})

    def __enter__(self) -> Self:
        self._start = self.clock()
        self._plug(0.0)
        super().__enter__()
        for each in self._others:
            self._opened.enter_context(each)
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        super().__exit__(kind, error, traceback)
        if self._failure is not None and error is None:
            raise self._failure

    def truth(self, time: float) -> Truth:
        """True positions of the teammates at the host's `time` (s), in the robot frame.

        Of times within the last minute. While the process is suspended the world stands still.
        """
        with self._lock:
            return replace(self._simulation.truth(max(0.0, time - self._start)), time=time)

    def arrival(self, frame: int) -> float:
        """When the image pair with this number (from 0) is there, host time, s."""
        scenario = self._simulation.scenario
        return self._start + frame / scenario.camera_hz + scenario.camera_delay_s

    def bearings(self, frame: int) -> Bearings:
        """What the image pair with this number shows; once it is there."""
        with self._lock:
            bearings = self._simulation.camera.bearings(frame / self._simulation.scenario.camera_hz)
        return replace(bearings, time=self.arrival(frame) - self.config.camera.delay_s)

    @property
    def contacts(self) -> list[Contact]:
        """Who drove against what so far; times since the start of the scenario."""
        with self._lock:
            return list(self._simulation.arena.contacts)

    def _bodies(self, time: float) -> tuple[IntArray, FloatArray]:
        with self._lock:
            seen = self._simulation.bodies(time - self._start)
        return seen.identities, seen.poses

    def _floor_poses(self, time: float) -> FloatArray:
        with self._lock:
            return np.asarray(self._simulation.arena.poses(np.array([time - self._start]))[0])

    def _surroundings(self, time: float) -> Surroundings:
        with self._lock:
            return self._simulation.surroundings(time)

    def _run(self) -> None:
        try:
            self._pump_until_stop()
        except UserError as failure:  # of the board's program; raised again where it ends
            self._failure = failure

    def _pump_until_stop(self) -> None:
        done = 0.0  # time up to which all is simulated
        while not self._stop.wait(PUMP_S):
            now = self.clock() - self._start
            behind = now - done
            with self._lock:
                if behind > _STANDSTILL_S:
                    self._stand_still(behind)
                    now = done
                done = now
                self._plug(now)
                # The world has whole steps: what a robot does that obeys is not known before.
                whole = math.floor(now / ARENA_STEP_S) * ARENA_STEP_S
                self._exchange(whole if self._driven else now)
                self._simulation.forget(now - MEMORY_S)
        # What the drivers sent when they ended: STOP, and wheel speeds of 0.
        for terminal, device in self._ports.values():
            device.receive(terminal.read(), self.clock() - self._start)

    def _exchange(self, now: float) -> None:
        for name, (terminal, device) in self._ports.items():
            received = terminal.read()
            if received:
                device.receive(received, now)
            terminal.write(b"".join(data for _, data in device.transmit(now)))
            if name == BOARD and self._driven:
                self._simulation.arena.advance(now)

    def _stand_still(self, seconds: float) -> None:
        """Leave out a time in which nothing could be simulated, for the world and all in it."""
        self._start += seconds

    def absent(self, name: str, time: float) -> bool:
        """Whether a device is unplugged at `time` (host, s)."""
        now = time - self._start
        return any(start <= now < end for start, end in self._unplugged.get(name, ()))

    def _plug(self, now: float) -> None:
        for name, (terminal, device) in self._ports.items():
            absent = self.absent(name, self._start + now)
            if absent and terminal.plugged:
                terminal.unplug()
            elif not absent and not terminal.plugged:
                terminal.plug()
                if name == LIDAR:  # it has no power of its own and restarts
                    device.receive(self._simulation.lidar_entry.power_on, now)
