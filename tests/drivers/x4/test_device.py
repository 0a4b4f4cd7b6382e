"""The X4 driver on a real pseudo-terminal, an emulated lidar at its other end."""

import contextlib
import os
import threading
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import serial

from host.config import Lidar
from host.drivers.serial_port import read_available
from host.drivers.x4 import device as x4
from host.drivers.x4.commands import DeviceHealth
from host.drivers.x4.device import X4, X4Pro
from host.messages import FloatArray, Health, Message, Scan
from host.simulation.devices.x4 import X4Emulator, X4ProEmulator

PATIENCE_S = 20.0
REPLY, SPIN_UP, SILENCE = "_REPLY_WAIT_S", "_SPIN_UP_S", "_SILENCE_S"  # what a driver waits for


def sense(times: FloatArray, angles: FloatArray) -> FloatArray:
    return np.where(angles < 5.0, 2.0, 0.0)


class Bench:
    """A link whose target is the pseudo-terminal of an emulated lidar, and a driver on it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "lidar"
        self.lidar = X4Emulator(sense)
        self.received = b""
        self.noise = b""
        self.messages: list[Message] = []
        self.errors: list[BaseException] = []
        self.stop = threading.Event()
        self._unplug = threading.Event()
        self._device: threading.Thread | None = None
        self._driver: threading.Thread | None = None

    def plug(self) -> None:
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(theirs))
        self._unplug.clear()
        self._device = threading.Thread(target=self._serve, args=(ours, theirs))
        self._device.start()

    def unplug(self) -> None:
        self.path.unlink(missing_ok=True)
        self._unplug.set()
        if self._device is not None:
            self._device.join()
            self._device = None

    def _serve(self, ours: int, theirs: int) -> None:
        os.set_blocking(ours, False)
        waiting = b""
        while not self._unplug.wait(0.002):
            with contextlib.suppress(BlockingIOError):
                data = os.read(ours, 256)
                self.received += data
                self.lidar.receive(data, time.monotonic())
            waiting += b"".join(chunk for _, chunk in self.lidar.transmit(time.monotonic()))
            waiting += self.noise
            with contextlib.suppress(BlockingIOError):  # the driver reads on later
                waiting = waiting[os.write(ours, waiting) :]
        os.close(theirs)
        os.close(ours)

    def run(self, clock: Callable[[], float] = time.monotonic, **settings: object) -> None:
        config = Lidar.model_validate({"port": str(self.path), **settings})
        driver = X4Pro(config) if config.model == "x4pro" else X4(config, clock)
        self._driver = threading.Thread(target=self._drive, args=(driver,))
        self._driver.start()

    def _drive(self, driver: X4) -> None:
        try:
            driver.run(self.messages.append, self.stop)
        except BaseException as error:
            self.errors.append(error)
            raise

    def health(self) -> list[Health]:
        return [message for message in self.messages if isinstance(message, Health)]

    def scans(self) -> list[Scan]:
        return [message for message in self.messages if isinstance(message, Scan)]

    def wait(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, self.messages[-1:]
            assert not self.errors
            time.sleep(0.01)

    def wait_reason(self, words: str, ok: bool = False) -> Health:
        found: list[Health] = []

        def said() -> bool:
            found[:] = [h for h in self.health() if words in h.reason and h.ok == ok]
            return bool(found)

        self.wait(said)
        return found[-1]

    def close(self) -> None:
        self.stop.set()
        if self._driver is not None:
            self._driver.join()
        self.unplug()
        assert not self.errors


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, device_blamed: None) -> Iterator[Bench]:
    """Its driver waits longer than any test: a busy computer makes no lidar a silent one."""
    for wait in (REPLY, SPIN_UP, SILENCE):
        monkeypatch.setattr(x4, wait, 10 * PATIENCE_S)
    rig = Bench(tmp_path)
    yield rig
    rig.close()


Impatient = Callable[..., None]


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> Impatient:
    """Makes drivers miss soon what does not come: `impatient(REPLY, ...)`."""

    def shorten(*waits: str) -> None:
        for wait in waits:
            monkeypatch.setattr(x4, wait, 0.4)

    return shorten


def test_scans_come_and_the_lidar_is_stopped_at_the_end(bench: Bench) -> None:
    begin = time.monotonic()
    bench.plug()
    bench.run()
    bench.wait(lambda: len(bench.scans()) >= 4)
    state = bench.wait_reason("scanning at", ok=True)
    scan = bench.scans()[-2]
    assert 650 < len(scan.ranges) < 780
    assert set(scan.ranges.tolist()) == {0.0, 2.0}
    assert begin < scan.time <= time.monotonic()
    assert np.diff(scan.times) == pytest.approx(0.0002)
    assert state.device == "lidar"
    assert "firmware 1.5" in state.reason
    assert "motor stays on" in state.reason  # a pseudo-terminal has no DTR
    assert state.counts["packets"] > 0
    bench.stop.set()
    bench.wait(lambda: bench.received.endswith(b"\xa5\x65"))


def test_the_configured_delay_is_taken_off(bench: Bench) -> None:
    begin = time.monotonic()
    bench.plug()
    bench.run(delay_s=0.9)
    bench.wait(lambda: len(bench.scans()) >= 1)
    scan = bench.scans()[0]
    assert begin < scan.time + 0.9 <= time.monotonic()
    assert scan.times[-1] == scan.time


def test_absent_then_plugged_then_pulled_then_back(bench: Bench) -> None:
    bench.run()
    bench.wait_reason("no such device")
    bench.plug()
    bench.wait(lambda: len(bench.scans()) >= 2)
    bench.unplug()
    bench.wait_reason("the connection was lost")
    count = len(bench.scans())
    bench.lidar = X4Emulator(sense, seed=1)
    bench.plug()
    bench.wait(lambda: len(bench.scans()) >= count + 2)
    bench.wait(lambda: bench.health()[-1].ok)
    assert max(health.counts["connections"] for health in bench.health()) == 2
    times = np.concatenate([scan.times for scan in bench.scans()])
    assert (np.diff(times) > -0.01).all()


def test_a_motor_without_power_is_named(bench: Bench, impatient: Impatient) -> None:
    bench.lidar.motor_powered = False
    impatient(SPIN_UP, SILENCE)
    bench.plug()
    bench.run()
    silent = bench.wait_reason("answers but sends no samples\nits motor does not turn")
    assert "POWER" in silent.reason
    bench.lidar.motor_powered = True
    bench.wait_reason("scanning", ok=True)
    bench.lidar.motor_powered = False
    bench.wait_reason("the lidar stopped sending")


def test_a_dead_lidar_is_named(bench: Bench, impatient: Impatient) -> None:
    bench.lidar.answers = False
    impatient(REPLY)
    bench.plug()
    bench.run()
    bench.wait_reason("the lidar does not answer")


def test_damage_of_before_does_not_make_a_dead_lidar_a_noisy_one(
    bench: Bench, impatient: Impatient
) -> None:
    bench.lidar.corrupt_share = 0.4
    bench.plug()
    bench.run()
    bench.wait_reason("% of the packets are damaged")
    bench.unplug()
    bench.lidar = X4Emulator(sense)
    bench.lidar.answers = False
    impatient(REPLY)
    bench.plug()
    bench.wait_reason("the lidar does not answer")
    assert not any("make no sense" in health.reason for health in bench.health())


def test_another_device_on_the_port_is_named(bench: Bench, impatient: Impatient) -> None:
    bench.lidar.answers = False
    bench.noise = b"$GPGGA,1\n"
    impatient(REPLY)
    bench.plug()
    bench.run()
    bench.wait_reason("bytes make no sense")


def test_a_fault_of_the_lidar_is_named(bench: Bench) -> None:
    bench.lidar.health = DeviceHealth(status=2, error=0x21)
    bench.plug()
    bench.run()
    bench.wait_reason("the lidar reports a fault\nits error code is 0x0021")


def test_damaged_packets_are_named(bench: Bench, impatient: Impatient) -> None:
    bench.lidar.corrupt_share = 0.4
    impatient(SILENCE)
    bench.plug()
    bench.run()
    bench.wait_reason("% of the packets are damaged")
    bench.lidar.corrupt_share = 1.0
    bench.wait_reason("only damaged packets")


def test_a_busy_port_is_named(bench: Bench) -> None:
    bench.plug()
    with x4.open_port(str(bench.path), 128_000):
        bench.run()
        bench.wait_reason("another program has it open")
    bench.wait_reason("scanning", ok=True)


@pytest.mark.parametrize("model", ["x4", "x4pro"])
def test_an_x4_pro_scans_whether_it_is_configured_or_recognized(
    bench: Bench, model: str, impatient: Impatient
) -> None:
    bench.lidar = X4ProEmulator(sense)
    impatient(REPLY)
    bench.plug()
    bench.run(model=model)
    bench.wait_reason("answers no command, as an X4 Pro", ok=True)
    assert bench.scans()
    assert all(health.ok for health in bench.health())


def test_a_silent_x4_pro_is_named(bench: Bench, impatient: Impatient) -> None:
    bench.lidar = X4ProEmulator(sense)
    bench.lidar.motor_powered = False
    impatient(SPIN_UP)
    bench.plug()
    bench.run(model="x4pro")
    bench.wait_reason("the lidar sends nothing")
    bench.lidar.motor_powered = True
    bench.wait_reason("scanning", ok=True)


@pytest.mark.parametrize(("code", "name"), [(5, "G4"), (8, "F4 Pro")])
def test_another_model_is_named(bench: Bench, code: int, name: str) -> None:
    bench.lidar.info = replace(bench.lidar.info, model=code)
    bench.plug()
    bench.run()
    bench.wait_reason(f"the lidar is a YDLidar {name}, not an X4")
    assert not bench.scans()


def test_an_unknown_model_code_is_named_and_read_as_an_x4(bench: Bench) -> None:
    bench.lidar.info = replace(bench.lidar.info, model=77)
    bench.plug()
    bench.run()
    bench.wait_reason("unknown model code 77", ok=True)


def test_a_computer_that_stood_still_is_not_taken_for_a_silent_lidar(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stands still for half a minute just after the driver has looked and found nothing."""
    monkeypatch.setattr(x4, SILENCE, 20.0)
    leap = [0.0]

    def read(port: serial.Serial, timeout_s: float = 0.05) -> bytes:
        if len(bench.scans()) < 3 or leap[0]:
            return read_available(port, timeout_s)
        leap[0] = 30.0
        return b""

    monkeypatch.setattr(x4, "read_available", read)
    bench.plug()
    bench.run(clock=lambda: time.monotonic() + leap[0])
    bench.wait(lambda: len(bench.scans()) > 8)
    assert leap[0]
    assert not any("stopped sending" in health.reason for health in bench.health())


def test_a_slow_motor_is_waited_for(bench: Bench, impatient: Impatient) -> None:
    bench.lidar.spin_up_s = 1.2  # three times as long as the driver waits before it says so
    impatient(SPIN_UP)
    bench.plug()
    bench.run()
    bench.wait_reason("sends no samples")
    bench.wait_reason("scanning", ok=True)
    assert bench.health()[-1].counts["connections"] == 1


def test_a_dead_laser_is_not_ok(bench: Bench) -> None:
    bench.lidar.laser_fires = False
    bench.plug()
    bench.run()
    bench.wait_reason("all ranges are zero: the laser does not fire")
    bench.lidar.laser_fires = True
    bench.wait(lambda: bench.health()[-1].ok)


def test_a_covered_window_is_not_ok(bench: Bench) -> None:
    bench.lidar = X4Emulator(
        lambda times, angles: np.where((angles > 1.0) & (angles < 3.0), 0, 2.0)
    )
    bench.plug()
    bench.run()
    bench.wait_reason("something covers the window")


def test_an_unknown_format_is_named_and_no_bad_cable(bench: Bench, impatient: Impatient) -> None:
    packets = bench.lidar.transmit
    impatient(SPIN_UP)
    bench.plug()

    def with_other_headers(now: float) -> list[tuple[float, bytes]]:
        return [(when, data.replace(b"\xaa\x55", b"\x54\x2c")) for when, data in packets(now)]

    bench.lidar.transmit = with_other_headers  # type: ignore[method-assign]
    bench.run()
    bench.wait_reason("the lidar's packets have an unknown format")
    assert not any("damaged" in health.reason for health in bench.health())
