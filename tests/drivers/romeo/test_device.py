"""The board's driver on real pseudo-terminals, with the stand-in at the other end.

Nothing here measures time: each wait ends as soon as what it waits for has come.
"""

import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from host.config import Board, Motors, RobotConfig, Wheels
from host.drivers.romeo.device import Romeo
from host.drivers.romeo.framing import BoardDecoder
from host.drivers.romeo.protocol import FIRMWARE_VERSION, PROTOCOL_HASH, VelocityFrame
from host.messages import Displacement, Health, Message
from host.simulation.devices.romeo_stand_in import RomeoStandIn
from tests.drivers.romeo.kinematics import body_speeds

PATIENCE_S = 30.0
WHEELS = Wheels()


def ticks(now: float) -> tuple[int, int]:
    return int(1000 * now), int(1200 * now)


class Plug:
    """A stand-in on a pseudo-terminal under a name that stays, to be pulled and put back."""

    def __init__(self, name: Path) -> None:
        self.name = name
        self.board = RomeoStandIn(ticks, start=time.monotonic())
        self.heard = bytearray()
        self._end: Callable[[], None] | None = None
        self._lock = threading.Lock()

    def reset(self) -> None:
        with self._lock:
            self.board.reset(time.monotonic())

    def speeds_by(self, command: Callable[[], None]) -> tuple[int, int]:
        """The wheel speeds, ticks/s, that a command sets, which is given until they are not zero.

        Given once it may be over again before a busy computer looks.
        """
        seen: list[tuple[int, int]] = []

        def moving() -> bool:
            command()
            seen.append(self.board.wheel_speeds(time.monotonic()))
            return seen[-1] != (0, 0)

        wait_for(moving)
        return seen[-1]

    def put_in(self) -> None:
        master, slave = os.openpty()
        tty.setraw(slave, termios.TCSANOW)
        self.name.symlink_to(os.ttyname(slave))
        os.close(slave)
        stop = threading.Event()
        thread = threading.Thread(target=self._serve, args=(master, stop))
        thread.start()

        def end() -> None:
            stop.set()
            thread.join()
            os.close(master)
            self.name.unlink()

        self._end = end

    def pull(self) -> None:
        if self._end is not None:
            self._end()
            self._end = None

    def _serve(self, master: int, stop: threading.Event) -> None:
        while not stop.is_set():
            now = time.monotonic()
            try:
                if select.select([master], [], [], 0.005)[0]:
                    data = os.read(master, 4096)
                    self.heard += data
                    with self._lock:
                        self.board.receive(data, now)
                with self._lock:
                    chunks = self.board.transmit(now)
                for _, chunk in chunks:
                    os.write(master, chunk)
            except OSError:
                # Nobody has the other end open: the real board's bytes would go nowhere too.
                stop.wait(0.005)


class Driver:
    """A Romeo in its thread, and what it has emitted."""

    def __init__(self, port: str) -> None:
        self.romeo = Romeo(RobotConfig(board=Board(port=port)))
        self.messages: list[Message] = []
        self.error: BaseException | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.romeo.run(self.messages.append, self._stop)
        except BaseException as error:
            self.error = error
            raise

    def end(self) -> None:
        self._stop.set()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        assert self.error is None

    def health(self, start: int = 0) -> list[Health]:
        return [m for m in self.messages[start:] if isinstance(m, Health)]

    def steps(self, start: int = 0) -> list[Displacement]:
        return [m for m in self.messages[start:] if isinstance(m, Displacement)]


def wait_for(what: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.005)


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    plug = Plug(tmp_path / "board")
    yield plug
    plug.pull()


@pytest.fixture
def driver(plug: Plug, device_blamed: None) -> Iterator[Driver]:
    driver = Driver(str(plug.name))
    yield driver
    driver.end()


def test_displacements_come_and_health_counts_them(plug: Plug, driver: Driver) -> None:
    plug.put_in()
    wait_for(lambda: len(driver.steps()) >= 60)
    for before, after in zip(driver.steps(), driver.steps()[1:], strict=False):
        assert after.time - after.interval == pytest.approx(before.time, abs=1e-9)
    first, *rest = driver.steps()
    told = sum(step.ticks[0] for step in rest if step.ticks)
    assert told == pytest.approx(1000 * (rest[-1].time - first.time), abs=50)
    wait_for(lambda: driver.health()[-1].counts["frames"] >= 60)
    health = next(health for health in driver.health() if health.counts["frames"] >= 60)
    assert (health.device, health.ok, health.reason) == (
        "board",
        True,
        f"firmware {'.'.join(map(str, FIRMWARE_VERSION))}",
    )
    assert health.counts["lost"] == 0


def test_without_a_port_the_reason_is_told_until_it_is_there(plug: Plug, driver: Driver) -> None:
    wait_for(driver.health)
    assert not driver.health()[0].ok
    assert "no such device" in driver.health()[0].reason
    plug.put_in()
    wait_for(driver.steps)
    plug.pull()
    seen = len(driver.messages)
    wait_for(lambda: any(not h.ok for h in driver.health(seen)))
    plug.put_in()
    seen = len(driver.messages)
    wait_for(lambda: driver.steps(seen) and driver.health(seen)[-1].ok)
    assert all(step.interval < 1.0 for step in driver.steps())
    assert driver.health()[-1].counts["connections"] >= 2


def test_a_port_in_use_is_told(plug: Plug, driver: Driver) -> None:
    plug.put_in()
    wait_for(driver.steps)
    second = Driver(str(plug.name))
    try:
        wait_for(second.health)
        assert "another program has it open" in second.health()[0].reason
    finally:
        second.end()


def test_a_path_that_is_no_port_is_told(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("not a port")
    driver = Driver(str(path))
    try:
        wait_for(driver.health)
        assert "not a serial port" in driver.health()[0].reason
    finally:
        driver.end()


def test_a_wrong_hash_is_told(plug: Plug, driver: Driver) -> None:
    plug.board.protocol_hash = 0x12345678
    plug.put_in()
    words = f"firmware speaks 12345678, host speaks {PROTOCOL_HASH:08x}"
    wait_for(lambda: any(words in h.reason for h in driver.health()))
    assert driver.steps() == []


def test_a_board_that_never_answers_is_told(plug: Plug, driver: Driver) -> None:
    plug.board.silent = True
    plug.put_in()
    wait_for(lambda: any("does not answer" in h.reason for h in driver.health()))
    plug.board.silent = False
    wait_for(driver.steps)


def test_a_restart_on_the_same_port_is_told_and_recovered_from(plug: Plug, driver: Driver) -> None:
    plug.put_in()
    wait_for(driver.steps)
    plug.reset()
    wait_for(lambda: any("restarted" in h.reason for h in driver.health()))
    seen = len(driver.messages)
    wait_for(lambda: driver.steps(seen))
    wait_for(lambda: driver.health()[-1].ok and driver.health()[-1].counts["restarts"] == 1)


def test_commands_reach_the_wheels_within_limits_and_end_with_the_driver(
    plug: Plug, tmp_path: Path
) -> None:
    plug.put_in()
    driver = Driver(str(plug.name))
    try:
        wait_for(driver.steps)
        wheels = plug.speeds_by(lambda: driver.romeo.command(0.2, -1.0))
        assert body_speeds(WHEELS, *wheels) == pytest.approx((0.2, -1.0), abs=0.01)
        # No longer said, it is not repeated for ever: the driver itself sends the stop.
        stop = VelocityFrame(0, 0)
        wait_for(lambda: BoardDecoder().feed(bytes(plug.heard))[-1] == stop)
        wheels = plug.speeds_by(lambda: driver.romeo.command(99.0, 99.0))
        limits = (WHEELS.max_speed_mps, WHEELS.max_turn_rate_radps)
        assert body_speeds(WHEELS, *wheels) == pytest.approx(limits, abs=0.01)
    finally:
        driver.end()
    wait_for(lambda: BoardDecoder().feed(bytes(plug.heard))[-1] == stop)


def test_wheels_too_fast_for_a_frame_keep_to_their_arc() -> None:
    wheels = Wheels(counts_per_turn=100_000, max_speed_mps=4.0, max_turn_rate_radps=40.0)
    robot = RobotConfig(wheels=wheels, motors=Motors(full_speed_mps=4.0))
    romeo = Romeo(robot, clock=lambda: 0.0)
    romeo.command(4.0, 40.0)
    wanted = romeo._command_at(0.0)
    assert wanted is not None
    assert max(wanted) == 32767
    speed, turn_rate = body_speeds(wheels, *wanted)
    assert turn_rate / speed == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_command_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        Romeo(RobotConfig()).command(value, 0.0)
