"""NIS of each sensor: near 1 where the noise is as configured, a warning where it is off by 3."""

import dataclasses
import math

import numpy as np
import pytest

from host.config import RobotConfig
from host.estimator.consistency import CAMERAS, LIDAR, WHEELS
from host.estimator.profiles import make
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Positions, Scan
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario

PLACES = np.array([[1.0, 0.4], [-0.8, 0.9], [-0.3, -1.4]])  # of things that stand still
LIDAR_M, BEARING_RAD, STEP_M, STEP_RAD = 0.01, 0.08, 0.004, 0.006  # stds; of a tenth of a second


def a_run(profile, lidar=1.0, cameras=1.0, wheels=1.0, seconds=90.0, until_said=False, seed=5):
    """A robot that drives in a circle; each true noise is so many times the configured one.

    until_said: it ends where something is found wrong, if before `seconds`.
    """
    random = np.random.default_rng(seed)
    ours = Localizer(RobotConfig(), make(profile, RobotConfig()))
    x, y, psi = 0.0, -0.5, 0.0
    for step in range(1, int(10 * seconds)):
        if until_said and step % 50 == 0 and ours.consistency.fault():
            break
        time, dx, dpsi = 0.1 * step, 0.02, 0.04
        x, y = x + dx * math.cos(psi), y + dx * math.sin(psi)
        psi += dpsi
        slip = random.normal(0.0, wheels, 3) * (STEP_M, STEP_M, STEP_RAD)
        noise = STEP_M**2, STEP_RAD**2
        ours.handle(Displacement(time, 0.1, dx + slip[0], slip[1], dpsi + slip[2], *noise))
        c, s = math.cos(psi), math.sin(psi)
        true = (PLACES - (x, y)) @ np.array([[c, -s], [s, c]])
        seen = true + random.normal(0.0, lidar * LIDAR_M, true.shape)
        ours.handle(Positions(time, seen, np.tile(LIDAR_M**2 * np.eye(2), (3, 1, 1))))
        bearings = np.arctan2(true[:, 1], true[:, 0]) + random.normal(0.0, cameras * BEARING_RAD, 3)
        ours.handle(Bearings(time, bearings, np.full(3, BEARING_RAD**2)))
    return ours.consistency


@pytest.mark.parametrize("profile", ["pmb", "phd"])
def test_what_is_configured_as_it_is_gives_one_and_no_warning(profile):
    noise = a_run(profile, seconds=150.0)
    for sensor in (LIDAR, WHEELS, CAMERAS):
        assert 0.6 < noise.ratio(sensor) < 1.5, sensor
    assert noise.fault() is None
    assert noise.summary().startswith("they fit the data (NIS over the expected: lidar")


# With bearings as bad as that, `phd` reports no thing that stands still as a teammate.
@pytest.mark.parametrize(
    ("profile", "off", "words"),
    [
        ("pmb", {"lidar": 3.0}, "range_noise_m"),
        ("phd", {"lidar": 3.0}, "range_noise_m"),
        ("phd", {"wheels": 3.0}, "heading_noise_rad"),
        ("pmb", {"cameras": 3.0}, "raise bearing_noise_rad"),
        ("phd", {"cameras": 1.0 / 3.0}, "lower bearing_noise_rad"),
    ],
    ids=str,
)
def test_noise_that_is_off_by_three_is_named(profile, off, words):
    wrong = a_run(profile, **off, until_said=True).fault()
    assert wrong is not None
    assert words in wrong


def test_nothing_is_said_before_there_is_enough():
    noise = a_run("phd", lidar=9.0, seconds=3.0)
    assert not noise.known
    assert math.isnan(noise.ratio(LIDAR))
    assert noise.fault() is None


@pytest.fixture(scope="module")
def arena():
    simulation = Simulation(parse_scenario("arena4:seconds=60,seed=31"), RobotConfig())
    kinds = Scan | Bearings | Displacement
    return simulation.config, [m for m in simulation.messages() if isinstance(m, kinds)]


def warnings(config, messages):
    """What is said in a run, once a second."""
    ours, said, due = Localizer(config, make("phd", config)), [], 0.0
    for message in messages:
        ours.handle(message)
        if message.time > due:
            due, wrong = due + 1.0, ours.consistency.fault()
            said += [] if wrong is None else [wrong]
    return said


def test_a_healthy_simulation_is_silent(arena):
    assert warnings(*arena) == []


@pytest.mark.parametrize("off", [3.0, 1.0 / 3.0])
def test_in_the_simulation_bearings_that_are_off_by_three_are_noticed(arena, off):
    config, messages = arena
    changed = [
        dataclasses.replace(m, variances=m.variances / off**2) if isinstance(m, Bearings) else m
        for m in messages
        if m.time < 60.0
    ]
    said = warnings(config, changed)
    assert said
    assert all("bearing_noise_rad" in wrong for wrong in said)
