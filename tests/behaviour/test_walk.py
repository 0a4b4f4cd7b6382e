"""The random walk: straight on, away from what is ahead."""

import math

import numpy as np
import pytest

from host.behaviour.walk import AHEAD_M, TURN_SECONDS, RandomWalk
from tests.behaviour.situations import situation


def at_bearing(degrees: float, distance: float = AHEAD_M - 0.1) -> np.ndarray:
    angle = math.radians(degrees)
    return np.array([[distance * math.cos(angle), distance * math.sin(angle)]])


@pytest.mark.parametrize("degrees", [-70, -30, -5, 5, 30, 70])
def test_it_turns_away_from_the_side_where_something_is_for_a_random_while(degrees: int) -> None:
    durations = []
    for seed in range(8):
        walk, step = RandomWalk(seed), 0
        assert walk.command(situation()).turn_rate_radps == 0.0
        first = walk.command(situation(at_bearing(degrees), 1.0))
        assert first.speed_mps == 0.0
        assert np.sign(first.turn_rate_radps) == -np.sign(degrees)
        while walk.command(situation(time=1.0 + 0.01 * step)).speed_mps == 0.0:
            step += 1
        durations.append(0.01 * step)
    assert TURN_SECONDS[0] <= min(durations) < max(durations) <= TURN_SECONDS[1] + 0.02


def test_it_goes_straight_on_past_what_is_beside_behind_or_far() -> None:
    walk = RandomWalk(1)
    for thing in (at_bearing(100), at_bearing(180), at_bearing(0, AHEAD_M + 0.1)):
        command = walk.command(situation(thing))
        assert (command.speed_mps > 0.0, command.turn_rate_radps) == (True, 0.0)


def test_between_two_things_it_takes_either_way_and_keeps_to_it() -> None:
    both = np.concatenate((at_bearing(50), at_bearing(-50)))
    signs = set()
    for seed in range(12):
        walk = RandomWalk(seed)
        turns = {
            np.sign(walk.command(situation(both, 0.05 * k)).turn_rate_radps) for k in range(60)
        }
        assert len(turns - {0.0}) == 1  # it does not dither
        signs |= turns - {0.0}
    assert signs == {-1.0, 1.0}


def test_teammates_of_the_filter_are_avoided_as_what_the_lidar_sees() -> None:
    mates = at_bearing(20)
    assert RandomWalk().command(situation(teammates=mates)).turn_rate_radps < 0.0
