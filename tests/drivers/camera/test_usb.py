"""The camera driver on a USB camera that is faked below OpenCV's door."""

import errno
import os
import struct
import threading
import time
from pathlib import Path

import cv2
import pytest

from host.config import Camera
from host.drivers.camera import driver as camera
from host.drivers.camera import usb as camera_v4l2
from host.drivers.camera import v4l2_device
from host.drivers.camera.controls import Controls
from tests.drivers.camera.camera_bench import HEIGHT, WIDTH, Bench, jpeg


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
    camera = Camera(source=str(usb.path), width_px=WIDTH, height_px=HEIGHT, rate_hz=100.0)
    source = camera_v4l2.UsbCamera(camera, Controls(), hours.now)
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
    root = Path(__file__).resolve().parents[3]
    drivers = root / "host" / "drivers"
    said = "".join(path.read_text(encoding="utf-8") for path in drivers.rglob("*.py"))
    page = (root / "docs" / "cameras.md").read_text(encoding="utf-8")
    table = page.partition("| Health says |")[2].splitlines()[2:]
    words = [row.split("`")[1] for row in table if row.startswith("| `")]
    assert len(words) > 15
    assert [phrase for phrase in words if phrase not in said] == []
