"""Wheels that do not follow their motors: the real firmware, a motor model, the host's words."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from host.config import Motors
from tests.firmware.test_driving import NOMINAL_V, SPEED_MPS, Drive

LEFT, RIGHT = 0, 1
NAMES = ("left", "right")


def off_after(drive: Drive, speed_mps: float, patience_s: float = 3.0) -> float:
    """Seconds until both motors are off."""
    start = drive.board.now
    while drive.board.motors != (0.0, 0.0):
        drive.go(speed_mps, 0.0, 0.01)
        assert drive.board.now < start + patience_s, f"still driving: {drive.board.motors}"
    return drive.board.now - start


def said(drive: Drive) -> tuple[bool, str]:
    drive.go(0.1, 0.0, 0.06)  # until the board has reported it
    return drive.session.state(drive.board.now)


@pytest.mark.parametrize("edges", [2, 4])
@pytest.mark.parametrize("speed_mps", [0.05, 0.1, -0.1, 0.4])
@pytest.mark.parametrize("wheel", [LEFT, RIGHT])
def test_a_dead_encoder(
    elf: Callable[[int], Path], edges: int, speed_mps: float, wheel: int
) -> None:
    drive = Drive(elf(edges), edges)
    drive.go(0.0, 0.0, 0.1)
    drive.robot.wheels[wheel].encoder = 0.0
    drive.go(speed_mps, 0.0, 0.02)
    assert off_after(drive, speed_mps) < 0.6
    ok, reason = said(drive)
    assert not ok
    assert f"the {NAMES[wheel]} wheel" in reason
    for cause in ("encoder's lead is off", "wheel is blocked", "motor has no supply"):
        assert cause in reason


@pytest.mark.parametrize("edges", [2, 4])
@pytest.mark.parametrize("wheel", [LEFT, RIGHT])
@pytest.mark.parametrize("speed_mps", [0.1, -0.3])
def test_an_encoder_that_is_the_wrong_way_round(
    elf: Callable[[int], Path], edges: int, wheel: int, speed_mps: float
) -> None:
    drive = Drive(elf(edges), edges)
    drive.robot.wheels[wheel].encoder = -1.0
    drive.go(speed_mps, 0.0, 0.02)
    assert off_after(drive, speed_mps) < 0.6
    ok, reason = said(drive)
    assert not ok
    assert (
        f"the {NAMES[wheel]} wheel was driven one way and its encoder counted the other" in reason
    )
    assert f"{NAMES[wheel]}_encoder_reversed" in reason


def test_an_encoder_that_dies_while_driving(elf: Callable[[int], Path]) -> None:
    drive = Drive(elf(2))
    drive.go(SPEED_MPS, 0.0, 1.0)
    drive.robot.wheels[RIGHT].encoder = 0.0
    assert 0.27 < off_after(drive, SPEED_MPS) < 0.45


def test_an_encoder_that_mostly_fails(elf: Callable[[int], Path]) -> None:
    drive = Drive(elf(2))
    drive.go(SPEED_MPS, 0.0, 1.0)
    start = drive.board.now
    while drive.board.motors != (0.0, 0.0):
        for share, seconds in ((0.0, 0.05), (1.0, 0.005)):
            drive.robot.wheels[LEFT].encoder = share
            drive.go(SPEED_MPS, 0.0, seconds)
        assert drive.board.now < start + 1.0


def test_a_stop_command_ends_it_and_the_host_sends_one_when_nothing_is_asked(
    elf: Callable[[int], Path],
) -> None:
    drive = Drive(elf(2))
    drive.robot.wheels[LEFT].encoder = 0.0
    drive.go(0.1, 0.0, 1.0)
    assert drive.session.counts()["runaways"] == 1
    drive.robot.wheels[LEFT].encoder = 1.0
    drive.go(0.0, 0.0, 0.1)
    speeds = drive.go(SPEED_MPS, 0.0, 1.0)
    assert speeds[-1] == pytest.approx([SPEED_MPS, SPEED_MPS], rel=0.05)
    assert drive.session.state(drive.board.now)[0]
    assert drive.session.counts()["runaways"] == 1


@pytest.mark.parametrize("dip_v", [0.0, 2.0])
@pytest.mark.parametrize("seconds", [0.1, 1.0])
def test_a_dip_of_the_supply_does_not_stop_the_robot_for_ever(
    elf: Callable[[int], Path], dip_v: float, seconds: float
) -> None:
    drive = Drive(elf(2))
    drive.go(SPEED_MPS, 0.0, 1.0)
    drive.robot.supply_v = dip_v
    drive.go(SPEED_MPS, 0.0, seconds)
    drive.robot.supply_v = NOMINAL_V
    speeds = drive.go(SPEED_MPS, 0.0, 3.5)
    assert speeds[-1] == pytest.approx([SPEED_MPS, SPEED_MPS], rel=0.05)
    assert drive.session.state(drive.board.now)[0]


def test_a_blocked_wheel_is_let_go_and_tried_again(elf: Callable[[int], Path]) -> None:
    drive = Drive(elf(2))
    drive.go(SPEED_MPS, 0.0, 1.0)
    drive.robot.wheels[LEFT].blocked = True
    driven = 0.0
    for _ in range(50):
        drive.go(SPEED_MPS, 0.0, 0.1)
        driven += 0.1 * (drive.board.motors != (0.0, 0.0))
    assert driven < 1.5, "of 5 s"
    assert drive.session.counts()["runaways"] == 2
    drive.robot.wheels[LEFT].blocked = False
    speeds = drive.go(SPEED_MPS, 0.0, 4.0)
    assert speeds[-1] == pytest.approx([SPEED_MPS, SPEED_MPS], rel=0.05)


def test_a_board_without_encoders_drives_on(elf: Callable[[int], Path]) -> None:
    drive = Drive(elf(2), motors=Motors(runaway_s=0.0))
    for wheel in drive.robot.wheels:
        wheel.encoder = 0.0
    drive.go(SPEED_MPS, 0.0, 3.0)
    assert min(drive.board.motors) > 0.0
    assert drive.session.state(drive.board.now)[0]


@pytest.mark.parametrize("edges", [2, 4])
@pytest.mark.parametrize("supply", [0.7, 1.0, 1.25])
def test_healthy_wheels_never_trip_it(
    elf: Callable[[int], Path], edges: int, supply: float
) -> None:
    drive = Drive(elf(edges), edges, supply * NOMINAL_V)
    manoeuvres = ((0.4, 0.0), (-0.4, 0.0), (0.0, 3.0), (0.0, -3.0), (0.02, 0.0), (0.2, 1.0))
    for speed_mps, turn_rate in manoeuvres:
        drive.go(speed_mps, turn_rate, 0.7)
    assert drive.session.counts()["runaways"] == 0
    counts = drive.session.counts()
    assert (counts["illegal_left"], counts["illegal_right"]) == (0, 0)
    assert counts["odometry_disagreements"] == 0


@pytest.mark.parametrize("acceleration_mps2", [1.5, 20.0])
@pytest.mark.parametrize("friction", [1.0, 2.0])
def test_a_robot_of_three_times_the_mass_reverses_on_a_weak_battery(
    elf: Callable[[int], Path], acceleration_mps2: float, friction: float
) -> None:
    drive = Drive(
        elf(2), supply_v=0.8 * NOMINAL_V, motors=Motors(acceleration_mps2=acceleration_mps2)
    )
    for wheel in drive.robot.wheels:
        motor = wheel.motor
        wheel.motor = replace(
            motor,
            inertia_kg_m2=3.0 * motor.inertia_kg_m2,
            coulomb_n_m=friction * motor.coulomb_n_m,
        )
    for speed_mps in (0.45, -0.45, 0.45):
        drive.go(speed_mps, 0.0, 1.0)
    assert drive.session.counts()["runaways"] == 0
