"""A board that is left alone, hung or reset does not drive on."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import (
    COMMAND_TIMEOUT_MS,
    DisplacementFrame,
    SettingsReversed,
    VelocityFrame,
)
from host.simulation.devices.romeo_stand_in import DEFAULTS
from tests.firmware.boards import ElfBoard

TIMEOUT_S = COMMAND_TIMEOUT_MS / 1000
CONTROL_S = 0.010  # the control counts the command's age in its own periods
ON_THE_WAY_S = 0.002  # of a command, over USB and through the loop
WATCHDOG_S = 0.5
# Machine code. The endless wait jumps to itself; the deaf one switches interrupts off before.
ENDLESS_WAIT = bytes.fromhex("ffcf")
DEAF_WAIT = bytes.fromhex("f894ffcf")
STEP_S = 0.001


@pytest.fixture(params=[2, 4])
def board(request: pytest.FixtureRequest, elf: Callable[[int], Path]) -> ElfBoard:
    board = ElfBoard(elf(request.param), request.param)
    # Its wheels do not turn, which is what test_runaway.py is about.
    board.send(encode(replace(DEFAULTS, runaway=0)))
    for _ in range(5):
        board.send(encode(VelocityFrame(2000, -2000)))
        board.run(0.1)
    board.send(encode(VelocityFrame(2000, -2000)))
    board.run(0.003)
    assert board.driving == (1, -1)
    return board


def seconds_until_off(board: ElfBoard, patience_s: float = 2.0) -> float:
    """From the last command, which came 3 ms ago; and off it must stay."""
    start = board.now - 0.003
    while board.driving != (0, 0):
        board.elf.run(board.now + STEP_S)
        assert board.now < start + patience_s, "still driving"
    off = board.now - start
    for _ in range(1000):
        board.elf.run(board.now + STEP_S)
        assert board.driving == (0, 0)
    return off


def check_timed_out(board: ElfBoard) -> None:
    off = seconds_until_off(board)
    assert TIMEOUT_S < off <= TIMEOUT_S + CONTROL_S + ON_THE_WAY_S + STEP_S


def test_motors_go_off_when_the_host_says_nothing_more(board: ElfBoard) -> None:
    check_timed_out(board)
    assert board.elf.restarts == 0


def test_motors_go_off_in_the_31st_period_of_the_control(board: ElfBoard) -> None:
    """150 to 160 ms after the last command, by where in a 10 ms period of the control it comes."""
    seconds_until_off(board)  # a period begins, to a step
    for phase_s in (0.001, 0.003, 0.005, 0.007):
        board.send(encode(VelocityFrame(2000, -2000)))
        board.run(5 * CONTROL_S + phase_s)
        board.send(encode(VelocityFrame(2000, -2000)))
        board.run(0.003)
        off = seconds_until_off(board)
        assert off == pytest.approx(TIMEOUT_S + CONTROL_S - phase_s, abs=1.5 * STEP_S)


def test_motors_go_off_when_the_host_neither_speaks_nor_reads(board: ElfBoard) -> None:
    board.elf.reading = False
    check_timed_out(board)
    assert board.elf.restarts == 0


def test_motors_go_off_when_the_host_has_closed_the_port(board: ElfBoard) -> None:
    board.elf.close_port()
    check_timed_out(board)


def test_motors_go_off_while_the_loop_hangs_and_the_watchdog_ends_it(board: ElfBoard) -> None:
    board.elf.patch("loop", ENDLESS_WAIT)
    # What comes now is heard by nobody.
    board.send(encode(VelocityFrame(2000, -2000)) * 20)
    check_timed_out(board)
    assert board.elf.restarts >= 1


def test_a_hang_with_interrupts_off_is_ended_by_the_watchdog(board: ElfBoard) -> None:
    board.elf.patch("loop", DEAF_WAIT)
    assert seconds_until_off(board) < 1.2 * WATCHDOG_S
    assert board.elf.restarts >= 1


def test_the_reset_button_stops_the_wheels_at_once(board: ElfBoard) -> None:
    board.elf.reset()
    assert seconds_until_off(board) < 0.01


def test_the_touch_at_1200_baud_leads_to_the_bootloader_from_a_driving_robot(
    board: ElfBoard,
) -> None:
    board.elf.open_port(1200)
    board.run(0.05)
    assert not board.elf.bootloader_asked
    board.elf.close_port(1200)
    # 120 ms on the chip; simavr lets the longer time run out that was set before.
    board.run(1.5 * WATCHDOG_S)
    assert board.elf.bootloader_asked
    assert board.driving == (0, 0)


def test_a_port_closed_and_opened_again_at_another_speed_resets_nothing(board: ElfBoard) -> None:
    for baudrate in (9600, 57600, 115200):
        board.elf.close_port(baudrate)
        board.run(0.1)
        board.elf.open_port(baudrate)
        board.run(0.1)
    reports = [frame for _, frame in board.run(0.1) if isinstance(frame, DisplacementFrame)]
    assert reports
    assert board.elf.restarts == 0
    assert not board.elf.bootloader_asked


def test_a_touch_that_is_taken_back_leaves_the_watchdog_at_work(board: ElfBoard) -> None:
    board.elf.open_port(1200)
    board.run(0.05)
    board.elf.close_port(1200)
    board.run(0.03)
    board.elf.open_port(115200)
    board.run(2.0)
    assert board.elf.restarts == 0
    assert not board.elf.bootloader_asked
    board.elf.patch("loop", ENDLESS_WAIT)
    board.run(2.0 * WATCHDOG_S)
    assert board.elf.restarts >= 1


def test_a_new_polarity_lets_go_of_the_wheels(board: ElfBoard) -> None:
    board.run(0.1)
    before = board.elf.motors
    board.send(encode(replace(DEFAULTS, runaway=0)))  # as they are: nothing changes
    board.run(0.02)
    assert board.elf.motors == pytest.approx(before, abs=0.1)
    board.send(encode(replace(DEFAULTS, runaway=0, reversed=SettingsReversed.LEFT_MOTOR)))
    board.run(0.02)
    assert board.elf.motors == (0.0, 0.0)
    board.send(encode(VelocityFrame(500, 500)))
    board.run(0.1)
    assert board.driving == (-1, 1)
