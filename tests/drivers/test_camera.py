"""The camera driver on real files and pipes, and on a camera that is faked below OpenCV's door."""

import errno
import os
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.config import Eye
from host.drivers import camera, camera_v4l2, v4l2_device
from host.drivers.camera import CameraDriver, Picture
from host.drivers.camera_controls import Controls
from host.messages import Health

WIDTH, HEIGHT = 64, 64
PATIENCE_S = 20.0


def jpeg(number: int, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    image = np.random.default_rng(number).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return bytes(cv2.imencode(".jpg", image)[1])


class Bench:
    """A driver in its thread, and what it emitted."""

    def __init__(self) -> None:
        self.messages: list[Picture | Health] = []
        self.errors: list[BaseException] = []
        self.stop = threading.Event()
        self._thread: threading.Thread | None = None

    def run(self, source: object, delay_s: float = 0.0, **settings: object) -> None:
        eye = Eye(
            source=str(source),
            **{"width_px": WIDTH, "height_px": HEIGHT, "rate_hz": 200.0, **settings},  # type: ignore[arg-type]
        )
        driver = CameraDriver("front camera", eye, delay_s)
        self._thread = threading.Thread(target=self._drive, args=(driver,))
        self._thread.start()

    def _drive(self, driver: CameraDriver) -> None:
        try:
            driver.run(self.messages.append, self.stop)
        except BaseException as error:
            self.errors.append(error)
            raise

    def pictures(self) -> list[Picture]:
        return [message for message in self.messages if isinstance(message, Picture)]

    def health(self) -> list[Health]:
        return [message for message in self.messages if isinstance(message, Health)]

    def wait(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, self.messages[-1:]
            assert not self.errors
            time.sleep(0.005)

    def wait_reason(self, words: str, ok: bool = False) -> Health:
        found: list[Health] = []

        def seen() -> bool:
            found[:] = [h for h in self.health() if words in h.reason and h.ok == ok]
            return bool(found)

        self.wait(seen)
        assert found[-1].device == "front camera"
        return found[-1]

    def close(self) -> None:
        self.stop.set()
        if self._thread is not None:
            self._thread.join()
        assert not self.errors


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(camera, "_HEALTH_PERIOD_S", 0.1)
    monkeypatch.setattr(camera_v4l2, "SETTLE_S", 0.05)
    rig = Bench()
    yield rig
    rig.close()


# Files


def test_an_mjpeg_file_is_played_once_at_its_rate(bench: Bench, tmp_path: Path) -> None:
    sent = [jpeg(k) for k in range(30)]
    path = tmp_path / "pictures.mjpeg"
    path.write_bytes(b"".join(sent))
    bench.run(path, delay_s=0.5, rate_hz=100.0)
    health = bench.wait_reason(f"{path} is played to its end")
    assert [picture.jpeg for picture in bench.pictures()] == sent
    assert [picture.sequence for picture in bench.pictures()] == list(range(30))
    times = [picture.time for picture in bench.pictures()]
    assert np.diff(times) == pytest.approx(0.01)
    assert times[0] > bench.health()[0].time - 1.0  # a recording has no delay to take off
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
    CameraDriver("front camera", Eye(), 0.0).run(emitted.append, threading.Event())
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


class FakeCamera:
    """What is plugged in: its controls, its pictures, and how it fails."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fourcc, self.size, self.rate_hz = v4l2_device.MJPG, (WIDTH, HEIGHT), 100.0
        self.controls: dict[int, float] = {
            cv2.CAP_PROP_AUTO_EXPOSURE: 3.0,
            cv2.CAP_PROP_EXPOSURE: 157.0,
            cv2.CAP_PROP_AUTO_WB: 1.0,
            cv2.CAP_PROP_WB_TEMPERATURE: 4600.0,
            cv2.CAP_PROP_GAIN: 12.0,
        }
        self.refused: set[int] = set()
        self.refuses_open = False
        self.ioctl_errors: dict[int, int] = {}
        self.capabilities = 1
        self.stamp_offset = 0.0
        self.padding = b""
        self.now, self.sleep = time.monotonic, time.sleep
        self.waiting = 0  # pictures that came while nobody looked
        self.opened = 0
        self.ioctls: list[int] = []
        self.plug()

    def plug(self) -> None:
        self.path.touch()

    def unplug(self) -> None:
        self.path.unlink()

    def capture(self, path: str) -> "FakeCapture":
        assert path == str(self.path)
        return FakeCapture(self)

    def ioctl(self, device: int, request: int, data: bytes) -> bytes:
        """As the kernel answers, by linux/videodev2.h on a 64-bit machine."""
        self.ioctls.append(request)
        if request in self.ioctl_errors:
            number = self.ioctl_errors[request]
            raise OSError(number, os.strerror(number))
        if request == v4l2_device.QUERYCAP:
            return bytes(84) + struct.pack("2I", 1 | 1 << 31, self.capabilities) + bytes(12)
        if request == v4l2_device.S_FMT:
            kind, width, height, code = struct.unpack_from("<I4x3I", data)
            assert (kind, width, height) == (1, WIDTH, HEIGHT)
            assert code == int.from_bytes(b"MJPG", "little")
            return struct.pack("<I4x3I", 1, *self.size, self.fourcc).ljust(208, b"\0")
        return data


class FakeCapture:
    """One opening of it, as `camera_v4l2.Capture` is."""

    def __init__(self, camera: FakeCamera) -> None:
        self._camera = camera
        self._count = 0
        self._stamp = 0.0
        self.opened = camera.path.exists() and not camera.refuses_open
        camera.opened += self.opened

    @property
    def _there(self) -> bool:
        return self.opened and self._camera.path.exists()

    def get(self, control: int) -> float:
        fixed = {
            cv2.CAP_PROP_FOURCC: float(self._camera.fourcc),
            cv2.CAP_PROP_FRAME_WIDTH: float(self._camera.size[0]),
            cv2.CAP_PROP_FRAME_HEIGHT: float(self._camera.size[1]),
            cv2.CAP_PROP_FPS: self._camera.rate_hz,
            cv2.CAP_PROP_POS_MSEC: 1000.0 * self._stamp,
        }
        return fixed.get(control, self._camera.controls.get(control, -1.0))

    def set(self, control: int, value: float) -> bool:
        if not self._there or control in self._camera.refused:
            return False
        if control in self._camera.controls:
            self._camera.controls[control] = value
        return True

    def grab(self) -> bool:
        if not self._there or v4l2_device.STREAMON in self._camera.ioctl_errors:
            return False
        if self._camera.waiting:
            self._camera.waiting -= 1
            age = (self._camera.waiting + 0.5) / self._camera.rate_hz
        else:
            self._camera.sleep(1.0 / self._camera.rate_hz)
            age = 0.001
        self._stamp = self._camera.now() - age
        self._stamp += self._camera.stamp_offset
        self._count += 1
        return True

    def retrieve(self) -> bytes:
        return jpeg(self._count, *self._camera.size) + self._camera.padding

    def close(self) -> None:
        self.opened = False


@pytest.fixture
def usb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCamera:
    fake = FakeCamera(tmp_path / "video0")
    monkeypatch.setattr(camera, "is_video_device", lambda path: os.stat(path) is not None)
    monkeypatch.setattr(camera_v4l2, "Capture", fake.capture)
    monkeypatch.setattr(v4l2_device, "_ask", fake.ioctl)
    return fake


def test_a_camera_gives_pictures_at_the_kernels_time_less_the_delay(
    bench: Bench, usb: FakeCamera
) -> None:
    usb.padding = bytes(37)  # cameras fill their buffers up
    start = time.monotonic()
    bench.run(usb.path, delay_s=5.0)
    health = bench.wait_reason("exposure, white balance and gain held", ok=True)
    bench.wait(lambda: len(bench.pictures()) > 5)
    for picture in bench.pictures():
        assert start - 5.0 < picture.time < time.monotonic() - 5.0
        assert picture.jpeg.endswith(b"\xff\xd9")
    assert "pictures/s" in health.reason
    assert health.counts["connections"] == 1
    assert "bad_stamps" not in health.counts


def test_its_controls_are_held_while_it_runs_and_let_go_at_the_end(
    bench: Bench, usb: FakeCamera
) -> None:
    before = dict(usb.controls)
    bench.run(usb.path)
    bench.wait_reason("held", ok=True)
    held = dict(usb.controls)
    bench.close()
    assert held == {**before, cv2.CAP_PROP_AUTO_EXPOSURE: 1.0, cv2.CAP_PROP_AUTO_WB: 0.0}
    assert usb.controls == before


def test_automatics_are_given_back_after_a_camera_hung_and_was_opened_anew(
    bench: Bench, usb: FakeCamera
) -> None:
    before = dict(usb.controls)
    bench.run(usb.path)
    bench.wait_reason("held", ok=True)
    usb.ioctl_errors = {v4l2_device.STREAMON: errno.EIO}
    bench.wait_reason("does not answer on its USB cable")
    usb.ioctl_errors = {}
    bench.wait(lambda: usb.opened == 2 and bench.health()[-1].ok)
    assert usb.controls[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0
    bench.close()
    assert usb.controls == before


def test_controls_that_a_user_had_set_are_left_alone(bench: Bench, usb: FakeCamera) -> None:
    usb.controls[cv2.CAP_PROP_AUTO_EXPOSURE] = 1.0
    usb.controls[cv2.CAP_PROP_EXPOSURE] = 30.0
    bench.run(usb.path)
    bench.wait_reason("held", ok=True)
    bench.close()
    assert usb.controls[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0
    assert usb.controls[cv2.CAP_PROP_EXPOSURE] == 30.0


def test_controls_that_refuse_are_named_and_the_pictures_go_on(
    bench: Bench, usb: FakeCamera
) -> None:
    usb.refused = {cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_WB_TEMPERATURE}
    del usb.controls[cv2.CAP_PROP_GAIN]
    bench.run(usb.path)
    health = bench.wait_reason("exposure not held: the camera keeps it automatic", ok=True)
    assert "white balance not held: the camera refuses the setting" in health.reason
    assert "gain not held: the camera has no such control" in health.reason


def test_unplugged_and_plugged_in_again_its_colours_are_the_same(
    bench: Bench, usb: FakeCamera
) -> None:
    bench.run(usb.path)
    bench.wait_reason("held", ok=True)
    usb.unplug()
    health = bench.wait_reason("no such camera is plugged in")
    assert f"cannot open {usb.path}" in health.reason
    usb.controls |= {cv2.CAP_PROP_AUTO_EXPOSURE: 3.0, cv2.CAP_PROP_EXPOSURE: 500.0}
    count = len(bench.pictures())
    usb.plug()
    bench.wait(lambda: len(bench.pictures()) > count + 2)
    assert usb.controls[cv2.CAP_PROP_EXPOSURE] == 157.0
    assert usb.controls[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0
    sequences = [picture.sequence for picture in bench.pictures()]
    assert sequences == list(range(len(sequences)))
    bench.wait(lambda: bench.health()[-1].counts["connections"] == 2)


class Hours:
    """A clock that goes on only where somebody sleeps."""

    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds


@pytest.mark.parametrize(("offset", "first"), [(0.0, 3), (1e6, 4)])
def test_only_the_newest_of_waiting_pictures_is_taken(
    usb: FakeCamera, offset: float, first: int
) -> None:
    """Without time stamps that tell, the newest is the one that had to be waited for."""
    hours = Hours()
    usb.now, usb.sleep = hours.now, hours.sleep
    usb.stamp_offset = offset
    eye = Eye(source=str(usb.path), width_px=WIDTH, height_px=HEIGHT, rate_hz=100.0)
    source = camera_v4l2.UsbCamera(eye, Controls(), hours.now)
    usb.waiting = 3
    stop = threading.Event()
    frames = [source.read(stop) for _ in range(3)]
    assert [frame.jpeg for frame in frames if frame] == [jpeg(first + k) for k in range(3)]
    assert source.counts["superseded"] == first - 1
    ages = [hours.time - frame.time for frame in frames if frame]
    assert ages[-1] == pytest.approx(0.001 if not offset else 0.0)


@pytest.mark.parametrize("offset", [-1e6, 3.0])
def test_time_stamps_of_another_clock_are_not_believed(
    bench: Bench, usb: FakeCamera, offset: float
) -> None:
    usb.stamp_offset = offset
    start = time.monotonic()
    bench.run(usb.path)
    health = bench.wait_reason("its time stamps are of no use: arrival counts", ok=True)
    assert all(start < picture.time <= time.monotonic() for picture in bench.pictures())
    assert health.counts["bad_stamps"] > 0


@pytest.mark.parametrize(
    ("step", "number", "words"),
    [
        (v4l2_device.S_FMT, errno.EBUSY, "another program uses it\nclose it (sudo fuser -v "),
        (v4l2_device.STREAMON, errno.ENOSPC, "USB has no bandwidth left"),
        (v4l2_device.STREAMON, errno.EPROTO, "it does not answer on its USB cable"),
        (v4l2_device.STREAMON, errno.ENODEV, "no such camera is plugged in"),
        (v4l2_device.QUERYCAP, errno.ENOTTY, "it is not a camera"),
        (v4l2_device.REQBUFS, errno.ENOMEM, os.strerror(errno.ENOMEM)),
    ],
)
def test_what_the_kernel_refuses_is_told_and_outlived(
    bench: Bench, usb: FakeCamera, step: int, number: int, words: str
) -> None:
    usb.ioctl_errors = {step: number}
    usb.refuses_open = step != v4l2_device.STREAMON
    bench.run(usb.path)
    bench.wait_reason(words)
    usb.ioctl_errors, usb.refuses_open = {}, False
    bench.wait(lambda: len(bench.pictures()) > 2)


def test_no_permission_comes_with_the_line_to_paste(
    bench: Bench, usb: FakeCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    usb.refuses_open = True
    whole = os.open

    def refuse(path: str, flags: int, *rest: object) -> int:
        if path == str(usb.path):
            raise PermissionError(errno.EACCES, "Permission denied")
        return whole(path, flags, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(v4l2_device.os, "open", refuse)
    bench.run(usb.path)
    bench.wait_reason("this user may not use cameras\nrun: sudo usermod -aG video $USER")


def test_a_camera_without_jpeg(bench: Bench, usb: FakeCamera) -> None:
    usb.fourcc = int.from_bytes(b"YUYV", "little")
    bench.run(usb.path)
    bench.wait_reason("gives no JPEG pictures\nit gives YUYV at this size")


def test_a_camera_without_this_size(bench: Bench, usb: FakeCamera) -> None:
    usb.size = (32, 16)
    bench.run(usb.path)
    bench.wait_reason("gives pictures of 32x16\nrobot.toml says 64x64")


def test_a_cameras_second_device(bench: Bench, usb: FakeCamera) -> None:
    usb.refuses_open, usb.capabilities = True, 0x00A00000
    bench.run(usb.path)
    bench.wait_reason("take the one whose name ends in video-index0")


def test_a_camera_that_starts_but_gives_nothing(bench: Bench, usb: FakeCamera) -> None:
    usb.refuses_open = True
    bench.run(usb.path)
    bench.wait_reason("it starts as it should, but no picture comes")
    assert usb.ioctls[:6] == [
        v4l2_device.QUERYCAP,
        v4l2_device.S_FMT,
        v4l2_device.REQBUFS,
        v4l2_device.QBUF,
        v4l2_device.STREAMON,
        v4l2_device.STREAMOFF,
    ]


def test_torn_pictures_are_blamed_on_the_cable(
    bench: Bench, usb: FakeCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeCapture, "retrieve", lambda capture: jpeg(1)[:-300])
    bench.run(usb.path)
    bench.wait_reason("gives no whole pictures\nits bytes come, but damaged")


def test_the_numbers_of_the_ioctls_are_the_kernels() -> None:
    """As a C compiler gives them from linux/videodev2.h on 64-bit machines."""
    if struct.calcsize("P") != 8:
        pytest.skip("the layouts of a 32-bit machine differ")
    assert v4l2_device.QUERYCAP == 0x80685600
    assert v4l2_device.S_FMT == 0xC0D05605
    assert v4l2_device.REQBUFS == 0xC0145608
    assert v4l2_device.QBUF == 0xC058560F
    assert v4l2_device.STREAMON == 0x40045612
    assert v4l2_device.STREAMOFF == 0x40045613


def test_an_absent_camera_names_those_that_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench: Bench
) -> None:
    for name in ("pci-1-video-index0", "pci-1-video-index1"):
        (tmp_path / name).touch()
    monkeypatch.setattr(v4l2_device, "BY_PATH", tmp_path)
    bench.run("/dev/v4l/by-path/none-such")
    health = bench.wait_reason("no such camera is plugged in")
    assert f"plugged in: {tmp_path}/pci-1-video-index0)" in health.reason


def test_opencvs_own_door_fails_quietly(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "no-camera"
    file.write_bytes(b"nothing")
    for path in ("/dev/no-such-camera", str(file), "/dev/null"):
        capture = camera_v4l2.Capture(path)
        assert not capture.opened
        assert not capture.grab()
        assert capture.retrieve() == b""
        assert not capture.set(cv2.CAP_PROP_EXPOSURE, 1.0)
        capture.close()
    assert capfd.readouterr() == ("", "")


def test_the_words_of_the_docs_are_those_of_the_drivers() -> None:
    root = Path(__file__).resolve().parents[2]
    drivers = root / "host" / "drivers"
    said = "".join(path.read_text(encoding="utf-8") for path in drivers.glob("*.py"))
    page = (root / "docs" / "cameras.md").read_text(encoding="utf-8")
    table = page.partition("| Health says |")[2].splitlines()[2:]
    words = [row.split("`")[1] for row in table if row.startswith("| `")]
    assert len(words) > 15
    assert [phrase for phrase in words if phrase not in said] == []
