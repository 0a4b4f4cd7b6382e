"""A recording under other settings is what the devices would have given with those settings."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.calibration.reinterpretation import Reinterpretation
from host.config import RobotConfig
from host.messages import Bearings, Displacement, Message, Scan
from host.perception.strips.finder import StripFinder
from host.simulation.offline import Simulation
from host.simulation.world.built import built
from host.simulation.world.scenarios import parse_scenario

SCENARIO = "misbuilt4:seconds=4,seed=3,camera_hz=2"
TOLD = RobotConfig()
TRUE = built(TOLD, parse_scenario(SCENARIO))


def run(config: RobotConfig) -> list[Message]:
    return list(Simulation(parse_scenario(SCENARIO), config).messages())


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
        assert (one.camera, one.origin) == (other.camera, other.origin)
        assert one.view == other.view
        assert one.pixels is not None
        assert other.pixels is not None
        for pixel, bearing in zip(one.pixels, one.bearings, strict=True):
            near = np.flatnonzero(np.hypot(*(other.pixels - pixel).T) < 0.5)
            if len(near):
                assert bearing == pytest.approx(other.bearings[near[0]], abs=2e-3)
                compared += 1
    assert compared > 15


def test_the_view_is_that_of_the_other_lens_and_what_it_does_not_draw_is_left_out() -> None:
    narrow = TOLD.camera.front.model_copy(update={"k1": -0.15, "focal_px": 700.0})
    camera = TOLD.camera.model_copy(update={"front": narrow})
    told = Bearings(
        1.0,
        np.array([0.0, 0.1, 0.2]),
        np.full(3, 4e-4),
        ranges=np.array([1.0, 2.0, 3.0]),
        camera="front",
        pixels=np.array([(959.5, 300.0), (-500.0, 0.0), (900.0, 310.0)]),
    )
    found = Reinterpretation(TOLD, TOLD.model_copy(update={"camera": camera})).of(told)
    assert isinstance(found, Bearings)
    assert np.isfinite(found.bearings).all()
    assert found.pixels is not None
    assert found.ranges is not None
    assert found.pixels[:, 0].tolist() == [959.5, 900.0]
    assert found.ranges.tolist() == [1.0, 3.0]
    assert len(found.bearings) == len(found.variances) == 2
    assert found.view[1] != pytest.approx(
        StripFinder(TOLD.camera, TOLD.camera.front).geometry.view[1]
    )
    assert found.view == StripFinder(camera, narrow).geometry.view


@given(st.floats(0.003, 0.1), st.floats(0.003, 0.1), st.floats(0.002, 0.1))
def test_the_pixels_own_noise_stays_when_that_of_lens_and_mounting_changes(
    old: float, new: float, pixels: float
) -> None:
    def configured(noise: float) -> RobotConfig:
        camera = TOLD.camera.model_copy(update={"bearing_noise_rad": noise})
        return TOLD.model_copy(update={"camera": camera})

    seen = Bearings(1.0, np.zeros(1), np.array([math.hypot(pixels, old) ** 2]), camera="front")
    found = Reinterpretation(configured(old), configured(new)).of(seen)
    assert isinstance(found, Bearings)
    assert math.sqrt(found.variances[0]) == pytest.approx(math.hypot(pixels, new), rel=1e-6)


def test_bearings_beyond_the_reach_of_the_new_lens_are_less_certain() -> None:
    front = TOLD.camera.front
    known = front.model_copy(update={"reach_rad": 0.8, "beyond_noise_per_rad": 0.5})
    camera = TOLD.camera.model_copy(update={"front": known})
    pixels = np.array([(959.5, 539.5), (959.5 - 1.2 * front.focal_px, 539.5)])  # 0 and 1.2 rad off
    told = Bearings(1.0, np.zeros(2), np.full(2, 4e-4), camera="front", pixels=pixels)
    changed = TOLD.model_copy(update={"camera": camera})
    found = Reinterpretation(TOLD, changed).of(told)
    assert isinstance(found, Bearings)
    assert found.variances == pytest.approx([4e-4, 4e-4 + (0.5 * 0.4**2) ** 2])
    back = Reinterpretation(changed, TOLD).of(found)
    assert isinstance(back, Bearings)
    assert back.variances == pytest.approx([4e-4, 4e-4])


def test_the_same_settings_change_nothing() -> None:
    same = Reinterpretation(TOLD, TOLD)
    for message in run(TOLD)[:300]:
        assert same.of(message) is message
