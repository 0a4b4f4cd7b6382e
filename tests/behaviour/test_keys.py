"""Whoever lets go of the key stops the robot."""

import pytest

from host.behaviour.interface import STILL, Command
from host.behaviour.keys import CREEP, FASTEST_MPS, FIRST_S, HELD_S, Keys
from tests.behaviour.situations import situation


def wanted(keys: Keys, time: float) -> Command | None:
    return keys.command(situation(time=time))


def test_a_first_press_creeps_and_a_held_key_drives_until_it_is_let_go() -> None:
    keys = Keys()
    assert wanted(keys, 0.0) == STILL
    keys.press("w", 1.0)
    assert wanted(keys, 1.1) == Command(CREEP * FASTEST_MPS, 0.0)
    assert CREEP * FASTEST_MPS * FIRST_S < 0.1
    for time in (1.5, 1.53, 1.56):
        keys.press("w", time)
    assert wanted(keys, 1.57) == Command(FASTEST_MPS, 0.0)
    assert wanted(keys, 1.56 + HELD_S) == STILL
    keys.press("s", 2.0)
    assert wanted(keys, 2.0) == Command(-CREEP * FASTEST_MPS, 0.0)


@pytest.mark.parametrize("key", [" ", "k", "\x1b"])
def test_any_other_key_stops_at_once_and_end_ends(key: str) -> None:
    keys = Keys()
    keys.press("d", 1.0)
    keys.press("d", 1.1)
    assert wanted(keys, 1.15).turn_rate_radps < 0.0  # type: ignore[union-attr]
    keys.press(key, 1.16)
    assert wanted(keys, 1.17) == STILL
    keys.press("d", 1.2)
    keys.end()
    assert wanted(keys, 1.21) is None
