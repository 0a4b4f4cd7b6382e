"""Noise on the encoders' leads: what no wheel does is not counted as motion, but as what it is."""

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame, VelocityFrame
from host.simulation.devices.romeo_elf import CHANNEL_A, CHANNEL_B, LEFT, RIGHT
from tests.firmware.boards import ElfBoard

PULSES = 100
PERIOD_S = 0.937e-3  # not that of anything on the board
WIDTHS_US = (0.5, 0.8, 1.3, 2.0, 3.0, 4.0, 5.0)
LEADS = {"A": (CHANNEL_A,), "B": (CHANNEL_B,), "both": (CHANNEL_A, CHANNEL_B)}


def report(board: ElfBoard) -> DisplacementFrame:
    return [frame for _, frame in board.run(0.06) if isinstance(frame, DisplacementFrame)][-1]


def moved(before: DisplacementFrame, after: DisplacementFrame) -> tuple[int, int]:
    return after.left_ticks - before.left_ticks, after.right_ticks - before.right_ticks


@pytest.mark.parametrize("leads", LEADS)
@pytest.mark.parametrize("edges", [2, 4])
def test_pulses_at_rest_count_nothing(elf: Callable[[int], Path], edges: int, leads: str) -> None:
    board = ElfBoard(elf(edges), edges)
    for wheel, rest, width_us in itertools.product((LEFT, RIGHT), (0, 1), WIDTHS_US):
        board.elf.turn(wheel, rest, board.now + 0.001)
        board.run(0.01)
        before = report(board)
        for channel in LEADS[leads]:
            board.elf.disturb(wheel, channel, 1e-6 * width_us, PERIOD_S, PULSES)
        board.run(PULSES * PERIOD_S)
        assert moved(before, report(board)) == (0, 0), f"{width_us} us on wheel {wheel}"


@pytest.mark.parametrize("edges", [2, 4])
def test_a_burst_counts_nothing(elf: Callable[[int], Path], edges: int) -> None:
    board = ElfBoard(elf(edges), edges)
    before = report(board)
    for period_us, width_us in ((3, 1), (6, 3), (11, 4), (20, 5), (50, 25), (200, 80)):
        for channel in (CHANNEL_A, CHANNEL_B):
            board.elf.disturb(LEFT, channel, 1e-6 * width_us, 1e-6 * period_us, 50)
            board.run(0.03)
            assert moved(before, report(board)) == (0, 0), f"{width_us} us each {period_us} us"


@pytest.mark.parametrize(("edges", "width_us"), [(2, 1.0), (2, 2.5), (4, 1.0)])
def test_short_pulses_are_reported_as_illegal(
    elf: Callable[[int], Path], edges: int, width_us: float
) -> None:
    board = ElfBoard(elf(edges), edges)
    before = report(board)
    assert (before.left_illegal, before.right_illegal) == (0, 0)
    board.elf.disturb(RIGHT, CHANNEL_A, 1e-6 * width_us, PERIOD_S, PULSES)
    board.run(PULSES * PERIOD_S)
    after = report(board)
    assert PULSES - 5 <= after.right_illegal <= 2 * PULSES
    # Four times a period, a pulse that is over before it is looked at does not show whose it was.
    assert after.left_illegal == (0 if edges == 2 else after.right_illegal)


def test_both_channels_at_once_are_an_illegal_transition(elf: Callable[[int], Path]) -> None:
    board = ElfBoard(elf(4), 4)
    for channel in (CHANNEL_A, CHANNEL_B):
        board.elf.disturb(LEFT, channel, 100e-6, PERIOD_S, PULSES)
    board.run(PULSES * PERIOD_S)
    after = report(board)
    assert (after.left_ticks, after.right_ticks) == (0, 0)
    assert (after.left_illegal, after.right_illegal) == (2 * PULSES, 0)


@pytest.mark.parametrize(("edges", "rate"), [(2, 29_000), (4, 60_000)])
def test_fast_wheels_are_exact_and_nothing_of_them_is_illegal(
    elf: Callable[[int], Path], edges: int, rate: int
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.send(encode(HelloFrame()))
    expected = [0, 0]
    for k in range(60):
        left, right = (round(share * rate / 20) for share in ((1, -0.97), (-0.93, 1))[k // 4 % 2])
        board.send(encode(VelocityFrame(300 + k, -300 - k)))
        board.turn(left, right, 0.05)
        expected = [expected[0] + left, expected[1] + right]
    after = report(board)
    assert [after.left_ticks, after.right_ticks] == expected
    assert (after.left_illegal, after.right_illegal) == (0, 0)


@pytest.mark.parametrize("edges", [2, 4])
def test_short_pulses_on_a_do_not_spoil_a_moving_wheel(
    elf: Callable[[int], Path], edges: int
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.elf.disturb(LEFT, CHANNEL_A, 0.6e-6, 0.7331e-3, 1300)
    board.turn(2000, -2000, 1.0)
    after = report(board)
    assert after.left_ticks == pytest.approx(2000, abs=2)
    assert after.right_ticks == -2000
