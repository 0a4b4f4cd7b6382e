"""The camera driver on real files and pipes."""

import os
import struct
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.config import Camera
from host.drivers.camera import driver
from host.drivers.camera.driver import CameraDriver, Picture
from host.drivers.camera.files import CameraFrame, Pipe
from host.messages import Health
from tests.drivers.camera.camera_bench import HEIGHT, WIDTH, Bench, jpeg

# Files


def test_an_mjpeg_file_is_played_once_at_its_rate(bench: Bench, tmp_path: Path) -> None:
    sent = [jpeg(k) for k in range(30)]
    path = tmp_path / "pictures.mjpeg"
    path.write_bytes(b"".join(sent))
    begin = time.monotonic()
    bench.run(path, delay_s=50.0, rate_hz=100.0)
    health = bench.wait_reason(f"{path} is played to its end")
    assert [picture.jpeg for picture in bench.pictures()] == sent
    assert [picture.sequence for picture in bench.pictures()] == list(range(30))
    times = [picture.time for picture in bench.pictures()]
    assert np.diff(times) == pytest.approx(0.01)
    assert begin <= times[0] < begin + 40.0  # a recording has no delay to take off
    assert health.counts == {"pictures": 30, "torn": 0, "wrong_size": 0, "connections": 1}
    assert any(h.ok and f"played from {path}" in h.reason for h in bench.health())


def write_avi(path: Path, count: int, rate_hz: float, codec: str = "MJPG") -> None:
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter_fourcc(*codec), rate_hz, (WIDTH, HEIGHT)
    )
    assert writer.isOpened()
    for k in range(count):
        writer.write(cv2.imdecode(np.frombuffer(jpeg(k), np.uint8), cv2.IMREAD_COLOR))
    writer.release()


def test_an_avi_is_played_at_its_own_rate_and_as_another_reader_sees_it(
    bench: Bench, tmp_path: Path
) -> None:
    path = tmp_path / "pictures.avi"
    write_avi(path, 12, 50.0)
    bench.run(path, rate_hz=1.0)
    bench.wait(lambda: len(bench.pictures()) == 12)
    assert np.diff([picture.time for picture in bench.pictures()]) == pytest.approx(0.02)
    reader = cv2.VideoCapture(str(path), cv2.CAP_OPENCV_MJPEG)
    for picture in bench.pictures():
        ours = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
        done, theirs = reader.read()
        assert done
        assert np.array_equal(ours, theirs)
    assert not reader.read()[0]


def test_an_avi_that_breaks_off_gives_what_is_whole(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "pictures.avi"
    write_avi(path, 6, 100.0)
    whole = path.read_bytes()
    fifth = [k for k in range(len(whole)) if whole.startswith(b"00dc", k)][4]
    path.write_bytes(whole[: fifth + 500])
    bench.run(path)
    health = bench.wait_reason("is played to its end")
    assert len(bench.pictures()) == 4
    assert health.counts["torn"] == 1


def chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + b"\0" * (len(content) % 2)


def avi_file(codec: bytes, chunks: list[bytes], rate: int = 100) -> bytes:
    """An AVI built by the book: a sound stream first, then the video, then a second RIFF."""
    sound = chunk(b"strh", b"auds" + bytes(44)) + chunk(b"strf", bytes(18))
    head = b"vids" + codec + bytes(12) + struct.pack("<2I", 1, rate) + bytes(20)
    form = struct.pack("<3I2H", 40, WIDTH, HEIGHT, 1, 24) + codec + bytes(20)
    video = chunk(b"strh", head) + chunk(b"strf", form)
    lists = [chunk(b"LIST", b"strl" + stream) for stream in (sound, video)]
    header = chunk(b"LIST", b"hdrl" + chunk(b"avih", bytes(56)) + b"".join(lists))
    half = len(chunks) // 2
    first = chunk(b"JUNK", jpeg(99)) + chunk(b"LIST", b"movi" + b"".join(chunks[:half]))
    more = chunk(b"LIST", b"movi" + chunk(b"LIST", b"rec " + b"".join(chunks[half:])))
    return chunk(b"RIFF", b"AVI " + header + first) + chunk(b"RIFF", b"AVIX" + more)


def test_an_avi_with_sound_gaps_and_two_parts(bench: Bench, tmp_path: Path) -> None:
    a, b, c = jpeg(1), jpeg(2), jpeg(3)
    chunks = [
        chunk(b"00wb", jpeg(50)),
        chunk(b"01dc", a),
        chunk(b"01dc", b""),
        chunk(b"00wb", bytes(101)),
        chunk(b"01db", b + bytes(7)),
        chunk(b"01dc", c),
    ]
    path = tmp_path / "film"
    path.write_bytes(avi_file(b"MJPG", chunks))
    bench.run(path, rate_hz=1.0)
    bench.wait(lambda: len(bench.pictures()) == 3)
    assert [picture.jpeg for picture in bench.pictures()] == [a, b, c]
    assert np.diff([picture.time for picture in bench.pictures()]) == pytest.approx([0.02, 0.01])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "it is empty"),
        (b"hello, this is no picture", "neither JPEG pictures in a row nor an AVI"),
        (avi_file(b"H264", []), "its video is H264, not MJPG"),
        (b"RIFF\0\0\0\0AVI ", "its video is nothing"),
        (b"\xff\xd8 and then nothing of use", "is played to its end"),
    ],
)
def test_files_that_cannot_be_played(
    bench: Bench, tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    bench.run(path)
    bench.wait_reason(words)
    assert not bench.pictures()


def test_things_that_are_no_source(bench: Bench, tmp_path: Path) -> None:
    bench.run(tmp_path)
    bench.wait_reason("neither a camera nor a pipe nor a file")


def test_a_device_that_is_no_camera(bench: Bench) -> None:
    bench.run("/dev/null")
    bench.wait_reason("/dev/null gives no pictures")


def test_no_source_is_no_camera() -> None:
    emitted: list[object] = []
    CameraDriver("front camera", Camera(), 0.0).run(emitted.append, threading.Event())
    assert not emitted


def test_a_missing_file_is_waited_for(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "later.mjpeg"
    bench.run(path)
    bench.wait_reason(f"there is no {path}")
    part = tmp_path / "part"
    part.write_bytes(jpeg(1))
    part.rename(path)
    bench.wait(lambda: len(bench.pictures()) == 1)


def test_pictures_of_another_size_are_kept_out(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "pictures.mjpeg"
    path.write_bytes(b"".join(jpeg(k, 80, 48) for k in range(60)))
    bench.run(path)
    health = bench.wait_reason("its pictures are 80x48, but robot.toml says 64x64")
    assert not bench.pictures()
    assert health.counts["wrong_size"] > 0
    bench.wait(lambda: bench.health()[-1].counts["wrong_size"] >= 60)
    assert bench.health()[-1].counts["wrong_size"] == 60


# Pipes


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


def test_a_writer_comes_goes_and_comes_back(bench: Bench, pipe: Path) -> None:
    bench.run(pipe, delay_s=0.25)
    bench.wait_reason(f"no program writes into {pipe}")
    with pipe.open("wb", buffering=0) as writer:
        for k in range(3):
            before = time.monotonic()
            writer.write(jpeg(k))
            bench.wait(lambda k=k: len(bench.pictures()) == k + 1)
            assert before - 0.25 <= bench.pictures()[-1].time <= time.monotonic() - 0.25
        writer.write(jpeg(3)[:100])
        bench.wait_reason("sends no pictures")
    count = len(bench.health())
    bench.wait(lambda: any("no program writes" in h.reason for h in bench.health()[count:]))
    with pipe.open("wb", buffering=0) as writer:
        writer.write(jpeg(4))
        bench.wait(lambda: len(bench.pictures()) == 4)
        bench.wait_reason("pictures/s", ok=True)
    assert [picture.jpeg for picture in bench.pictures()] == [jpeg(k) for k in (0, 1, 2, 4)]
    assert [picture.sequence for picture in bench.pictures()] == [0, 1, 2, 3]
    assert bench.health()[-1].counts["torn"] == 1


def test_of_pictures_that_came_together_the_newest_is_taken(bench: Bench, pipe: Path) -> None:
    together = [jpeg(k) for k in range(3)]
    data = b"".join(together)
    assert len(data) < 65536  # a pipe's capacity: the write is one piece
    bench.run(pipe)
    with pipe.open("wb", buffering=0) as writer:
        writer.write(data)
        bench.wait(lambda: bool(bench.pictures()))
        assert bench.pictures()[-1].jpeg == together[-1]
        bench.wait(lambda: any(h.counts.get("superseded") == 2 for h in bench.health()))


def test_pictures_without_end_marks_have_the_time_of_their_own_bytes(pipe: Path) -> None:
    now, stop = [0.0], threading.Event()
    source, times = Pipe(str(pipe), lambda: now[0]), []
    with pipe.open("wb", buffering=0) as writer:
        for k in range(4):
            now[0] = float(k)
            writer.write(jpeg(k)[:-2])
            frame = source.read(stop)
            times.append(frame and frame.time)
    source.close()
    assert times == [None, 0.0, 1.0, 2.0]  # not when the next one began


def test_a_pipe_that_is_made_anew_is_opened_anew(bench: Bench, pipe: Path) -> None:
    bench.run(pipe)
    with pipe.open("wb", buffering=0) as writer:
        writer.write(jpeg(0))
        bench.wait(lambda: len(bench.pictures()) == 1)
    pipe.unlink()
    bench.wait_reason(f"the pipe {pipe} was removed")
    os.mkfifo(pipe)
    with pipe.open("wb", buffering=0) as writer:
        writer.write(jpeg(1))
        bench.wait(lambda: len(bench.pictures()) == 2)


def test_a_writer_of_something_else(bench: Bench, pipe: Path) -> None:
    bench.run(pipe)
    with pipe.open("wb", buffering=0) as writer:
        writer.write(b"no picture " * 1000)
        bench.wait_reason("sends no pictures")


# A USB camera, faked at the two places where the drivers touch the system: OpenCV and ioctl


# More pictures than are needed


class Stamped:
    """A source of pictures at given times, which ends the run after the last."""

    def __init__(self, times: list[float], live: bool) -> None:
        self.counts = {"torn": 0}
        self.live = live
        self._frames = [CameraFrame(jpeg(k), time) for k, time in enumerate(times)]

    def read(self, stop: threading.Event) -> CameraFrame:
        frame = self._frames.pop(0)
        if not self._frames:
            stop.set()
        return frame

    def remarks(self) -> list[str]:
        return []

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("rate_hz", "live", "emitted"),
    [(30.0, True, 30), (30.0, False, 60), (12.0, True, 60), (25.0, True, 30)],
)
def test_no_more_pictures_than_needed_are_emitted_of_what_comes_live(
    rate_hz: float, live: bool, emitted: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    jitter = np.random.default_rng(3).uniform(-0.1, 0.1, 60)
    times = list((100.0 + np.arange(60) + jitter) / rate_hz)
    monkeypatch.setattr(driver, "open_source", lambda *_: Stamped(times, live))
    config = Camera(source="camera", width_px=WIDTH, height_px=HEIGHT, rate_hz=rate_hz)
    taken: list[Picture | Health] = []
    CameraDriver("front camera", config, 0.0, most_hz=15.0).run(taken.append, threading.Event())
    pictures = [message for message in taken if isinstance(message, Picture)]
    step = 60 // emitted
    assert [picture.time for picture in pictures] == times[::step]
    assert [picture.sequence for picture in pictures] == list(range(emitted))
