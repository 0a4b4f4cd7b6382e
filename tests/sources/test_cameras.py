"""A camera as a source of bearings: pictures of a file are searched, damaged ones reported."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.config import Camera, Cameras
from host.drivers.camera import driver
from host.messages import Bearings, Health, Message
from host.sources.cameras import StripCamera, camera_sources

WIDTH, HEIGHT = 384, 208


def jpeg(seed: int) -> bytes:
    cells = np.random.default_rng(seed).integers(0, 255, (13, 24, 3), np.uint8)
    return bytes(cv2.imencode(".jpg", cv2.resize(cells, (WIDTH, HEIGHT)))[1])


def messages(path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Message]:
    """What the camera emits until its file is played."""
    monkeypatch.setattr(driver, "_HEALTH_PERIOD_S", 0.25)
    front = Camera(
        source=str(path), width_px=WIDTH, height_px=HEIGHT, rate_hz=100.0, focal_px=122.0
    )
    emitted: list[Message] = []
    stop = threading.Event()

    def emit(message: Message) -> None:
        emitted.append(message)
        if isinstance(message, Health) and "played to its end" in message.reason:
            stop.set()

    StripCamera("front", Cameras(front=front), front).run(emit, stop)
    return emitted


@pytest.mark.parametrize("every", [2, 40])
def test_pictures_with_gaps_are_refused_counted_and_reported_where_they_are_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int
) -> None:
    pictures = [jpeg(k) for k in range(60)]
    for k in range(0, 60, every):
        pictures[k] = pictures[k][:3000] + pictures[k][3300:]
    path = tmp_path / "pictures.mjpeg"
    path.write_bytes(b"".join(pictures))
    emitted = messages(path, monkeypatch)
    torn = len(range(0, 60, every))
    assert sum(isinstance(message, Bearings) for message in emitted) == 60 - torn
    health = [message for message in emitted if isinstance(message, Health)]
    assert health[-1].counts["pictures_torn"] == torn
    many = [h for h in health if not h.ok and "of the pictures arrive torn" in h.reason]
    assert bool(many) == (every == 2)


@pytest.mark.parametrize("grey", [False, True])
def test_pictures_without_colour_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, grey: bool
) -> None:
    path = tmp_path / "pictures.mjpeg"
    flag = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR
    pictures = [cv2.imdecode(np.frombuffer(jpeg(k), np.uint8), flag) for k in range(60)]
    path.write_bytes(b"".join(bytes(cv2.imencode(".jpg", p)[1]) for p in pictures))
    health = [m for m in messages(path, monkeypatch) if isinstance(m, Health)]
    assert any("the pictures are black and white" in h.reason for h in health if not h.ok) == grey


def test_one_camera_of_two_is_said(tmp_path: Path) -> None:
    path = tmp_path / "pictures.mjpeg"
    path.write_bytes(b"".join(jpeg(k) for k in range(60)))
    front = Camera(source=str(path), width_px=WIDTH, height_px=HEIGHT, rate_hz=40.0, focal_px=122.0)
    stop, said = threading.Event(), list[str]()

    def emit(message: Message) -> None:
        if isinstance(message, Health):
            said.append(message.reason)
            stop.set()

    camera_sources(Cameras(front=front))["front camera"].run(emit, stop)
    assert "the rear camera has no source" in said[0]
