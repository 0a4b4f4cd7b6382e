"""Injected faults, each at real drivers: the doctor names it and the right next step.

Many robots are examined at once: each needs twelve seconds, but little of the processor.
"""

import dataclasses
import errno
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import serial

from host.config import RobotConfig
from host.doctor import disk
from host.doctor.examine import examine
from host.doctor.findings import Finding, Level
from host.doctor.mountings import cameras_against_lidar
from host.doctor.watching import Watched
from host.drivers.camera import driver as camera_driver
from host.drivers.camera import held_controls, v4l2_device
from host.drivers.computer import Computer, Readings
from host.drivers.serial_port import open_port
from host.geometry import wrap
from host.messages import Bearings, FloatArray
from host.simulation.devices.board import STAND_IN
from host.simulation.devices.natnet_server import CLOCK_HZ, NatNetServer
from host.simulation.live import LiveSimulation
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario
from host.sources.rig import Rig
from tests.doctor import benches
from tests.doctor.benches import Bench
from tests.drivers.camera.fake_camera import FakeCamera

Make = Callable[[Bench], Rig]
SECONDS = 12.0
STANDSTILL_S = 0.25


def cool() -> Readings:
    return Readings(0, 100, 45.0, None, None)


def frozen(number: int) -> bytes:
    return benches.picture(0)


def clock_jump(seconds: int) -> Make:
    def make(bench: Bench) -> Rig:
        server = bench.enter(NatNetServer(benches.one_body, 50.0))
        ticks, jump = server.ticks, time.monotonic() + 6.0
        server.ticks = lambda at: ticks(at) + seconds * CLOCK_HZ * (time.monotonic() > jump)
        return benches.mocap_rig(server)

    return make


def another_body(bench: Bench) -> Rig:
    server = NatNetServer(lambda time: (np.array([7]), np.array([[1.0, 2.0, 0.5]])), 50.0)
    return benches.mocap_rig(bench.enter(server))


def slow_camera(bench: Bench) -> Rig:
    return benches.camera_rig(bench.feed(benches.picture, 5.0), rate_hz=30.0)


def half_covered(times: FloatArray, raw_angles: FloatArray) -> FloatArray:
    return np.where(raw_angles > np.pi, 0.0, benches.room(times, raw_angles))


def mocap_elsewhere(bench: Bench) -> Rig:
    server = NatNetServer(benches.one_body, 50.0, connection="multicast")
    server.streaming = False
    bench.enter(server)
    bench.enter(benches.frames_from_elsewhere(server))
    return benches.mocap_rig(server)


def forbidden(bench: Bench) -> Rig:
    path = bench.folder / FORBIDDEN
    path.symlink_to(bench.plug(benches.board()))
    return benches.board_rig(str(path))


def unlocked_exposure(bench: Bench) -> Rig:
    camera = FakeCamera(bench.folder / "video0", rate_hz=20.0, warmth=0.7)
    camera.controls[held_controls.AUTO_EXPOSURE].sticks = True
    VIDEO.clear()  # of an earlier try
    VIDEO[str(camera.path)] = camera
    return benches.usb_camera_rig(camera)


def held(bench: Bench) -> Rig:
    path = bench.plug(benches.x4())
    bench.enter(open_port(path, 128_000))
    return benches.lidar_rig(path)


def lidar(**faults: object) -> Make:
    return lambda bench: benches.lidar_rig(bench.plug(benches.x4(**faults)))


def board(**faults: object) -> Make:
    return lambda bench: benches.board_rig(bench.plug(benches.board(**faults)))


def camera(picture: Callable[[int], bytes]) -> Make:
    return lambda bench: benches.camera_rig(bench.feed(picture))


FORBIDDEN = "forbidden"  # name of a port that the system refuses to open
VIDEO: dict[str, FakeCamera] = {}
# The robot, the part that is named, how bad it is, words of the finding, words of the next step.
FAULTS: dict[str, tuple[Make, str, Level, str, str]] = {
    "no port": (
        lambda bench: benches.lidar_rig("/dev/serial/by-id/absent"),
        "lidar",
        Level.FAIL,
        "no such device is plugged in",
        "check",
    ),
    "port held by another program": (held, "lidar", Level.FAIL, "has it open", "close"),
    "no permission": (
        forbidden,
        "board",
        Level.FAIL,
        "this user may not use it",
        "swarmloc doctor --udev-rules",
    ),
    "wrong baud": (
        lambda bench: benches.lidar_rig(
            bench.plug(benches.WrongBaud(benches.x4(), 115_200, 128_000))
        ),
        "lidar",
        Level.FAIL,
        "not as a YDLidar X4 does at 128000 baud",
        "check that the port is the lidar's and the model an X4",
    ),
    "unpowered lidar motor": (
        lidar(motor_powered=False),
        "lidar",
        Level.FAIL,
        "its motor does not turn",
        "connect the second USB lead",
    ),
    "checksum errors": (
        lidar(corrupt_share=0.3),
        "lidar",
        Level.FAIL,
        "% of the packets are damaged",
        "use a short cable",
    ),
    "a few checksum errors": (
        lidar(corrupt_share=0.05),
        "lidar",
        Level.WARN,
        "wrong checksum",
        "short cable",
    ),
    "dirty sector": (
        lidar(sense=benches.behind_dirt),
        "lidar",
        Level.FAIL,
        "something covers the window",
        "look at the lidar's window there",
    ),
    "half covered": (
        lidar(sense=half_covered),
        "lidar",
        Level.FAIL,
        "something covers the window",
        "look at the lidar's window there",
    ),
    "lost packets": (
        lidar(lost_share=0.2),
        "lidar",
        Level.FAIL,
        "packets are lost on the way",
        "use no unpowered USB hub",
    ),
    "board on the lidar's port": (
        lambda bench: benches.lidar_rig(bench.plug(benches.board())),
        "lidar",
        Level.FAIL,
        "not as a YDLidar X4 does",
        "check that the port is the lidar's",
    ),
    "dead laser": (
        lidar(laser_fires=False),
        "lidar",
        Level.FAIL,
        "the laser does not fire",
        "hold a hand 30 cm beside the lidar",
    ),
    "stale firmware": (
        board(version=(0, 1, 0)),
        "board",
        Level.WARN,
        "older than this program's",
        "run `swarmloc flash`",
    ),
    "firmware of another protocol": (
        board(protocol_hash=1),
        "board",
        Level.FAIL,
        "firmware speaks 00000001",
        "run `swarmloc flash`",
    ),
    "2x board with 4x settings": (
        lambda bench: benches.board_rig(bench.plug(benches.board()), counts_per_turn=3840),
        "board",
        Level.FAIL,
        "counts 2 edges in each of 960 periods",
        "set counts_per_turn = 1920",
    ),
    "board for another motor": (
        lambda bench: benches.board_rig(bench.plug(benches.board()), counts_per_turn=1000),
        "board",
        Level.WARN,
        "but counts_per_turn is 1000",
        "set periods_per_turn",
    ),
    "slow camera": (
        slow_camera,
        "front camera",
        Level.FAIL,
        " of 30 pictures/s",
        "set rate_hz to what comes",
    ),
    "black pictures": (
        camera(lambda number: benches.picture(number, 0.02)),
        "front camera",
        Level.FAIL,
        "the pictures are black",
        "uncover the lens",
    ),
    "frozen camera": (camera(frozen), "front camera", Level.FAIL, "frozen", "unplug the camera"),
    "dim camera": (
        camera(lambda number: benches.picture(number, 0.25)),
        "front camera",
        Level.WARN,
        "dim",
        "switch on more light",
    ),
    "unlocked exposure": (
        unlocked_exposure,
        "front camera",
        Level.WARN,
        "exposure not held",
        "another camera",
    ),
    "mocap on another interface": (
        mocap_elsewhere,
        "motion capture",
        Level.FAIL,
        "packets come from 127.0.0.2 instead",
        'set server = "127.0.0.2"',
    ),
    "clock jump": (
        clock_jump(3600),
        "motion capture",
        Level.WARN,
        "its clock jumped once",
        "restart Motive",
    ),
    "clock jump backwards": (
        clock_jump(-3600),
        "motion capture",
        Level.WARN,
        "its clock jumped once",
        "restart Motive",
    ),
    "the robot's body has another number": (
        another_body,
        "motion capture",
        Level.WARN,
        "number 1, is not tracked; tracked: 7",
        "set body in [mocap]",
    ),
}


def refuse_and_fake(patch: pytest.MonkeyPatch) -> None:
    """Have the system refuse one port, and answer for the cameras of VIDEO."""
    whole = serial.Serial.open

    def open_or_refuse(self: serial.Serial) -> None:
        if str(self.port).endswith(FORBIDDEN):
            raise serial.SerialException(errno.EACCES, "Permission denied")
        whole(self)

    patch.setattr(serial.Serial, "open", open_or_refuse)
    is_device = camera_driver.is_video_device
    patch.setattr(camera_driver, "is_video_device", lambda path: path in VIDEO or is_device(path))
    patch.setattr(v4l2_device, "ask", lambda *asked: next(iter(VIDEO.values())).ioctl(*asked))


def robots(bench: Bench, names: list[str]) -> Iterator[tuple[str, Rig]]:
    """The robot of each fault, and healthy ones."""
    for name in names:
        if name in FAULTS:
            yield name, FAULTS[name][0](bench)
        else:
            scenario = parse_scenario(HEALTHY[name])
            live = bench.enter(LiveSimulation(scenario, RobotConfig(), board=STAND_IN))
            yield name, benches.swarm_rig(live)


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Finding]]:
    """Findings of every robot, by the name of its fault.

    Where this computer had no time for the simulated devices, they were not what they stand for:
    then once more, in smaller groups.
    """
    every, found = [*FAULTS, *HEALTHY], dict[str, list[Finding]]()
    for groups in (2, 3, 5):
        left = [name for name in every if name not in found]
        for first in range(groups):
            those, still_s = examine_all(tmp_path_factory.mktemp("robots"), left[first::groups])
            found |= those if still_s < STANDSTILL_S else {}
        if len(found) == len(every):
            return found
    pytest.skip(f"simulated devices stood still for {still_s:.1f} s: too busy a computer")


def examine_all(folder: Path, names: list[str]) -> tuple[dict[str, list[Finding]], float]:
    with (
        pytest.MonkeyPatch.context() as patch,
        Bench(folder) as bench,
        ThreadPoolExecutor(len(names)) as pool,
    ):
        refuse_and_fake(patch)
        futures = {
            name: pool.submit(examine, rig, folder, Computer(look=cool), SECONDS)
            for name, rig in robots(bench, names)
        }
        found = {name: future.result().findings for name, future in futures.items()}
        return found, bench.stood_still_s


def alarms(findings: list[Finding]) -> list[Finding]:
    """Those that are not ok, but that this computer, on which all robots run, is busy."""
    return [f for f in findings if f.level != Level.OK and f.part not in ("localizer", "disk")]


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_with_its_next_step(
    name: str, diagnosis: dict[str, list[Finding]]
) -> None:
    _, part, level, what, step = FAULTS[name]
    found = [f for f in diagnosis[name] if f.part == part and f.level != Level.OK]
    assert any(f.level == level and what in f.what and step in f.next_step for f in found), (
        diagnosis[name]
    )
    assert not [f for f in alarms(diagnosis[name]) if f.part != part]


HEALTHY = {f"seed {seed}": f"arena4:seed={seed},mocap_hz=50" for seed in (1, 2)}


def test_healthy_robots_raise_no_alarm(diagnosis: dict[str, list[Finding]]) -> None:
    for name in HEALTHY:
        assert len({finding.part for finding in diagnosis[name]}) > 6
        assert alarms(diagnosis[name]) == [], name


def test_a_slow_disk_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert disk.measure(tmp_path).level in (Level.OK, Level.WARN)  # others may use it, too
    sync = disk.os.fsync

    def slow(handle: int) -> None:
        time.sleep(0.3)
        sync(handle)

    monkeypatch.setattr(disk.os, "fsync", slow)
    found = disk.measure(tmp_path)
    assert (found.part, found.level) == ("disk", Level.WARN)
    assert "slow" in found.what
    assert "another card or disk" in found.next_step

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(disk.os, "fsync", full)
    no_room = disk.measure(tmp_path)
    assert no_room.level == Level.FAIL
    assert "No space left" in no_room.what
    assert "delete what is not needed" in no_room.next_step
    gone = disk.measure(tmp_path / "absent")
    assert gone.level == Level.FAIL
    assert "--record" in gone.next_step


def test_exchanged_cameras_are_named_and_others_are_not() -> None:
    """Strips in drawn pictures against turrets: the front camera's picture is the rear one's."""
    small = {"width_px": 640, "height_px": 360, "focal_px": 203.7}
    small |= {"centre_x_px": 319.5, "centre_y_px": 179.5}
    config = RobotConfig()
    front, rear = (
        getattr(config.camera, name).model_copy(update=small) for name in ("front", "rear")
    )
    cameras = config.camera.model_copy(update={"front": front, "rear": rear})
    config = config.model_copy(update={"camera": cameras})
    scenario = parse_scenario("arena4:rendered=1,camera_hz=3,seed=3,seconds=12")
    right, wrong = Watched(), Watched()
    for message in Simulation(scenario, config).messages():
        right.take(message)
        wrong.take(exchanged(message) if isinstance(message, Bearings) else message)
    assert cameras_against_lidar(right, config) == []
    (finding,) = cameras_against_lidar(wrong, config)
    assert (finding.part, finding.level) == ("cross-check", Level.FAIL)
    assert "front and rear camera are exchanged" in finding.what
    assert "exchange the two sources in [camera.front] and [camera.rear]" in finding.next_step


def exchanged(bearings: Bearings) -> Bearings:
    """What the other camera would have made of that picture."""
    return dataclasses.replace(
        bearings,
        bearings=wrap(bearings.bearings + np.pi),
        camera={"front": "rear", "rear": "front"}[bearings.camera],
        view=(float(wrap(bearings.view[0] + np.pi)), bearings.view[1]),
    )
