"""The live simulation: bytes on pseudo-terminals that come, go and come back."""

import errno
import os
import re
import stat
import tempfile
import termios
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from host.calibration.gathered import Tracks
from host.config import Motors, RobotConfig
from host.drivers.natnet.client import NatNetClient
from host.drivers.romeo.device import Romeo
from host.drivers.serial_port import open_port, read_available
from host.drivers.x4.commands import INFO, SCAN, STOP, DeviceInfo
from host.drivers.x4.device import X4, X4Pro
from host.drivers.x4.packets import BAUDRATE
from host.drivers.x4.protocol import ScanDecoder
from host.errors import UserError
from host.messages import Bearings, Bodies, Displacement, Health, Message, Scan
from host.simulation import live as live_simulation
from host.simulation.devices.board import BoardKind, best_board
from host.simulation.devices.romeo_stand_in import RomeoStandIn
from host.simulation.live import LiveSimulation, Terminal
from host.simulation.world.scenarios import parse_scenario

ARENA = parse_scenario("arena4:seed=1")
LONG_S = 20.0  # a bound on waiting, not on speed


class Inbox:
    """Keeps what devices emit, and waits for what a test is after."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self._news = threading.Condition()

    def __call__(self, message: Message) -> None:
        with self._news:
            self.messages.append(message)
            self._news.notify_all()

    def wait_for(self, wanted: type | tuple[type, ...], count: int = 1, after: int = 0) -> list:
        """The first `count` messages of a kind after the first `after` messages."""
        found: list[Message] = []

        def enough() -> bool:
            found[:] = [m for m in self.messages[after:] if isinstance(m, wanted)]
            return len(found) >= count

        with self._news:
            assert self._news.wait_for(enough, LONG_S), f"no {wanted} came: {self.messages[-3:]}"
        return found


class Threads:
    """Runs devices until the end of a test."""

    def __init__(self) -> None:
        self.stop = threading.Event()
        self._threads: list[threading.Thread] = []

    def start(self, device: object, inbox: Inbox) -> None:
        thread = threading.Thread(target=device.run, args=(inbox, self.stop))  # type: ignore[attr-defined]
        thread.start()
        self._threads.append(thread)

    def __enter__(self) -> "Threads":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        for thread in self._threads:
            thread.join()


def read_until(handle: int, length: int) -> bytes:
    data = b""
    end = time.monotonic() + LONG_S
    while len(data) < length and time.monotonic() < end:
        data += os.read(handle, 4096)
    return data


def test_a_terminal_carries_bytes_both_ways_unchanged(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "port")
    terminal.plug()
    host = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    everything = bytes(range(256)) * 4
    terminal.write(everything)
    assert read_until(host, 1024) == everything
    os.write(host, everything)
    assert terminal.read() == everything
    assert terminal.read() == b""
    os.close(host)
    terminal.unplug()


def test_bytes_to_nobody_are_lost_and_a_full_buffer_does_not_block(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "port")
    terminal.plug()
    assert not terminal.listening
    terminal.write(b"nobody")
    host = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    assert terminal.listening
    terminal.write(b"somebody")
    assert read_until(host, 8) == b"somebody"
    for _ in range(100):
        terminal.write(bytes(1000))
    os.close(host)
    assert not terminal.listening
    assert terminal.read() == b""
    terminal.unplug()


def test_unplugging_fails_the_host_and_plugging_gives_a_new_port(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "port")
    terminal.plug()
    assert stat.S_ISCHR(terminal.path.stat().st_mode)
    port = open_port(str(terminal.path), BAUDRATE, dtr=False)
    terminal.unplug()
    assert not terminal.plugged
    with pytest.raises(OSError) as caught:  # noqa: PT011 - the number is checked below
        read_available(port, LONG_S)
    assert caught.value.errno in (errno.EIO, errno.ENODEV)
    with pytest.raises((OSError, termios.error)):
        port.write(b"x")
    port.close()
    assert not terminal.path.is_symlink()
    terminal.unplug()  # twice does no harm
    terminal.plug()
    again = open_port(str(terminal.path), BAUDRATE, dtr=False)
    terminal.write(b"back")
    assert read_available(again, LONG_S) == b"back"
    again.close()
    terminal.unplug()


def test_the_lidars_port_answers_and_scans_when_asked() -> None:
    decoder = ScanDecoder()
    with LiveSimulation(ARENA, RobotConfig()) as live:
        assert live.config.lidar.delay_s == 0.0
        port = open_port(live.config.lidar.port, BAUDRATE, dtr=False)
        assert read_available(port, 0.1) == b""
        port.write(INFO)
        port.write(SCAN)
        scans, end = [], time.monotonic() + LONG_S
        while len(scans) < 4 and time.monotonic() < end:
            scans += decoder.feed(read_available(port), time.monotonic())
        port.close()
        folder = Path(live.config.lidar.port).parent
    assert isinstance(decoder.take_replies()[0], DeviceInfo)
    assert len(scans) >= 4
    assert decoder.counts["checksum_errors"] == decoder.counts["points_lost"] == 0
    assert not folder.exists()


def test_the_real_drivers_work_and_outlive_unplugging() -> None:
    inbox = Inbox()
    # For so long that a busy computer does not miss it.
    unplugged = {"lidar": [(0.0, 1.2), (4.0, 5.5)], "board": [(4.0, 5.5)]}
    with LiveSimulation(ARENA, RobotConfig(), unplugged) as live, Threads() as threads:
        begin = time.monotonic()
        threads.start(X4(live.config.lidar), inbox)
        threads.start(Romeo(live.config), inbox)
        threads.start(live.camera, inbox)
        health = inbox.wait_for(Health)
        while health[-1].device != "lidar":
            health = inbox.wait_for(Health, len(health) + 1)
        assert not next(each.ok for each in health if each.device == "lidar")
        inbox.wait_for(Scan, 2)
        inbox.wait_for(Displacement, 20)
        frames = inbox.wait_for(Bearings, 5)
        while time.monotonic() < begin + 5.6:
            time.sleep(0.05)
        known = len(inbox.messages)
        scan = inbox.wait_for(Scan, 2, after=known)[-1]
        inbox.wait_for(Displacement, 20, after=known)
        truth = live.truth(scan.time)
    assert truth.time == scan.time
    assert list(truth.identities) == [1, 2, 3]
    # Image pairs are 0.1 s apart, on the host's clock.
    assert frames[4].time - frames[0].time == pytest.approx(0.4)
    assert begin - 0.2 < frames[0].time < begin + LONG_S
    reports = [m for m in inbox.messages if isinstance(m, Health)]
    for device in ("lidar", "board"):
        states = [report.ok for report in reports if report.device == device]
        assert True in states
        assert False in states[states.index(True) :], f"nobody noticed that {device} went"
    assert all(report.ok for report in reports if report.device == "camera")


@pytest.mark.usefixtures("elf")
def test_the_drivers_work_with_the_firmware_in_real_time() -> None:
    inbox = Inbox()
    board = best_board(Motors())
    assert "the firmware" in board.name
    with LiveSimulation(ARENA, RobotConfig(), board=board) as live, Threads() as threads:
        threads.start(Romeo(live.config), inbox)
        inbox.wait_for(Displacement, 50)
    health = [m for m in inbox.messages if isinstance(m, Health)][-1]
    assert health.ok
    assert health.counts["lost"] == health.counts["refused"] == 0


class CrashedBoard(RomeoStandIn):
    def transmit(self, now: float) -> list[tuple[float, bytes]]:
        raise UserError("the board's program crashed", "for this test", "")


def test_a_crash_of_the_boards_program_is_raised_at_the_end() -> None:
    board = BoardKind(CrashedBoard, "one that crashes")
    with (
        pytest.raises(UserError, match="crashed"),
        LiveSimulation(ARENA, RobotConfig(), board=board),
    ):
        time.sleep(0.1)


def test_only_known_devices_can_be_unplugged() -> None:
    with pytest.raises(UserError, match="lidar, board") as caught:
        LiveSimulation(ARENA, RobotConfig(), {"lidr": [(0.0, 1.0)]})
    assert "lidar=2-4" in caught.value.next_step


def test_what_cannot_be_made_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def in_use(*_: object) -> None:
        raise OSError(errno.EADDRINUSE, "Address already in use")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(live_simulation, "NatNetServer", in_use)
    scenario = parse_scenario("arena4:seed=2,mocap_hz=50")
    with pytest.raises(OSError, match="Address already in use") as failed:
        LiveSimulation(scenario, RobotConfig())
    assert not list(tmp_path.iterdir())
    assert failed.traceback  # which keeps alive what is not closed


def test_motion_capture_is_a_server_that_the_real_client_reads() -> None:
    inbox = Inbox()
    scenario = parse_scenario("arena4:seed=2,mocap_hz=50,mocap_noise_mm=0,mocap_noise_deg=0")
    with LiveSimulation(scenario, RobotConfig()) as live, Threads() as threads:
        assert live.config.mocap.source == "natnet"
        threads.start(NatNetClient(live.config.mocap.natnet), inbox)
        health = inbox.wait_for(Health)
        while not re.search(r"clock known to [0-4]\.\d ms", health[-1].reason):
            health = inbox.wait_for(Health, len(health) + 1)
        frames = inbox.wait_for(Bodies, 30, after=inbox.messages.index(health[-1]))
        tracks = Tracks(frames, live.config.mocap)
        assert tracks.identities.tolist() == [2, 3, 4]
        for frame in frames[::5]:
            (seen,) = tracks.truths(np.array([frame.time]))
            # 3 mm: a tenth of that are a millisecond of driving.
            assert seen.positions == pytest.approx(live.truth(frame.time).positions, abs=3e-3)


@pytest.mark.parametrize("again", range(3))
def test_the_lidar_receives_the_last_stop(again: int) -> None:
    received: list[bytes] = []
    with LiveSimulation(ARENA, RobotConfig()) as simulation:
        lidar = simulation._simulation.lidar
        receive = lidar.receive

        def keep(data: bytes, now: float) -> None:
            received.append(data)
            receive(data, now)

        lidar.receive = keep  # type: ignore[method-assign]
        inbox, stop = Inbox(), threading.Event()
        driver = threading.Thread(
            target=X4(simulation.config.lidar).run, args=(inbox, stop), daemon=True
        )
        driver.start()
        inbox.wait_for(Scan)
        stop.set()
        driver.join()
    assert b"".join(received).endswith(STOP)


def test_an_x4_pro_is_simulated_by_its_name() -> None:
    robot = RobotConfig()
    robot = robot.model_copy(update={"lidar": robot.lidar.model_copy(update={"model": "x4pro"})})
    with LiveSimulation(ARENA, robot) as simulation:
        inbox, stop = Inbox(), threading.Event()
        driver = threading.Thread(
            target=X4Pro(simulation.config.lidar).run, args=(inbox, stop), daemon=True
        )
        driver.start()
        inbox.wait_for(Scan, count=3)
        stop.set()
        driver.join()
    assert all(message.ok for message in inbox.messages if isinstance(message, Health))
