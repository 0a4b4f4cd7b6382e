"""The firmware's machine code at the wheel: it drives, and it stops when anything is lost."""

from pathlib import Path

import numpy as np
import pytest

from host.behaviour.interface import Command, Situation
from host.config import RobotConfig
from host.geometry import to_frame
from host.sessions.offline.swarming import Swarm
from host.simulation.devices.board import BoardKind, wired
from host.simulation.devices.romeo_elf_device import RomeoElfDevice
from host.simulation.offline import OBSERVER
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario

ROOMY = parse_scenario("arena4:robots=1,posts=0,side_m=8,seed=3,wheel_slip=0,stacks=own")
CONFIG = RobotConfig()


class Curve:
    """At full speed along a curve, for a while."""

    def command(self, now: Situation) -> Command:
        return Command(1.0, 0.3 if now.time < 1.2 else 0.0)


def driven(board: BoardKind | None, seconds: float) -> Swarm:
    swarm = Swarm(ROOMY, CONFIG, lambda _: Curve(), board)
    for number in range(round(seconds * 50)):
        swarm.step(number)
    return swarm


def firmware(elf: Path) -> BoardKind:
    return BoardKind(lambda ticks: RomeoElfDevice(elf, wired(ticks, CONFIG.motors)), "firmware")


def track(swarm: Swarm, times: np.ndarray) -> np.ndarray:
    """Places in the frame of the start."""
    poses = swarm.arena.poses(np.concatenate(([0.0], times)))[:, OBSERVER]
    return to_frame(poses[1:, :2], poses[0])


def test_the_fast_model_drives_as_the_firmware_does(elf: Path) -> None:
    times = np.array([0.8, 1.4, 1.9])
    fast, real = (track(driven(board, 2.0), times) for board in (None, firmware(elf)))
    assert np.hypot(*real[-1]) > 0.2
    assert np.hypot(*(fast - real).T).max() < 0.05


@pytest.mark.parametrize("loss", ["lidar", "host"])
def test_the_firmware_stops_within_a_third_of_a_second(elf: Path, loss: str) -> None:
    swarm = driven(firmware(elf), 1.4)
    if loss == "lidar":
        swarm.observer.lidar.answers = False
    else:  # the program died: no frame comes any more
        swarm.observer.board.receive = lambda data, now: None  # type: ignore[method-assign]
    for number in range(70, 110):
        swarm.step(number)
    lost = 69 * 0.02
    places = track(swarm, lost + np.array([-0.02, 0.0, 0.3, 0.32, 0.7]))
    assert np.hypot(*(places[1] - places[0])) / 0.02 > 0.2
    assert np.hypot(*(places[4] - places[1])) < 0.1
    assert np.hypot(*(places[3] - places[2])) / 0.02 < 0.02


def test_a_robot_that_is_driven_against_a_wall_stays_there_and_is_counted_once() -> None:
    arena = Arena(parse_scenario("arena4:robots=2,posts=0,seed=4"))
    start = arena.poses(np.array([0.0]))[0, 0]
    arena.hand_over(0, lambda until: (0.006, 0.0))  # straight on at 0.3 m/s, whatever comes
    arena.advance(15.0)
    (end,) = arena.poses(np.array([14.9]))[:, 0]
    assert np.abs(end[:2]).max() == pytest.approx(1.5 - 0.143, abs=0.01)
    assert end[2] == pytest.approx(start[2])
    own = [contact for contact in arena.contacts if contact.robot == 0 and contact.other == -1]
    assert len(own) == 1
    still = arena.poses(np.array([14.0]))[0, 0]
    assert np.allclose(still, end)
