"""Streams of rendered pictures: whole, in time, and through the real driver and search."""

import math
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.config import Camera, Cameras, RobotConfig
from host.drivers.camera.driver import CameraDriver, Picture
from host.drivers.camera.mjpeg import Splitter
from host.messages import Health
from host.perception.strips.finder import StripFinder
from host.simulation.devices.live_cameras import LiveCameras, PictureFeed
from host.simulation.live import LiveSimulation
from host.simulation.pictures.render import Surroundings
from host.simulation.world.scenarios import Scenario, parse_scenario

LONG_S = 20.0  # a bound on waiting, not on speed
FIRST_RAD, SPEED_RADPS = -1.2, 0.3
SMALL = Camera(width_px=640, height_px=360, focal_px=203.7, centre_x_px=319.5, centre_y_px=179.5)
CAMERAS = Cameras(
    front=SMALL, rear=SMALL.model_copy(update={"x_m": -0.05, "heading_rad": round(math.pi, 4)})
)


def pictures(handle: int) -> Iterator[bytes]:
    """The whole pictures that come, until LONG_S have passed."""
    splitter = Splitter()
    end = time.monotonic() + LONG_S
    while time.monotonic() < end:
        yield from splitter.feed(os.read(handle, 1 << 16))


def passing(when: float) -> Surroundings:
    """A teammate on a circle around the front camera: its bearing tells the time, for 8 s."""
    bearing = FIRST_RAD + SPEED_RADPS * when
    place = [SMALL.x_m + math.cos(bearing), math.sin(bearing)]
    return Surroundings(np.array([place]), np.zeros((0, 2)), np.zeros(3), 2.0)


@pytest.fixture
def streams(tmp_path: Path) -> Iterator[LiveCameras]:
    scenario = Scenario(name="test", camera_hz=10.0, camera_delay_s=0.2)
    start = time.monotonic()
    with LiveCameras(
        tmp_path, scenario, CAMERAS, CAMERAS, passing, time.monotonic, lambda: start
    ) as cameras:
        yield cameras


def test_a_pipe_without_a_reader_takes_nothing_and_blocks_nobody(tmp_path: Path) -> None:
    pipe = PictureFeed(tmp_path / "pipe")
    assert not pipe.listening()
    pipe.write(b"nobody", threading.Event())
    reader = os.open(pipe.path, os.O_RDONLY | os.O_NONBLOCK)
    assert pipe.listening()
    pipe.write(b"somebody", threading.Event())
    assert os.read(reader, 100) == b"somebody"
    os.close(reader)
    pipe.write(b"gone", threading.Event())
    assert not pipe.listening()


def test_a_pipe_sends_more_than_it_holds_to_a_slow_reader_and_gives_up_at_the_end(
    tmp_path: Path,
) -> None:
    pipe, stop = PictureFeed(tmp_path / "pipe"), threading.Event()
    reader = os.open(pipe.path, os.O_RDONLY | os.O_NONBLOCK)
    assert pipe.listening()
    data = os.urandom(300_000)
    writer = threading.Thread(target=pipe.write, args=(data, stop))
    writer.start()
    os.set_blocking(reader, True)
    received = b""
    while len(received) < len(data):
        received += os.read(reader, 7000)
    writer.join(LONG_S)
    assert received == data
    writer = threading.Thread(target=pipe.write, args=(data, stop))
    writer.start()  # and nobody reads
    stop.set()
    writer.join(LONG_S)
    assert not writer.is_alive()
    os.close(reader)
    pipe.close()


def test_the_configuration_reads_the_streams(streams: LiveCameras) -> None:
    for camera, old in ((streams.camera.front, CAMERAS.front), (streams.camera.rear, CAMERAS.rear)):
        assert Path(camera.source).is_fifo()
        assert camera.rate_hz == 10.0
        assert camera.model_copy(update={"source": "none", "rate_hz": 30.0}) == old
    assert streams.camera.front.source != streams.camera.rear.source


def test_pictures_come_no_earlier_than_they_would_and_show_when_they_were_taken(
    tmp_path: Path,
) -> None:
    scenario = Scenario(name="test", camera_hz=10.0, camera_delay_s=0.2)
    start = time.monotonic()
    finder = StripFinder(CAMERAS, SMALL)
    taken = []
    with LiveCameras(
        tmp_path, scenario, CAMERAS, CAMERAS, passing, time.monotonic, lambda: start
    ) as cameras:
        reader = os.open(cameras.camera.front.source, os.O_RDONLY)
        for jpeg, _ in zip(pictures(reader), range(6), strict=False):
            arrived = time.monotonic() - start
            bearings = finder.find(jpeg, 0.0)
            assert bearings is not None
            (bearing,) = bearings.bearings
            taken.append((bearing - FIRST_RAD) / SPEED_RADPS)
            assert taken[-1] + 0.2 < arrived + 0.03  # which the bearing's error makes up
        os.close(reader)
    assert len(taken) == 6
    periods = np.diff(taken) / 0.1
    assert np.all(periods > 0.5)
    assert np.abs(periods - np.rint(periods)).max() < 0.3


def test_a_reader_that_comes_back_gets_whole_pictures_again(streams: LiveCameras) -> None:
    for _ in range(3):
        reader = os.open(streams.camera.rear.source, os.O_RDONLY)
        jpeg = next(pictures(reader))  # after the rest of one that was on its way
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (360, 640, 3)
        os.close(reader)


def test_a_running_simulation_is_seen_by_the_real_driver_and_the_search() -> None:
    config = RobotConfig(camera=CAMERAS)
    scenario = parse_scenario("arena4:seed=3,rendered=1,camera_hz=5")
    found: dict[str, list[tuple[float, float]]] = {"front": [], "rear": []}
    enough = threading.Event()
    with LiveSimulation(scenario, config) as live:
        cameras = live.config.camera

        def watch(name: str, camera: Camera) -> None:
            finder = StripFinder(cameras, camera)

            def take(message: Picture | Health) -> None:
                if isinstance(message, Health):
                    return
                picture = cv2.imdecode(np.frombuffer(message.jpeg, np.uint8), cv2.IMREAD_COLOR)
                assert picture.shape == (360, 640, 3)
                bearings = finder.find(message.jpeg, message.time)
                assert bearings is not None
                # A pipe says when a picture came: up to half a second late on a busy computer.
                times = message.time - np.arange(0.0, 0.5, 0.02)
                places = [live.truth(time).positions for time in times.tolist()]
                truth = np.concatenate(places) - bearings.origin
                true = np.arctan2(truth[:, 1], truth[:, 0])
                for bearing in bearings.bearings:
                    off = np.abs((bearing - true + math.pi) % math.tau - math.pi)
                    found[name].append((message.time, float(off.min())))
                if all(len(each) >= 6 for each in found.values()):
                    enough.set()

            CameraDriver(name, camera, cameras.delay_s).run(take, stop)

        stop = threading.Event()
        threads = [
            threading.Thread(target=watch, args=("front", cameras.front)),
            threading.Thread(target=watch, args=("rear", cameras.rear)),
        ]
        for thread in threads:
            thread.start()
        assert enough.wait(LONG_S), found
        stop.set()
        for thread in threads:
            thread.join(LONG_S)
    errors = [error for each in found.values() for _, error in each]
    assert np.median(errors) < math.radians(3.0)
