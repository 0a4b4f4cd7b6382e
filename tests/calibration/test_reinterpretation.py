"""A recording under other settings is what the devices would have given with those settings."""

import numpy as np
import pytest

from host.calibration.reinterpretation import Reinterpretation
from host.config import RobotConfig
from host.messages import Bearings, Displacement, Message, Scan
from host.simulation.built import built
from host.simulation.scenarios import parse
from host.simulation.world import Simulation

SCENARIO = "misbuilt4:seconds=4,seed=3,camera_hz=2"
TOLD = RobotConfig()
TRUE = built(TOLD, parse(SCENARIO))


def run(config: RobotConfig) -> list[Message]:
    return list(Simulation(parse(SCENARIO), config).messages())


@pytest.fixture(scope="module")
def runs() -> tuple[list[Message], list[Message]]:
    """The same devices, heard by a host that knows the robot badly, and by one that knows it."""
    seen = Reinterpretation(TOLD, TRUE)
    return [seen.of(message) for message in run(TOLD)], run(TRUE)


def test_odometry_is_that_of_the_other_wheels(runs: tuple[list[Message], list[Message]]) -> None:
    made, expected = ([m for m in run if isinstance(m, Displacement)] for run in runs)
    assert len(made) > 150
    assert made == expected
    assert made != [m for m in run(TOLD) if isinstance(m, Displacement)]


def test_scans_are_of_the_same_time(runs: tuple[list[Message], list[Message]]) -> None:
    made, expected = ([m for m in run if isinstance(m, Scan)] for run in runs)
    assert len(made) > 20
    for one, other in zip(made, expected, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-9)
        assert one.times == pytest.approx(other.times, abs=1e-9)
        assert np.array_equal(one.ranges, other.ranges)


def test_bearings_are_those_of_the_other_mounting(
    runs: tuple[list[Message], list[Message]],
) -> None:
    """Made from pixels; the search of a picture takes another way to the same bearing."""
    made, expected = ([m for m in run if isinstance(m, Bearings)] for run in runs)
    compared = 0
    for one, other in zip(made, expected, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-9)
        assert (one.eye, one.origin) == (other.eye, other.origin)
        assert one.view == pytest.approx(other.view, abs=0.01)
        assert one.pixels is not None
        assert other.pixels is not None
        for pixel, bearing in zip(one.pixels, one.bearings, strict=True):
            near = np.flatnonzero(np.hypot(*(other.pixels - pixel).T) < 0.5)
            if len(near):
                assert bearing == pytest.approx(other.bearings[near[0]], abs=2e-3)
                compared += 1
    assert compared > 15


def test_the_same_settings_change_nothing() -> None:
    same = Reinterpretation(TOLD, TOLD)
    for message in run(TOLD)[:300]:
        assert same.of(message) is message
