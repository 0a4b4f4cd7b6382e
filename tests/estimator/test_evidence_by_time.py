"""Evidence counts by time: a sensor that reads more often makes the filter no surer of errors."""

import math
from dataclasses import replace

import pytest

from host.messages import Bearings
from host.sessions.recordings.runs import simulate_scenario
from host.sources.sensors import LIDAR_AND_CAMERA, LIDAR_ONLY

SECONDS, SEED = 25, 41


def gospa(run, sensors=LIDAR_AND_CAMERA) -> float:
    return run.score("pmb", sensors).row("", "", "pmb", "").gospa_m


def arena(revolutions_hz: float):
    return simulate_scenario(f"arena4:seconds={SECONDS},seed={SEED},lidar_turn_hz={revolutions_hz}")


@pytest.fixture(scope="module")
def slow():
    return arena(6)


def test_a_lidar_that_spins_twice_as_fast_does_no_harm(slow):
    assert gospa(arena(12), LIDAR_ONLY) < 1.1 * gospa(slow, LIDAR_ONLY)


def test_each_picture_six_times_changes_next_to_nothing(slow):
    messages = [
        message
        for message in slow.messages
        for _ in range(6 if isinstance(message, Bearings) else 1)
    ]
    again = gospa(replace(slow, messages=messages))
    assert math.isclose(again, gospa(slow), rel_tol=0.1)
