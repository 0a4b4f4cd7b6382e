"""Robots of simulated devices on pseudo-terminals, pipes and sockets, for the doctor to examine."""

import contextlib
import itertools
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from host.config import Camera, Cameras, RobotConfig
from host.drivers.natnet.client import MOCAP, NatNetClient
from host.drivers.romeo.device import Romeo
from host.drivers.x4.device import X4
from host.messages import FloatArray
from host.pipeline import Source
from host.simulation.devices.catalogue import Emulator
from host.simulation.devices.live_cameras import PictureFeed
from host.simulation.devices.natnet_server import NatNetServer
from host.simulation.devices.romeo_stand_in import RomeoStandIn
from host.simulation.devices.x4 import X4Emulator
from host.simulation.live import LiveSimulation, Terminal
from host.sources.cameras import camera_sources
from host.sources.rig import Rig
from tests.drivers.camera.fake_camera import FakeCamera

PUMP_S = 0.01
WIDTH, HEIGHT = 320, 240
CAMERA = Camera(
    width_px=WIDTH, height_px=HEIGHT, rate_hz=1.0, focal_px=100.0, centre_x_px=160, centre_y_px=120
)


def room(times: FloatArray, raw_angles: FloatArray) -> FloatArray:
    """Ranges of a square room of 3 m around the lidar, with noise."""
    along = np.maximum(np.abs(np.cos(raw_angles)), np.abs(np.sin(raw_angles)))
    noise = np.random.default_rng(int(1e6 * times[0])).normal(0.0, 0.002, len(times))
    return np.asarray(1.5 / along + noise)


def behind_dirt(times: FloatArray, raw_angles: FloatArray) -> FloatArray:
    """The same with dirt on 70 deg of the window, to the robot's right."""
    return np.where(
        np.abs(raw_angles - math.pi / 2) < math.radians(35.0), 0.0, room(times, raw_angles)
    )


class WrongBaud:
    """A device whose bytes are sent at another rate than they are read at.

    The line's level is read in the middle of each bit as the reader times it: 8N1.
    """

    def __init__(self, device: Emulator, sent: int, read: int) -> None:
        self._device, self._ratio = device, sent / read

    def receive(self, data: bytes, now: float) -> None:
        self._device.receive(data, now)

    def transmit(self, now: float) -> list[tuple[float, bytes]]:
        return [(at, self._misread(data)) for at, data in self._device.transmit(now)]

    def _misread(self, data: bytes) -> bytes:
        bits = [b for byte in data for b in (0, *(byte >> k & 1 for k in range(8)), 1)] + [1] * 20
        out, place = [], 0.0
        while True:
            start = next((k for k in range(math.ceil(place), len(bits) - 15) if not bits[k]), None)
            if start is None:
                return bytes(out)
            levels = [bits[int(start + (k + 1.5) * self._ratio)] for k in range(8)]
            out.append(sum(level << k for k, level in enumerate(levels)))
            place = start + 9.5 * self._ratio


class Bench:
    """Terminals and feeds that a thread keeps going from entry to exit of its `with` block."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._ports: list[tuple[Terminal, Emulator]] = []
        self._stop = threading.Event()
        self._stack = contextlib.ExitStack()
        self._names = itertools.count()
        self._threads: list[threading.Thread] = []
        self.stood_still_s = 0.0  # the longest time in which nothing was simulated

    def __enter__(self) -> "Bench":
        self._start(self._pump)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._stack.close()
        for terminal, _device in self._ports:
            terminal.unplug()

    def plug(self, device: Emulator) -> str:
        """A port with the device behind it."""
        terminal = Terminal(self.folder / f"port{next(self._names)}")
        terminal.plug()
        self._ports.append((terminal, device))
        return str(terminal.path)

    def enter(self, context: Any) -> Any:
        return self._stack.enter_context(context)

    def feed(self, picture: Callable[[int], bytes], rate_hz: float = 8.0) -> str:
        """A pipe of pictures, by number."""
        pipe = PictureFeed(self.folder / f"pipe{next(self._names)}")

        def run() -> None:
            number = 0
            while not self._stop.wait(1.0 / rate_hz):
                if pipe.listening():
                    pipe.write(picture(number), self._stop)
                    number += 1
            pipe.close()

        self._start(run)
        return str(pipe.path)

    def _start(self, work: Callable[[], None]) -> None:
        thread = threading.Thread(target=work, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _pump(self) -> None:
        begin, now = time.monotonic(), 0.0
        while not self._stop.wait(PUMP_S):
            before, now = now, time.monotonic() - begin
            self.stood_still_s = max(self.stood_still_s, now - before)
            for terminal, device in list(self._ports):
                received = terminal.read()
                if received:
                    device.receive(received, now)
                terminal.write(b"".join(data for _, data in device.transmit(now)))


def lidar_rig(port: str) -> Rig:
    """A robot that has a lidar only."""
    config = RobotConfig()
    config = config.model_copy(update={"lidar": config.lidar.model_copy(update={"port": port})})
    return Rig("lidar", config, "lidar", {"lidar": X4(config.lidar)})


def x4(sense: Callable[[FloatArray, FloatArray], FloatArray] = room, **faults: Any) -> X4Emulator:
    emulator = X4Emulator(sense, seed=3)
    for name, value in faults.items():
        assert hasattr(emulator, name)
        setattr(emulator, name, value)
    return emulator


def board_rig(port: str, **wheels: int) -> Rig:
    """A robot that has a board only. wheels: settings of [wheels]."""
    config = RobotConfig()
    board = config.board.model_copy(update={"port": port})
    config = config.model_copy(
        update={"board": board, "wheels": config.wheels.model_copy(update=wheels)}
    )
    return Rig("board", config, "lidar", {"board": Romeo(config)})


def board(**faults: Any) -> RomeoStandIn:
    stand_in = RomeoStandIn(lambda time: (0, 0))
    for name, value in faults.items():
        assert hasattr(stand_in, name)
        setattr(stand_in, name, value)
    return stand_in


def picture(number: int, brightness: float = 1.0) -> bytes:
    """A JPEG of a room that moves a little, with noise."""
    random = np.random.default_rng(number)
    x = np.arange(WIDTH) + number
    rows = 120.0 + 60.0 * np.sin(x / 25.0) + random.normal(0.0, 4.0, (HEIGHT, WIDTH))
    image = np.clip(brightness * rows, 0, 255).astype(np.uint8)
    coloured = (image[:, :, None] * np.array([0.7, 0.9, 1.0])).astype(np.uint8)
    return bytes(cv2.imencode(".jpg", coloured)[1])


def camera_rig(source: str, **settings: Any) -> Rig:
    """A robot that has a front camera only. settings: of [camera.front]."""
    cameras = Cameras(front=CAMERA.model_copy(update={"source": source, **settings}))
    config = RobotConfig(camera=cameras)
    return Rig("camera", config, "lidar+camera", camera_sources(cameras))


def usb_camera_rig(fake: FakeCamera) -> Rig:
    """A robot that has a front camera only, behind the kernel's ioctls."""
    width, height = fake.size
    camera = CAMERA.model_copy(
        update={
            "source": str(fake.path),
            "width_px": width,
            "height_px": height,
            "centre_x_px": 0.5 * width,
            "centre_y_px": 0.5 * height,
        }
    )
    cameras = Cameras(front=camera)
    return Rig("camera", RobotConfig(camera=cameras), "lidar+camera", camera_sources(cameras))


def swarm_rig(live: LiveSimulation) -> Rig:
    """The whole robot of a scenario."""
    config = live.config
    sources: dict[str, Source] = {
        "lidar": X4(config.lidar),
        "board": Romeo(config),
        MOCAP: NatNetClient(config.mocap.natnet),
        "camera": live.camera,
    }
    return Rig("robot", config, "lidar+camera", sources)


def one_body(time: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([1]), np.array([[1.0, 2.0, 0.5]])


def mocap_rig(server: NatNetServer) -> Rig:
    """A robot that has motion capture only."""
    return Rig("mocap", RobotConfig(), "lidar", {MOCAP: NatNetClient(server.config)})


@contextlib.contextmanager
def frames_from_elsewhere(server: NatNetServer) -> Iterator[None]:
    """Sends what Motive would to the group, but from another address of this computer."""
    stop = threading.Event()

    def run() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.2", 0))
            local = socket.inet_aton("127.0.0.1")
            other.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, local)
            while not stop.wait(0.05):
                where = server.config.multicast_group, server.config.data_port
                other.sendto(b"frame of another", where)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
