"""The drive to calibrate by: both ways round, near and far, until it is enough."""

import numpy as np

from host.behaviour.interface import Command
from host.behaviour.survey import LEAST_WAY_M, Survey, most_open_direction
from host.geometry import wrap
from tests.behaviour.situations import situation, wall
from tests.behaviour.unicycle import led


def test_it_rotates_and_curves_both_ways_and_ends_when_it_is_enough() -> None:
    survey = Survey()
    poses = led(survey, 400.0, at=lambda time: survey.end() if time >= 30.0 else None)
    rotations = np.diff(poses[:, 2])
    ways = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert ways.sum() >= LEAST_WAY_M - 0.1
    assert len(poses) < 300 / 0.02
    still = ways < 1e-6
    for sign in (1.0, -1.0):
        assert (sign * rotations[still & (sign * rotations > 0)]).sum() > 2 * np.pi
        assert (~still & (sign * rotations > 0.005)).any()
    assert (~still & (np.abs(rotations) < 1e-3)).any()


def test_it_goes_on_until_it_is_told_that_it_is_enough() -> None:
    assert len(led(Survey(), 20.0)) == 20 / 0.02 + 1


def test_it_goes_for_the_nearest_teammate_and_stops_in_front_of_it() -> None:
    survey = Survey(1)
    far, near = np.array([[1.5, 0.3], [2.0, -2.0]]), np.array([[0.5, 0.0]])
    assert survey.command(situation(teammates=far)).turn_rate_radps > 0.0  # type: ignore[union-attr]
    straight = survey.command(situation(time=0.1, teammates=np.array([[1.4, 0.0]])))
    assert isinstance(straight, Command)
    assert straight.speed_mps > 0.0
    survey.command(situation(time=0.2, teammates=near))
    assert survey._number == 2


def test_the_most_open_direction_leads_off_a_wall() -> None:
    assert abs(wrap(most_open_direction(situation(wall(0.4, 0.5))) - 0.5)) > 1.5
    assert most_open_direction(situation()) == 0.0
