"""Detection probability and clutter as learnt from associations, by themselves and within `pmb`."""

import math

import numpy as np
import pytest

from host.config import Lidar
from host.estimator.learnt_lidar import LearntLidar
from host.estimator.pmb import PmbFilter
from host.messages import Displacement, Positions

SCAN_S = 1.0 / 7.0
PLAIN = Lidar(blind_sectors=(), detection_probability=0.95)


def learnt(true, seconds=60.0, false=0.0, teammates=3, config=PLAIN, seed=1):
    """After scans in each of which a teammate is found with the probability `true`."""
    random, model = np.random.default_rng(seed), LearntLidar(config)
    sure = np.ones(teammates)
    for _ in range(int(seconds / SCAN_S)):
        found = (random.random(teammates) < true).astype(float)
        model.learn(sure, np.full(teammates, model.close_by), found, SCAN_S)
        model.learn_clutter(float(random.poisson(false)), None, SCAN_S)
    return model


@pytest.mark.parametrize("true", [0.5, 0.6, 0.8])
def test_a_detection_probability_that_is_configured_too_high_is_learnt(true):
    model = learnt(true)
    assert model.close_by == pytest.approx(true, abs=0.07)
    wrong = model.fault()
    assert (wrong is not None) == (true < 0.75)
    if wrong is not None:
        assert "95% are configured" in wrong
        assert "swarmloc calibrate detection" in wrong


def test_it_is_lowered_alone_and_never_below_its_bound():
    assert learnt(0.97).close_by == 0.95
    assert learnt(0.97).known
    assert learnt(0.97).fault() is None
    assert learnt(0.02).close_by == 0.3
    low = Lidar(blind_sectors=(), detection_probability=0.14)
    assert learnt(0.46, config=low).close_by == 0.14
    assert learnt(0.05, config=low).close_by == 0.14


def test_what_is_learnt_is_forgotten_within_minutes():
    model = learnt(0.5)
    for _ in range(int(600.0 / SCAN_S)):
        model.learn(np.ones(3), np.full(3, model.close_by), np.full(3, 0.95), SCAN_S)
    assert model.close_by > 0.93


def test_who_is_unsure_or_hidden_teaches_nothing():
    model = LearntLidar(PLAIN)
    for _ in range(300):
        model.learn(np.array([0.9, 1.0]), np.array([0.95, 0.2]), np.zeros(2), SCAN_S)
    assert model.close_by == 0.95
    assert not model.known


def test_clutter_stays_as_usual_and_follows_a_lidar_that_sees_things():
    area = math.pi * PLAIN.max_range_m**2
    usual = PLAIN.clutter_per_m2 * area
    assert learnt(0.95, false=2.0 * usual).clutter == PLAIN.clutter_per_m2
    worse = learnt(0.95, false=8.0 * usual)
    assert worse.clutter == pytest.approx(5.0 * PLAIN.clutter_per_m2, rel=0.2)
    assert "times the false readings" in worse.fault()
    assert learnt(0.95, false=100.0 * usual).clutter == pytest.approx(10.0 * PLAIN.clutter_per_m2)


def test_clutter_counts_by_what_the_lidar_looks_over():
    """Twice the false readings on twice the area are the same clutter."""
    ratios = []
    for reach, false in ((1.0, 1.0), (math.sqrt(2.0), 2.0)):
        model = LearntLidar(PLAIN)
        for _ in range(2000):
            model.learn_clutter(false, np.full(360, reach), SCAN_S)
        ratios.append(model.clutter)
    assert ratios[0] == pytest.approx(ratios[1], rel=0.02)
    assert ratios[0] > 2.0 * PLAIN.clutter_per_m2


def test_teammates_found_in_three_of_five_scans_stay_reported():
    """P_D truly .6 where .95 is configured: at most 5 % of the teammates are unreported."""
    filter_, random = PmbFilter(lidar=PLAIN), np.random.default_rng(7)
    places, missing, asked = np.array([[1.0, 0.6], [-1.2, 0.4], [0.2, -1.4]]), 0, 0
    velocities = np.array([[-0.1, 0.1], [0.12, 0.05], [0.02, 0.14]])
    for scan in range(350):
        time = SCAN_S * scan
        swing = np.sin(0.2 * time) / 0.2
        true = places + velocities * swing
        seen = true[random.random(3) < 0.6]
        filter_.predict(Displacement(time, SCAN_S, 0.0, 0.0, 0.0))
        noise = 0.01 * random.standard_normal(seen.shape)
        filter_.update(Positions(time, seen + noise, np.tile(1e-4 * np.eye(2), (len(seen), 1, 1))))
        if time > 10.0:
            estimate = filter_.estimate()
            apart = np.linalg.norm(true[:, None] - estimate.positions, axis=2)
            missing += int((apart.min(axis=1, initial=9.0) > 0.3).sum())
            asked += 3
    assert missing <= 0.05 * asked
    assert filter_.learnt.known
    assert filter_.learnt.close_by == pytest.approx(0.6, abs=0.1)
