"""Which board a simulation gets, and that the robot's odometry is the same with either."""

from pathlib import Path

import pytest

from host.config import Motors, RobotConfig
from host.drivers.romeo.session import BoardSession
from host.flashing import build as romeo_build
from host.simulation.devices.board import STAND_IN, BoardKind, best_board
from host.simulation.devices.romeo_elf_device import RomeoElfDevice
from host.simulation.devices.romeo_stand_in import RomeoStandIn

WIRED_BACKWARD = Motors(left_encoder_reversed=True)


def driving(now: float) -> tuple[int, int]:
    return int(1500 * now), int(900 * now)


def ticks_told(kind: BoardKind, motors: Motors) -> tuple[int, int]:
    """What a host makes of 2 s with such a board, in ticks (left, right)."""
    board = kind.make(driving)
    session = BoardSession(RobotConfig(motors=motors))
    session.connect(0.0)
    told = [0, 0]
    for k in range(1, 201):
        now = 0.01 * k
        for at, data in board.transmit(now):
            for step in session.receive(data, at):
                assert step.ticks is not None
                told[0] += step.ticks[0]
                told[1] += step.ticks[1]
        board.receive(session.transmit(now, None), now)
    return told[0], told[1]


@pytest.mark.parametrize("motors", [Motors(), WIRED_BACKWARD])
def test_both_boards_tell_the_same_way(elf: Path, motors: Motors) -> None:
    firmware = best_board(motors)
    assert isinstance(firmware.make(driving), RomeoElfDevice)
    assert "the firmware, built with avr-gcc" in firmware.name
    left, right = ticks_told(firmware, motors)
    # It starts up for 0.12 s, and the handshake takes a moment.
    assert left == pytest.approx(1500 * 1.85, abs=60)
    assert left / right == pytest.approx(1500 / 900, rel=0.01)
    left, right = ticks_told(STAND_IN, motors)
    assert left == pytest.approx(1500 * 1.97, abs=60)
    assert left / right == pytest.approx(1500 / 900, rel=0.01)


def test_without_a_compiler_it_is_the_stand_in_and_the_reason_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(romeo_build._PACKAGES, "gcc-avr", tmp_path / "avr-gcc")
    board = best_board(Motors())
    assert isinstance(board.make(driving), RomeoStandIn)
    assert board.name.startswith("a stand-in (")
