"""Odometry gains by the scans' own motion: drawn rooms, and wheels that report wrongly."""

import math
from dataclasses import replace

import numpy as np
import pytest

from host.config import Lidar, RobotConfig
from host.estimator import profiles
from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.monitored import MonitoredFilter
from host.evaluation.truth_scoring import score_by_track
from host.geometry import Path
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Scan
from host.perception.odometry_gains import OdometryGains, arc_of
from host.sessions.recordings import runs

WALLS_M = (-2.0, 2.5, -1.5, 1.0)  # x, x, y, y
STEP_S, SCAN_S = 0.05, 1.05


def scan(time, pose, random, samples=360):
    """What a lidar at `pose` sees of a rectangular room with 4 mm of noise."""
    angles = np.linspace(-math.pi, math.pi, samples, endpoint=False)
    c, s = np.cos(angles + pose[2]), np.sin(angles + pose[2])
    left, right, low, high = WALLS_M
    with np.errstate(divide="ignore"):
        to_x = np.where(c > 0, right - pose[0], left - pose[0]) / c
        to_y = np.where(s > 0, high - pose[1], low - pose[1]) / s
    ranges = np.minimum(to_x, to_y) + 0.004 * random.standard_normal(samples)
    return Scan(time, np.full(samples, time), angles, ranges)


def learnt(seconds, reported, true=lambda time: (0.2, 0.6 * math.sin(0.7 * time)), seed=1):
    """Gains after a drive. true, reported(time): speed m/s and rate rad/s."""
    random, gains, path = np.random.default_rng(seed), OdometryGains(Lidar()), Path()
    pose, next_scan = np.zeros(3), 0.0
    for step in range(int(seconds / STEP_S)):
        time = STEP_S * (step + 1)
        forth = 1.0 if math.sin(0.35 * time) > 0.0 else -1.0  # lest it drive through a wall
        speed, rate = true(time)
        pose += STEP_S * np.array(
            [forth * speed * math.cos(pose[2]), forth * speed * math.sin(pose[2]), rate]
        )
        speed, rate = reported(*true(time))
        step_told = Displacement(time, STEP_S, forth * speed * STEP_S, 0.0, rate * STEP_S)
        path.append(gains.corrected(step_told))
        if time >= next_scan:
            gains.take(scan(time, pose, random), path)
            next_scan += SCAN_S
    return gains


@pytest.mark.parametrize(
    ("distance", "rotation"), [(1.0, 1.0), (1.1, 0.9), (0.9, 1.1), (1.0, 1.15)]
)
def test_gains_are_learnt_apart_and_reported_when_far_from_one(distance, rotation):
    gains = learnt(60.0, lambda speed, rate: (speed / distance, rate / rotation))
    assert gains.known
    assert gains.gains == pytest.approx((distance, rotation), abs=0.025)
    wrong = gains.fault()
    if distance == rotation == 1.0:
        assert wrong is None
        assert "x1.0" in gains.summary()
    else:
        assert wrong is not None
        assert ("drives" in wrong) == (distance != 1.0)
        assert "rotates" in wrong
        assert "swarmloc calibrate wheels" in wrong


def test_wheels_that_spin_in_the_air_are_slip_and_no_gain():
    gains = learnt(30.0, lambda *_: (0.3, 0.0), true=lambda _: (0.0, 0.0))
    assert gains.gains == pytest.approx((1.0, 1.0), abs=0.02)


def test_a_robot_that_stands_learns_nothing():
    gains = learnt(20.0, lambda speed, rate: (speed, rate), true=lambda _: (0.0, 0.0))
    assert not gains.known
    assert gains.gains == (1.0, 1.0)


def test_an_arc_has_the_length_that_its_chord_stands_for():
    for length, rotation in ((0.5, 0.0), (0.5, 1.2), (-0.3, 0.8), (0.4, -2.0)):
        radius = length / rotation if rotation else math.inf
        x, y = (length, 0.0)
        if rotation:
            x, y = radius * math.sin(rotation), radius * (1.0 - math.cos(rotation))
        assert arc_of(np.array([x, y, rotation])) == pytest.approx((length, rotation))


def test_with_odometry_off_by_a_tenth_false_reports_stay_rare():
    run = runs.simulate_scenario("arena4:seconds=25,seed=44", RobotConfig())
    scored, estimates = Accumulator(), []
    filter_ = MonitoredFilter(profiles.make("pmb", run.config), scored.update_seconds, estimates)
    localizer = Localizer(run.config, filter_)
    for message in run.messages:
        if isinstance(message, Displacement):
            localizer.handle(
                replace(message, dx=1.1 * message.dx, dy=1.1 * message.dy, dpsi=1.1 * message.dpsi)
            )
        elif not isinstance(message, Bearings):
            localizer.handle(message)
    score_by_track(estimates, TruthTrack(run.truths), scored)
    row = scored.row("", "", "", "").as_json()
    assert localizer.odometry.gains == pytest.approx((1 / 1.1, 1 / 1.1), abs=0.04)
    assert row["false"] <= 0.3
    assert row["gospa_m"] < 0.1
