"""Driving by a stick: released or not heard, the robot stops."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.behaviour.interface import STILL
from host.behaviour.safety import REACTION_S, STOP_S, Safety
from host.behaviour.stick import FASTEST_MPS, FASTEST_RADPS, SILENT_S, Stick
from host.config import RobotConfig
from tests.behaviour.situations import situation


def test_it_drives_while_it_is_held_and_stops_when_it_is_not_heard() -> None:
    stick = Stick()
    assert stick.command(situation(time=1.0)) == STILL
    stick.move(0.5, -1.0, 1.0)
    command = stick.command(situation(time=1.0 + 0.9 * SILENT_S))
    assert command is not None
    assert command.speed_mps == pytest.approx(0.5 * FASTEST_MPS)
    assert command.turn_rate_radps == pytest.approx(-FASTEST_RADPS)
    assert stick.command(situation(time=1.0 + SILENT_S)) == STILL
    stick.move(1.0, 0.0, 2.0)
    stick.release()
    assert stick.command(situation(time=2.0)) == STILL
    stick.end()
    assert stick.command(situation(time=2.0)) is None


@given(st.floats(), st.floats())
def test_it_is_never_faster_than_it_may_be(ahead: float, left: float) -> None:
    stick = Stick()
    stick.move(ahead, left, 1.0)
    command = stick.command(situation(time=1.0))
    assert command is not None
    assert abs(command.speed_mps) <= FASTEST_MPS
    assert abs(command.turn_rate_radps) <= FASTEST_RADPS


def test_a_silent_stick_leaves_time_to_brake() -> None:
    config = RobotConfig()
    speed = min(FASTEST_MPS, Safety(config).top_speed_mps)
    braking_s = speed / config.motors.acceleration_mps2
    assert SILENT_S + 0.5 * REACTION_S + braking_s <= STOP_S
