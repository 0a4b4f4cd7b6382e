"""The camera driver on a USB camera that is faked at the kernel's ioctls."""

import errno
import os
import struct
import threading
import time
from pathlib import Path

import pytest

from host.config import Camera
from host.drivers.camera import camera_errors, v4l2_device
from host.drivers.camera import driver as camera
from host.drivers.camera import held_controls as c
from host.drivers.camera.controls import Controls
from host.drivers.camera.usb import UsbCamera
from host.errors import UserError
from tests.drivers.camera.camera_bench import HEIGHT, WIDTH, Bench
from tests.drivers.camera.fake_camera import FakeCamera


@pytest.fixture
def usb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCamera:
    fake = FakeCamera(tmp_path / "video0")
    monkeypatch.setattr(camera, "is_video_device", lambda path: os.stat(path) is not None)
    monkeypatch.setattr(v4l2_device, "ask", fake.ioctl)
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
        assert picture.jpeg in usb.sent
    assert "pictures/s" in health.reason
    assert health.counts["connections"] == 1
    assert "bad_stamps" not in health.counts


def test_pictures_are_given_once_exposure_and_white_balance_are_set(
    bench: Bench, usb: FakeCamera
) -> None:
    usb.rate_hz = 60.0
    bench.run(usb.path, rate_hz=60.0)
    said = bench.wait_reason("sets its exposure and white balance\nthis takes some seconds")
    bench.wait(lambda: bool(bench.pictures()))
    assert bench.messages.index(said) < bench.messages.index(bench.pictures()[0])
    assert usb.controls[c.AUTO_WHITE].value == 0


def test_unplugged_and_plugged_in_again_it_has_what_was_chosen(
    bench: Bench, usb: FakeCamera
) -> None:
    usb.light = 0.8
    bench.run(usb.path)
    bench.wait_reason("held", ok=True)
    before = {number: control.value for number, control in usb.controls.items()}
    usb.unplug()
    health = bench.wait_reason("no such camera is plugged in")
    assert f"cannot open {usb.path}" in health.reason
    usb.controls[c.AUTO_EXPOSURE].value, usb.controls[c.EXPOSURE].value = 3, 500
    usb.controls[c.WHITE].value, usb.controls[c.AUTO_WHITE].value = 2500, 1
    count = len(bench.pictures())
    usb.plug()
    bench.wait(lambda: len(bench.pictures()) > count + 2)
    assert {number: control.value for number, control in usb.controls.items()} == before
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


def opened(usb: FakeCamera, rate_hz: float = 100.0) -> tuple[UsbCamera, Hours]:
    """The camera, with all chosen, on a clock of its own."""
    hours = Hours()
    usb.now, usb.sleep = hours.now, hours.sleep
    config = Camera(source=str(usb.path), width_px=WIDTH, height_px=HEIGHT, rate_hz=rate_hz)
    source = UsbCamera(config, Controls(50), hours.now)
    while source.read(threading.Event()) is None:
        pass
    return source, hours


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_only_the_newest_of_waiting_pictures_is_taken(usb: FakeCamera, offset: float) -> None:
    usb.stamp_offset = offset
    source, hours = opened(usb)
    usb.sent.clear()
    usb.waiting = 3
    frames = []
    while len(frames) < 3:
        frame = source.read(threading.Event())
        if frame is not None:
            frames.append(frame)
    assert [frame.jpeg for frame in frames] == usb.sent[2:]
    assert source.counts["superseded"] == 2
    ages = [hours.time - frame.time for frame in frames]
    assert ages[-1] == pytest.approx(0.001 if not offset else 0.0, abs=1e-5)
    source.close()


def test_a_camera_that_does_not_start_is_left_as_it_was_found(usb: FakeCamera) -> None:
    usb.errors[v4l2_device.STREAMON] = errno.ENOSPC
    before = {number: control.value for number, control in usb.controls.items()}
    config = Camera(source=str(usb.path), width_px=WIDTH, height_px=HEIGHT, rate_hz=30.0)
    with pytest.raises(UserError, match="USB has no bandwidth left"):
        UsbCamera(config, Controls(50), time.monotonic)
    assert {number: control.value for number, control in usb.controls.items()} == before


def test_a_computer_that_stood_still_is_not_taken_for_a_silent_camera(
    usb: FakeCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stands still just after the driver has looked and found nothing."""
    source, hours = opened(usb)

    def nothing_came(device: v4l2_device.VideoDevice, seconds: float) -> bool:
        hours.sleep(5.0)
        return False

    with monkeypatch.context() as still:
        still.setattr(v4l2_device.VideoDevice, "wait", nothing_came)
        assert source.read(threading.Event()) is None
    assert source.read(threading.Event()) is not None
    source.close()


def test_of_two_pictures_in_a_buffer_the_newer_one_counts(usb: FakeCamera) -> None:
    source, _ = opened(usb)
    usb.padding = usb.sent[0]
    frame = None
    while frame is None:
        frame = source.read(threading.Event())
    assert frame.jpeg == usb.padding
    assert source.counts["superseded"] == 1
    source.close()


def test_pictures_that_the_driver_lost_or_calls_damaged_are_counted(usb: FakeCamera) -> None:
    source, _ = opened(usb)
    stop = threading.Event()
    number = usb.number
    usb.lost = 2
    while usb.number < number + 9:
        source.read(stop)
    assert source.counts["missed"] == 6
    usb.lost, usb.damaged = 0, True
    given = [source.read(stop) for _ in range(8)]
    assert given == [None] * 8
    assert source.counts["torn"] == usb.number - number - 9
    source.close()


def test_damaged_pictures_are_blamed_on_the_cable(bench: Bench, usb: FakeCamera) -> None:
    usb.damaged = True
    bench.run(usb.path)
    bench.wait_reason("gives no whole pictures\nits bytes come, but damaged")


@pytest.mark.parametrize("offset", [-1e6, 3.0])
def test_time_stamps_of_another_clock_are_not_believed(
    bench: Bench, usb: FakeCamera, offset: float
) -> None:
    usb.stamp_offset = offset
    start = time.monotonic()
    bench.run(usb.path)
    health = bench.wait_reason("its time stamps are unusable: the arrival is used", ok=True)
    assert all(start < picture.time <= time.monotonic() for picture in bench.pictures())
    assert health.counts["bad_stamps"] > 0


@pytest.mark.parametrize(
    ("step", "number", "words"),
    [
        (v4l2_device.S_FMT, errno.EBUSY, "another program uses it\nclose it (sudo fuser -v "),
        (v4l2_device.STREAMON, errno.ENOSPC, "USB has no bandwidth left"),
        (v4l2_device.STREAMON, errno.EPROTO, "it does not answer on its USB cable"),
        (v4l2_device.STREAMON, errno.ENODEV, "no such camera is plugged in"),
        (v4l2_device.DQBUF, errno.EIO, "it does not answer on its USB cable"),
        (v4l2_device.DQBUF, errno.EAGAIN, "it starts as it should, but no picture comes"),
        (v4l2_device.QUERYCAP, errno.ENOTTY, "it is not a camera"),
        (v4l2_device.REQBUFS, errno.ENOMEM, os.strerror(errno.ENOMEM)),
    ],
)
def test_what_the_kernel_refuses_is_told_and_outlived(
    bench: Bench, usb: FakeCamera, step: int, number: int, words: str
) -> None:
    usb.errors = {step: number}
    bench.run(usb.path)
    bench.wait_reason(words)
    usb.errors = {}
    bench.wait(lambda: len(bench.pictures()) > 2)


def test_a_camera_whose_rate_cannot_be_set_is_taken_as_it_is(usb: FakeCamera) -> None:
    usb.errors = {v4l2_device.S_PARM: errno.ENOTTY}
    source, _ = opened(usb)
    source.close()


def test_no_permission_comes_with_the_line_to_paste(
    bench: Bench, usb: FakeCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = os.open

    def refuse(path: str, flags: int, *rest: object) -> int:
        if path == str(usb.path):
            raise PermissionError(errno.EACCES, "Permission denied")
        return whole(path, flags, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(v4l2_device.os, "open", refuse)
    bench.run(usb.path)
    bench.wait_reason("this user may not use it, and no group may\npaste this")


def test_a_camera_without_jpeg(bench: Bench, usb: FakeCamera) -> None:
    usb.fourcc = int.from_bytes(b"YUYV", "little")
    bench.run(usb.path)
    bench.wait_reason("gives no JPEG pictures\nit gives YUYV at this size")


def test_a_camera_without_this_size_says_which_it_has(bench: Bench, usb: FakeCamera) -> None:
    usb.size = (32, 16)
    bench.run(usb.path)
    health = bench.wait_reason("gives pictures of 32x16\nrobot.toml says 64x64")
    assert "it has, as MJPG: 320x240, 32x16; set width_px" in health.reason


def test_a_cameras_second_device(bench: Bench, usb: FakeCamera) -> None:
    usb.capabilities = 0x00A00000
    bench.run(usb.path)
    bench.wait_reason("take the one whose name ends in video-index0")


def test_nothing_is_left_open(usb: FakeCamera) -> None:
    before = len(os.listdir("/proc/self/fd"))
    for step in (v4l2_device.S_FMT, v4l2_device.STREAMON, v4l2_device.QBUF, None):
        usb.errors = {step: errno.EIO} if step else {}
        try:
            source, _ = opened(usb)
        except camera.UserError:
            continue
        source.close()
    assert len(os.listdir("/proc/self/fd")) == before


# Health by what the pictures show


def test_a_frozen_camera_is_reported_and_its_pictures_measure_nothing(
    bench: Bench, usb: FakeCamera
) -> None:
    bench.run(usb.path, rate_hz=30.0)  # which comes on a slow computer, too
    bench.wait(lambda: len(bench.pictures()) > 2)
    usb.frozen = True
    health = bench.wait_reason("the pictures are frozen: the last")
    assert health.counts["repeated"] > 3
    count = len(bench.pictures())
    bench.wait(lambda: bench.health()[-1].counts["repeated"] > health.counts["repeated"] + 20)
    assert len(bench.pictures()) == count
    usb.frozen = False
    bench.wait(lambda: bench.health()[-1].ok)


@pytest.mark.parametrize(
    ("level", "words"),
    [
        (0, "the pictures are black"),
        (255, "of the picture is white"),
        (90, "the pictures show nothing"),
    ],
)
def test_pictures_without_anything_in_them_are_reported(
    bench: Bench, usb: FakeCamera, level: int, words: str
) -> None:
    bench.run(usb.path)
    bench.wait(lambda: len(bench.pictures()) > 2)
    usb.blank = level
    bench.wait_reason(words)


def test_too_few_pictures_are_reported_without_a_cause_that_nothing_shows(
    bench: Bench, usb: FakeCamera
) -> None:
    usb.rate_hz = 40.0
    usb.errors = {v4l2_device.S_PARM: errno.ENOTTY}
    bench.run(usb.path, rate_hz=80.0)
    health = bench.wait_reason("of 80 pictures/s")
    assert "light" not in health.reason
    assert "lost" not in health.reason


def test_too_dim_light_is_the_cause_where_the_exposure_lasts_as_long_as_a_period(
    bench: Bench, usb: FakeCamera
) -> None:
    usb.light, usb.rate_hz = 0.5, 30.0
    usb.controls[c.GAIN].sticks = True
    bench.run(usb.path, rate_hz=55.0)
    bench.wait_reason("the light is too dim for this exposure: it takes 20 ms")


def test_an_exposure_that_stays_automatic_is_the_cause(bench: Bench, usb: FakeCamera) -> None:
    usb.rate_hz = 15.0
    usb.controls[c.AUTO_EXPOSURE].refuses = True
    bench.run(usb.path, rate_hz=30.0)
    health = bench.wait_reason("of 30 pictures/s")
    assert "the camera keeps its exposure automatic: it lengthens it in dim light" in health.reason


def test_pictures_lost_on_the_way_are_the_cause(bench: Bench, usb: FakeCamera) -> None:
    usb.lost, usb.rate_hz = 3, 20.0
    usb.errors = {v4l2_device.S_PARM: errno.ENOTTY}
    bench.run(usb.path, rate_hz=80.0)
    health = bench.wait_reason("are lost before they come here")
    assert 70 <= int(health.reason.split("pictures/s: ")[1].split(" %")[0]) <= 76


def test_a_camera_that_has_no_such_rate_is_named_as_such(bench: Bench, usb: FakeCamera) -> None:
    usb.rate_hz = 40.0
    bench.run(usb.path, rate_hz=80.0)
    bench.wait_reason("of 80 pictures/s: at this size the camera gives 40 a second")


def test_the_numbers_of_the_ioctls_are_the_kernels() -> None:
    """As a C compiler gives them from linux/videodev2.h on 64-bit machines."""
    if struct.calcsize("P") != 8:
        pytest.skip("the layouts of a 32-bit machine differ")
    numbers = {
        "QUERYCAP": 0x80685600,
        "S_FMT": 0xC0D05605,
        "REQBUFS": 0xC0145608,
        "QUERYBUF": 0xC0585609,
        "QBUF": 0xC058560F,
        "DQBUF": 0xC0585611,
        "STREAMON": 0x40045612,
        "STREAMOFF": 0x40045613,
        "S_PARM": 0xC0CC5616,
        "G_CTRL": 0xC008561B,
        "S_CTRL": 0xC008561C,
        "QUERYCTRL": 0xC0445624,
        "ENUM_FRAMESIZES": 0xC02C564A,
    }
    assert {name: getattr(v4l2_device, name) for name in numbers} == numbers


def test_an_absent_camera_names_those_that_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bench: Bench
) -> None:
    for name in ("pci-1-video-index0", "pci-1-video-index1"):
        (tmp_path / name).touch()
    monkeypatch.setattr(camera_errors, "BY_PATH", tmp_path)
    bench.run("/dev/v4l/by-path/none-such")
    health = bench.wait_reason("no such camera is plugged in")
    assert f"plugged in: {tmp_path}/pci-1-video-index0)" in health.reason


def test_what_is_no_camera_fails_in_words() -> None:
    with pytest.raises(camera.UserError, match="it is not a camera"):
        UsbCamera(Camera(source="/dev/null"), Controls(50), time.monotonic)


def test_the_words_of_the_docs_are_those_of_the_drivers() -> None:
    root = Path(__file__).resolve().parents[3]
    rooms = (root / "host" / name for name in ("drivers", "sources"))
    files = (path for room in rooms for path in room.rglob("*.py"))
    said = "".join(path.read_text(encoding="utf-8") for path in files)
    page = (root / "docs" / "cameras.md").read_text(encoding="utf-8")
    table = page.partition("| Health says |")[2].splitlines()[2:]
    words = [row.split("`")[1] for row in table if row.startswith("| `")]
    assert len(words) > 15
    assert [phrase for phrase in words if phrase not in said] == []
