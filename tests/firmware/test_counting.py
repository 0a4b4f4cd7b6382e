"""Not one tick is lost at speeds the motors do not reach, whatever the host does meanwhile."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import (
    DisplacementFrame,
    HelloFrame,
    SettingsReversed,
    VelocityFrame,
)
from host.simulation.devices.romeo_stand_in import DEFAULTS
from tests.firmware.boards import ElfBoard

# Ticks/s of each wheel, beyond the most of the motors: some 6400 at 2x, 13000 at 4x.
RATES = {2: 8_000, 4: 20_000}
SECONDS = 5


def last_ticks(board: ElfBoard) -> tuple[int, int]:
    """What it reports when the wheels have come to rest."""
    reports = [frame for _, frame in board.run(0.1) if isinstance(frame, DisplacementFrame)]
    return reports[-1].left_ticks, reports[-1].right_ticks


@pytest.mark.parametrize("edges", [2, 4])
def test_ticks_are_exact_while_the_host_streams_commands_and_reads(
    elf: Callable[[int], Path], edges: int
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.send(encode(HelloFrame()))
    rate = RATES[edges]
    expected = [0, 0]
    # Both ways, the wheels not in step: half a tenth of a second of 1:1, then 1:-0.93, and so on.
    shares = [(1.0, 0.93), (1.0, -0.93), (-0.93, 1.0), (-1.0, -0.93)]
    for k in range(20 * SECONDS):
        left, right = (round(rate * share / 20) for share in shares[k % 4])
        board.send(encode(VelocityFrame(300 + k, -300 - k)))
        board.turn(left, right, 0.05)
        expected[0] += left
        expected[1] += right
        if k % 40 == 39:
            assert last_ticks(board) == tuple(expected), f"after {board.now:.1f} s"
    assert last_ticks(board) == tuple(expected)
    for sense in (1, -1):
        for _ in range(SECONDS):
            board.send(encode(VelocityFrame(sense * 500, sense * 500)))
            board.turn(sense * rate, -sense * rate, 1.0)
            expected[0] += sense * rate
            expected[1] -= sense * rate
        assert last_ticks(board) == tuple(expected), f"sense {sense}"
    assert board.elf.steps == tuple(n * 4 // edges for n in expected)
    assert board.decoder.counts.refused == 0


@pytest.mark.parametrize("edges", [2, 4])
def test_a_wheel_that_trembles_on_an_edge_counts_nothing(
    elf: Callable[[int], Path], edges: int
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.turn(3, 5, 0.01)
    for _ in range(300):
        board.turn(1, -1, 0.0005)
        board.turn(-1, 1, 0.0005)
    assert last_ticks(board) == (3, 5)


@pytest.mark.parametrize("edges", [2, 4])
def test_reversed_encoders_count_the_other_way_from_where_they_were(
    elf: Callable[[int], Path], edges: int
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.turn(1000, 1000, 0.5)
    board.send(encode(replace(DEFAULTS, reversed=SettingsReversed.LEFT_ENCODER)))
    assert last_ticks(board) == (1000, 1000)
    board.turn(-300, -300, 0.5)
    assert last_ticks(board) == (1300, 700)
