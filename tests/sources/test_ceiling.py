"""The ceiling camera end to end: a file of pictures in, true poses out."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.config import Ceiling, parse_config
from host.drivers.natnet.client import MOCAP
from host.errors import UserError
from host.messages import Bodies, Health, Message
from host.sources.ceiling import CeilingCamera
from host.sources.rig import real_rig
from tests.perception.drawn_tags import draw

pytestmark = pytest.mark.skipif(not hasattr(cv2, "aruco"), reason="this OpenCV came without ArUco")
PATIENCE_S = 30.0
CAMERA = Ceiling().eye.model_copy(
    update={"width_px": 640, "height_px": 480, "focal_px": 900.0, "rate_hz": 20.0}
    | {"centre_x_px": 319.5, "centre_y_px": 239.5}
)
CEILING = Ceiling(eye=CAMERA)


def recorded(path: Path, pictures: int = 6, times: int = 1) -> Ceiling:
    """A file of pictures of tag 3, that drives ahead by 20 mm a picture, and of tag 8.

    All of it stands in the file so many `times`.
    """
    with path.open("wb") as file:
        for k in range(pictures):
            tags = {3: (-0.1 + 0.02 * k, 0.2, 0.3 + 0.1 * k), 8: (0.1, -0.3, -3.0)}
            jpeg = cv2.imencode(".jpg", draw(CEILING, tags, k), [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
            file.write(bytes(jpeg))
    path.write_bytes(times * path.read_bytes())
    return CEILING.model_copy(update={"eye": CAMERA.model_copy(update={"source": str(path)})})


@contextmanager
def running(ceiling: Ceiling) -> Iterator[list[Message]]:
    messages: list[Message] = []
    stop = threading.Event()
    thread = threading.Thread(target=CeilingCamera(ceiling).run, args=(messages.append, stop))
    thread.start()
    try:
        yield messages
    finally:
        stop.set()
        thread.join()


def wait_health(messages: list[Message], words: str) -> Health:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        for message in list(messages):
            if isinstance(message, Health) and words in message.reason:
                return message
        time.sleep(0.01)
    raise AssertionError([m for m in messages if isinstance(m, Health)])


def bodies(messages: list[Message]) -> list[Bodies]:
    return [message for message in messages if isinstance(message, Bodies)]


def test_a_file_of_pictures_becomes_paths_on_the_floor(tmp_path: Path) -> None:
    with running(recorded(tmp_path / "ceiling.mjpeg")) as messages:
        end = time.monotonic() + PATIENCE_S
        while len(bodies(messages)) < 6 and time.monotonic() < end:
            time.sleep(0.01)
    frames = bodies(messages)[:6]
    assert np.diff([frame.time for frame in frames]) == pytest.approx(np.full(5, 0.05))
    for k, frame in enumerate(frames):
        assert frame.identities.tolist() == [3, 8]
        truth = np.array([[-0.1 + 0.02 * k, 0.2, 0.3 + 0.1 * k], [0.1, -0.3, -3.0]])
        assert frame.poses[:, :2] == pytest.approx(truth[:, :2], abs=1e-3)
        assert np.degrees(frame.poses[:, 2] - truth[:, 2]) == pytest.approx(0.0, abs=1.0)


def test_health_counts_the_tags_under_the_name_of_motion_capture(tmp_path: Path) -> None:
    with running(recorded(tmp_path / "ceiling.mjpeg", 2, 20)) as messages:
        health = wait_health(messages, "pictures/s")
    assert (health.device, health.ok) == (MOCAP, True)
    assert health.counts["tags"] >= 2 * health.counts["pictures"] - 4
    assert health.counts["misread"] == health.counts["undecoded"] == 0


def test_tags_of_another_size_are_told_with_what_to_check(tmp_path: Path) -> None:
    ceiling = recorded(tmp_path / "ceiling.mjpeg", 1, 40).model_copy(update={"tag_m": 0.15})
    with running(ceiling) as messages:
        health = wait_health(messages, "tags look")
    assert not health.ok
    assert "mm wide on the floor, not 150 mm" in health.reason
    assert "tag_m" in health.reason.split("\n")[1]


def test_tags_that_cannot_be_so_high_are_told_with_what_to_check(tmp_path: Path) -> None:
    ceiling = recorded(tmp_path / "ceiling.mjpeg", 1, 40)
    above = ceiling.model_copy(update={"tag_height_m": ceiling.eye.z_m + 0.1})
    with running(above) as messages:
        health = wait_health(messages, "seen where none can be")
    assert not health.ok
    assert "tag_height_m" in health.reason.split("\n")[1]


def test_an_opencv_without_tags_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "aruco")
    with pytest.raises(UserError, match=r"pip install"):
        CeilingCamera(CEILING)


def test_a_ceiling_camera_that_nobody_named_is_said_before_a_run() -> None:
    with pytest.raises(UserError, match="no ceiling camera"):
        real_rig(parse_config('[mocap]\nsource = "ceiling"\n'), None)
