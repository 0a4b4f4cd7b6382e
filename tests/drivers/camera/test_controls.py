"""What is set of a camera and held, on one that refuses, clamps, sticks or drifts."""

import threading
from pathlib import Path

import pytest

from host.config import Camera
from host.drivers.camera import held_controls as c
from host.drivers.camera import v4l2_device
from host.drivers.camera.appearance import look_at
from host.drivers.camera.controls import Controls
from host.drivers.camera.usb import UsbCamera
from tests.drivers.camera.camera_bench import HEIGHT, WIDTH
from tests.drivers.camera.fake_camera import FakeCamera


class Clock:
    """It goes on where the camera waits for light."""

    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds


@pytest.fixture
def usb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCamera:
    fake, clock = FakeCamera(tmp_path / "video0", rate_hz=30.0), Clock()
    fake.now, fake.sleep = clock.now, clock.sleep
    monkeypatch.setattr(v4l2_device, "ask", fake.ioctl)
    return fake


def settled(usb: FakeCamera, mains_hz: int = 50) -> UsbCamera:
    """The camera, once it gives pictures."""
    config = Camera(source=str(usb.path), width_px=WIDTH, height_px=HEIGHT, rate_hz=30.0)
    source = UsbCamera(config, Controls(mains_hz), usb.now)
    for _ in range(1000):
        if source.read(threading.Event()) is not None:
            return source
    raise AssertionError("no picture in 1000 attempts")


def values(usb: FakeCamera) -> dict[int, int]:
    return {number: control.value for number, control in usb.controls.items()}


@pytest.mark.parametrize(("mains_hz", "exposure"), [(50, 100), (60, 83)])
def test_exposure_is_a_half_period_of_the_mains(
    usb: FakeCamera, mains_hz: int, exposure: int
) -> None:
    source = settled(usb, mains_hz)
    assert usb.controls[c.EXPOSURE].value == exposure
    assert usb.controls[c.MAINS].value == {50: 1, 60: 2}[mains_hz]
    assert source.remarks() == ["exposure, white balance and gain held"]
    source.close()


@pytest.mark.parametrize(
    ("light", "exposure"), [(1.0, 100), (0.45, 200), (0.05, 200), (1.6, 100), (6.0, 25)]
)
def test_pictures_are_well_exposed_in_any_light(
    usb: FakeCamera, light: float, exposure: int
) -> None:
    usb.light = light
    source = settled(usb)
    look = look_at(usb.sent[-1])
    assert look is not None
    assert 60.0 < look.level < 200.0
    assert usb.controls[c.EXPOSURE].value == exposure
    source.close()


@pytest.mark.parametrize(
    ("light", "words"),
    [
        (0.004, "the light is dim for 20 ms and the highest gain"),
        (500.0, "the light is too bright for 0.6 ms and the lowest gain"),
        (6.0, "in so bright light: lamps may flicker"),
    ],
)
def test_light_that_no_exposure_suits_is_named(usb: FakeCamera, light: float, words: str) -> None:
    usb.light = light
    usb.controls[c.GAIN].minimum = 10
    source = settled(usb)
    assert any(words in remark for remark in source.remarks())
    source.close()


def test_what_another_program_left_is_not_taken_over(usb: FakeCamera) -> None:
    stale = {
        c.AUTO_EXPOSURE: 1, c.EXPOSURE: 3, c.GAIN: 255, c.AUTO_WHITE: 0, c.WHITE: 2000,
        c.AUTO_FOCUS: 0, c.FOCUS: 250, 0x980900: 10,
    }  # fmt: skip
    for number, value in stale.items():
        usb.controls[number].value = value
    found = values(usb)
    automatic: list[int] = []
    write = usb._set

    def watched(data: bytes) -> bytes:
        if int.from_bytes(data[:4], "little") == c.AUTO_WHITE:
            automatic.append(data[4])
        return write(data)

    usb._set = watched  # type: ignore[method-assign]
    source = settled(usb)
    assert automatic == [1, 0]  # the white balance is found anew
    now = values(usb)
    assert (now[c.EXPOSURE], now[c.GAIN], now[c.FOCUS], now[0x980900]) == (100, 12, 0, 128)
    source.close()
    assert values(usb) == found


def test_automatics_are_off_while_it_runs_and_as_before_afterwards(usb: FakeCamera) -> None:
    before = values(usb)
    source = settled(usb)
    now = values(usb)
    assert now[c.AUTO_EXPOSURE] == 1
    assert [now[n] for n in (c.AUTO_WHITE, c.AUTO_FOCUS, c.DYNAMIC_RATE)] == [0, 0, 0]
    source.close()
    assert values(usb) == before


def test_what_drifts_is_set_again_and_said_once(usb: FakeCamera) -> None:
    source = settled(usb)
    usb.controls[c.EXPOSURE].value = 400
    usb.controls[c.AUTO_WHITE].value = 1
    remarks = source.remarks()
    assert "exposure drifted from 10 ms to 40 ms: set again" in remarks
    assert usb.controls[c.EXPOSURE].value == 100
    assert usb.controls[c.AUTO_WHITE].value == 0
    assert source.remarks() == ["exposure, white balance and gain held"]
    source.close()


@pytest.mark.parametrize("how", ["refuses", "sticks"])
def test_what_cannot_be_set_is_named_and_pictures_come(usb: FakeCamera, how: str) -> None:
    for number in (c.AUTO_EXPOSURE, c.WHITE, c.DYNAMIC_RATE):
        setattr(usb.controls[number], how, True)
    del usb.controls[c.GAIN]
    source = settled(usb)
    said = "; ".join(source.remarks())
    assert "exposure not held: the camera keeps it automatic" in said
    assert "gain not held: the camera has no such control" in said
    usb.controls[c.EXPOSURE].value = 300  # by the automatic
    assert not any("drifted" in remark for remark in source.remarks())
    if how == "refuses":
        assert "white balance not held: the camera refuses the setting" in said
        assert "dynamic frame rate not held: the camera refuses the setting" in said
    source.close()


def test_an_exposure_that_is_rounded_is_said(usb: FakeCamera) -> None:
    usb.controls[c.EXPOSURE].step = 39
    source = settled(usb)
    assert "exposure held at 7.8 ms where 10 ms was set" in source.remarks()
    source.close()


def test_an_exposure_that_reads_back_but_does_nothing_is_seen_in_the_pictures(
    usb: FakeCamera,
) -> None:
    usb.follows = False
    source = settled(usb)
    assert (
        "exposure not held: the pictures do not follow what the camera reads back"
        in source.remarks()
    )
    source.close()


def test_colours_that_jump_when_they_are_held_are_said(usb: FakeCamera) -> None:
    write = usb._set

    def jumping(data: bytes) -> bytes:
        if int.from_bytes(data[:4], "little") == c.WHITE:
            usb.warmth = 0.7
        return write(data)

    usb._set = jumping  # type: ignore[method-assign]
    source = settled(usb)
    assert any("white balance held, but the colours jumped" in said for said in source.remarks())
    source.close()


def test_a_camera_without_any_control_gives_pictures(usb: FakeCamera) -> None:
    usb.controls.clear()
    usb.follows = False
    source = settled(usb)
    assert len(source.remarks()) == 3
    source.close()
