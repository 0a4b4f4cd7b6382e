"""The loop closed: the real machine code drives a motor model and counts what it turns."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from host.config import Motors, RobotConfig, Wheels
from host.drivers.romeo.differential_drive import wheel_speeds
from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import VelocityFrame
from host.drivers.romeo.session import BoardSession, settings_for
from host.geometry import rotation
from host.messages import FloatArray
from host.simulation.devices.motors import DrivenRobot
from host.simulation.devices.romeo_elf import RomeoElf

STEP_S = 0.001
SPEED_MPS = 0.3
NOMINAL_V = 6.0


class Drive:
    """A robot with the real firmware, its host, and where its odometry believes it to be."""

    def __init__(
        self,
        elf: Path,
        edges: int = 2,
        supply_v: float = NOMINAL_V,
        slip: float = 0.0,
        motors: Motors | None = None,
    ) -> None:
        self.config = RobotConfig(
            wheels=Wheels(counts_per_turn=960 * edges), motors=motors or Motors()
        )
        self.board = RomeoElf(elf, edges)
        self.robot = DrivenRobot(self.board, self.config.wheels, supply_v, (slip, slip))
        self.session = BoardSession(self.config)
        self.believed = np.zeros(3)
        self.board.open_port()
        self.board.run(0.2)
        self.session.connect(self.board.now)
        while not self.session.state(self.board.now)[0]:
            self.go(0.0, 0.0, 0.02)

    def go(self, speed_mps: float, turn_rate_radps: float, seconds: float) -> FloatArray:
        """Command it so for so long; the wheels' rim speeds (k, 2) m/s, each millisecond."""
        left, right = wheel_speeds(self.config.wheels, speed_mps, turn_rate_radps)
        wanted = (round(left), round(right))
        radius = self.config.wheels.left_radius_m
        speeds = []
        start = self.board.now
        for k in range(round(seconds / STEP_S)):
            self.board.send(self.session.transmit(self.board.now, wanted))
            self.robot.run(start + (k + 1) * STEP_S)
            speeds.append([radius * wheel.speed for wheel in self.robot.wheels])
            for at, data in self.board.take():
                for step in self.session.receive(data, at):
                    self.believed[:2] += rotation(self.believed[2]) @ (step.dx, step.dy)
                    self.believed[2] += step.dpsi
        return np.array(speeds)


@pytest.mark.parametrize("edges", [2, 4])
@pytest.mark.parametrize("supply", [0.9, 1.0, 1.1])
def test_a_speed_step_settles_within_half_a_second(
    elf: Callable[[int], Path], edges: int, supply: float
) -> None:
    drive = Drive(elf(edges), edges, supply * NOMINAL_V)
    speeds = drive.go(SPEED_MPS, 0.0, 2.0)
    assert speeds.max() < 1.10 * SPEED_MPS
    settled = speeds[500:]
    assert settled.min() > 0.95 * SPEED_MPS
    assert settled.max() < 1.05 * SPEED_MPS


def test_a_blocked_wheel_does_not_wind_up(elf: Callable[[int], Path]) -> None:
    released = {}
    for blocked_s in (1.0, 10.0):
        # Of the control alone: with the default both motors go off after 0.3 s (test_runaway.py).
        drive = Drive(elf(2), motors=Motors(runaway_s=0.0))
        drive.go(SPEED_MPS, 0.0, 1.0)
        left, _ = drive.robot.wheels
        left.blocked = True
        during = drive.go(SPEED_MPS, 0.0, blocked_s)
        assert during[-100:, 1] == pytest.approx(SPEED_MPS, rel=0.05), "the other wheel goes on"
        left.blocked = False
        released[blocked_s] = drive.go(SPEED_MPS, 0.0, 2.0)[:, 0]
    assert released[10.0].max() == pytest.approx(released[1.0].max(), rel=0.03)
    assert released[10.0].max() < 1.25 * SPEED_MPS
    assert released[10.0][1000:] == pytest.approx(SPEED_MPS, rel=0.05)


def test_it_stops_when_told_and_when_nothing_is_told(elf: Callable[[int], Path]) -> None:
    drive = Drive(elf(2))
    drive.go(SPEED_MPS, 0.0, 1.0)
    drive.go(0.0, 0.0, 0.8)
    assert [wheel.speed for wheel in drive.robot.wheels] == [0.0, 0.0]
    drive.go(-SPEED_MPS, 0.0, 1.0)
    drive.robot.run(drive.board.now + 1.0)
    assert [wheel.speed for wheel in drive.robot.wheels] == [0.0, 0.0]


def square(drive: Drive) -> tuple[FloatArray, FloatArray]:
    """Round a square of 1 m, counter-clockwise: believed and true end point (x, y) m."""
    for _ in range(4):
        drive.go(SPEED_MPS, 0.0, 1.0 / SPEED_MPS)
        drive.go(0.0, 0.0, 0.4)
        drive.go(0.0, math.pi / 2.0, 1.0)
        drive.go(0.0, 0.0, 0.4)
    return drive.believed[:2], np.array(drive.robot.pose[:2])


@pytest.mark.slow
@pytest.mark.parametrize("edges", [2, 4])
def test_odometry_ends_where_the_robot_does(elf: Callable[[int], Path], edges: int) -> None:
    believed, true = square(Drive(elf(edges), edges))
    assert np.hypot(*(believed - true)) < 0.0025
    assert np.hypot(*true) < 0.12, "it was to come back"


@pytest.mark.slow
def test_slip_shows_as_what_it_is(elf: Callable[[int], Path]) -> None:
    drive = Drive(elf(2), slip=0.03)
    believed, true = square(drive)
    # Wheels that slip by 3 per cent turn the robot by 3 per cent less than it believes: 360 deg
    # are 349 in truth, and the end point is off accordingly.
    heading_error = drive.believed[2] - drive.robot.pose[2]
    wrapped = (heading_error + math.pi) % (2.0 * math.pi) - math.pi
    assert wrapped == pytest.approx(0.03 * 2.0 * math.pi, rel=0.1)
    assert 0.02 < np.hypot(*(believed - true)) < 0.6


def test_a_reversed_motor_is_driven_the_other_way(elf: Callable[[int], Path]) -> None:
    board = RomeoElf(elf(2), 2)
    config = RobotConfig()
    config = config.model_copy(
        update={"motors": config.motors.model_copy(update={"left_reversed": True})}
    )
    board.open_port()
    board.run(0.2)
    board.send(encode(settings_for(config)) + encode(VelocityFrame(500, 500)))
    board.run(0.3)
    left, right = board.motors
    assert left == pytest.approx(-right)
    assert right > 0.0
