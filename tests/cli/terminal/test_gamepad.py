"""A gamepad, by its events: from a pipe as the kernel writes them, or from uinput where it is."""

import os
import struct
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from host.behaviour.interface import STILL, Command
from host.behaviour.stick import FASTEST_MPS, FASTEST_RADPS, Stick
from host.cli.main import main
from host.cli.terminal import gamepad
from host.errors import UserError
from tests.behaviour.situations import situation

evdev = pytest.importorskip("evdev")
codes = evdev.ecodes
LONG_S = 20.0
AXIS = SimpleNamespace(min=-32768, max=32767, flat=4096)
RECORD = "llHHi"  # struct input_event of the kernel's uapi/linux/input.h


class Pad:
    """Reads as evdev.InputDevice does, from a pipe."""

    def __init__(self) -> None:
        self.fd, self._writer = os.pipe()

    def absinfo(self, code: int) -> SimpleNamespace:
        return AXIS

    def read(self) -> Iterator[object]:
        data = os.read(self.fd, 64 * struct.calcsize(RECORD))
        if not data:
            raise OSError(19, "No such device")
        for fields in struct.iter_unpack(RECORD, data):
            yield evdev.InputEvent(*fields)

    def write(self, *events: tuple[int, int, int]) -> None:
        os.write(self._writer, b"".join(struct.pack(RECORD, 1, 2, *event) for event in events))

    def unplug(self) -> None:
        os.close(self._writer)


PRESS, LET_GO = (codes.EV_KEY, codes.BTN_TR, 1), (codes.EV_KEY, codes.BTN_TR, 0)
AHEAD, LEFT = (codes.EV_ABS, codes.ABS_Y, -32768), (codes.EV_ABS, codes.ABS_X, -16384)
DROPPED = (codes.EV_SYN, codes.SYN_DROPPED, 0)


def wanted(stick: Stick) -> Command | None:
    return stick.command(situation(time=time.monotonic()))


def wait_until(stick: Stick, command: Command | None) -> None:
    end = time.monotonic() + LONG_S
    while wanted(stick) != command:
        assert time.monotonic() < end
        time.sleep(0.005)


def test_the_dead_mans_button_and_the_stick_drive_and_unplugging_ends() -> None:
    pad, stick = Pad(), Stick()
    with gamepad.gamepad_read(pad, stick):
        pad.write(AHEAD)
        time.sleep(0.1)
        assert wanted(stick) == STILL  # nobody holds the button
        pad.write(PRESS)
        wait_until(stick, Command(FASTEST_MPS, 0.0))
        pad.write(LET_GO)
        wait_until(stick, STILL)
        pad.write(PRESS, DROPPED)
        time.sleep(0.1)
        assert wanted(stick) == STILL
        pad.write(LET_GO, PRESS)
        wait_until(stick, Command(FASTEST_MPS, 0.0))
        pad.unplug()
        wait_until(stick, None)


def test_axes_are_shares_and_rest_in_their_middle() -> None:
    pad = gamepad.Gamepad(Pad())
    events = [evdev.InputEvent(1, 2, *event) for event in (AHEAD, LEFT, PRESS)]
    pad.take(events)
    assert pad.held
    assert pad.place == pytest.approx((1.0, 0.5), abs=0.001)
    pad.take([evdev.InputEvent(1, 2, codes.EV_ABS, codes.ABS_X, 2000)])
    assert pad.place[1] == 0.0
    assert FASTEST_RADPS > 0.0


def test_without_a_gamepad_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evdev, "list_devices", list)
    run = CliRunner().invoke(main, ["drive", "gamepad", "--simulate"])
    assert run.exit_code == 1
    assert "there is no gamepad" in run.output
    assert "group input" in run.output
    with pytest.raises(UserError, match="cannot read /dev/input/event99"):
        gamepad.find("/dev/input/event99")


@pytest.mark.skipif(not os.access("/dev/uinput", os.W_OK), reason="no /dev/uinput to write to")
def test_a_gamepad_of_the_kernel_is_found_and_read() -> None:
    axis = evdev.AbsInfo(0, AXIS.min, AXIS.max, 0, AXIS.flat, 0)
    capabilities = {
        codes.EV_KEY: [codes.BTN_TL, codes.BTN_TR],
        codes.EV_ABS: [(codes.ABS_X, axis), (codes.ABS_Y, axis)],
    }
    stick = Stick()
    with evdev.UInput(capabilities, name="swarmloc test pad") as kernel:
        end = time.monotonic() + LONG_S
        while not os.access(kernel.device.path, os.R_OK):
            assert time.monotonic() < end
        with gamepad.gamepad_read(gamepad.find(kernel.device.path), stick):
            for event in (PRESS, AHEAD):
                kernel.write(*event)
            kernel.syn()
            wait_until(stick, Command(FASTEST_MPS, 0.0))
        kernel.close()
