"""Stegagno's identities: the algebra by other ways, the whole over seeds and recordings."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from host.geometry import to_frame, to_parent, wrap
from host.messages import Displacement, Positions
from host.recording.elsewhere.mrclam import load_dataset
from host.systems.catalogue import score_systems
from host.systems.id_phd.id_phd import IdPhd
from host.systems.id_phd.mrclam_identities import observer_samples
from host.systems.id_phd.overhead import (
    Overhead,
    OverheadScenario,
    attitude,
    floor_covariances,
    on_floor,
    projected,
)
from host.systems.id_phd.overhead_score import looks, overhead_score
from host.systems.id_phd.poses import Poses, born, log_likelihoods, moved, seen_after, updated
from host.systems.id_phd.scoring import figures
from host.systems.id_phd.settings import IdPhdSettings

small = st.floats(-0.3, 0.3)


def some_poses(random, count=4):
    roots = random.normal(0.0, 0.1, (count, 6, 6))
    means = random.normal(0.0, 1.0, (count, 6)) + np.repeat((0.0, 1.0), 3)
    return Poses(means, roots @ np.swapaxes(roots, 1, 2) + 1e-4 * np.eye(6))


def stepped(means, step, own):
    """Eq. 18 with gains, by the project's rigid motions."""
    x, y, heading, distance, rotation, own_gain = means
    chord = heading + (rotation - 1.0) * step.dpsi / 2.0
    there = to_parent(distance * np.array([[step.dx, step.dy]]), np.array([x, y, chord]))[0]
    angle = own_gain * own.dpsi
    here = to_frame(there[None], np.array([own.dx, own.dy, angle]))[0]
    return np.array([*here, heading + rotation * step.dpsi - angle, *means[3:]])


@settings(max_examples=10)
@given(small, small, small, small, small, small)
def test_the_time_update_is_a_rigid_motion_with_its_jacobian(ax, ay, aw, bx, by, bw):
    random = np.random.default_rng(3)
    poses = some_poses(random)
    step = Displacement(1.0, 1.0, ax, ay, aw, 1e-3, 2e-3)
    own = Displacement(1.0, 1.0, bx, by, bw)
    row = (step.dx, step.dy, step.dpsi, step.translation_variance, step.heading_variance)
    after = seen_after(moved(poses, np.tile(row, (len(poses), 1))), own)
    for k, mean in enumerate(poses.means):
        assert after.means[k] == pytest.approx(stepped(mean, step, own), abs=1e-12)
        columns = [
            stepped(mean + shift, step, own) - stepped(mean - shift, step, own)
            for shift in 1e-6 * np.eye(6)
        ]
        slope = np.array(columns).T / 2e-6
        noise = np.diag((1e-3, 1e-3, 2e-3, 0.0, 0.0, 0.0))
        # The noise enters before the observer's rotation, which turns headings' alone in place.
        lever = np.eye(6)
        angle = mean[5] * own.dpsi
        lever[:2, :2] = [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
        expected = slope @ poses.covariances[k] @ slope.T + lever @ noise @ lever.T
        assert after.covariances[k] == pytest.approx(expected, abs=1e-7)


def test_the_measurement_update_is_that_of_the_information_form():
    random = np.random.default_rng(4)
    poses = some_poses(random)
    readings, noise = random.normal(0.0, 1.0, (4, 2)), np.tile(0.02 * np.eye(2), (4, 1, 1))
    after = updated(poses, readings, noise)
    see = np.eye(2, 6)
    for k in range(4):
        information = np.linalg.inv(poses.covariances[k]) + see.T @ see / 0.02
        spread = np.linalg.inv(information)
        assert after.covariances[k] == pytest.approx(spread, abs=1e-9)
        mean = poses.means[k] + spread @ see.T @ (readings[k] - see @ poses.means[k]) / 0.02
        assert after.means[k] == pytest.approx(mean, abs=1e-9)
        sure = poses.covariances[k, :2, :2] + noise[k]
        known = multivariate_normal(poses.means[k, :2], sure).logpdf(readings)
        assert log_likelihoods(poses, readings, noise)[k] == pytest.approx(known)


@settings(max_examples=20)
@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(1.0, 4.0))
def test_a_tilted_camera_finds_places_on_the_floor(roll, pitch, height):
    """Eq. 1 is a rotation; the way back through eq. 2 with each ray's depth is exact."""
    turn = attitude(roll, pitch)
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    places = np.array([[0.0, 0.0], [0.7, -0.4], [-1.0, 1.0]])
    points = projected(places, turn, height)
    assert on_floor(points, roll, pitch, height) == pytest.approx(places, abs=1e-9)


def test_depth_on_the_optical_axis_alone_is_centimetres_off():
    """What the printed eq. 2 leaves: 3.1 cm at tilt 0.1 rad, pixel 0.4, height 1.5 m."""
    point, pitch, height = np.array([0.4, 0.0, 1.0]), 0.1, 1.5
    printed = attitude(0.0, pitch) @ (height / math.cos(pitch) * point)
    (right,) = on_floor(point[None, :2], 0.0, pitch, height)
    assert 0.02 < abs(printed[0] - right[0]) < 0.09


def test_covariances_on_the_floor_are_those_of_many_draws():
    random = np.random.default_rng(5)
    point, measured = np.array([[0.5, -0.2]]), (0.08, -0.05, 2.0)
    draws = [
        on_floor(
            point + random.normal(0.0, 0.006, (1, 2)),
            *(measured + random.normal(0.0, (0.005, 0.005, 0.01))),
        )[0]
        for _ in range(4000)
    ]
    (claimed,) = floor_covariances(point, measured, 0.006)
    assert np.cov(np.array(draws).T) == pytest.approx(claimed, rel=0.12, abs=1.5e-5)


def test_the_bank_covers_every_heading():
    bank = born(np.zeros(2), np.eye(2), 12, np.zeros(3))
    sigma = math.sqrt(bank.covariances[0, 2, 2])
    for heading in np.linspace(-math.pi, math.pi, 50):
        assert np.abs(wrap(bank.means[:, 2] - heading)).min() < 1.3 * sigma


def test_robots_are_named_within_ten_seconds():
    score = overhead_score(OverheadScenario(seed=1, seconds=4.0))
    assert score["converged_s"] < 3.0
    assert score["error_m"] < 0.02
    assert score["heading_deg"] < 4.0


def test_robots_that_move_alike_stay_unnamed_until_they_part():
    found = looks(OverheadScenario(seed=3, seconds=5.0, alike_s=2.6, false_things=0))
    together = [sample for look in found[:13] for sample in look[:2]]
    assert max(sample.probability for sample in together) < 0.9
    assert all(sample.probability > 0.9 and sample.right for sample in found[-1][:2])


def test_a_robot_that_stands_may_be_a_false_thing():
    found = looks(OverheadScenario(seed=4, seconds=2.4, standing=1))
    assert max(look[2].probability for look in found) < 0.9
    assert all(sample.probability > 0.9 and sample.right for sample in found[-1][:2])


def test_wrong_tags_heal():
    """Early on the right hypothesis is lost among many; tags that are exchanged bring it back."""
    scenario = OverheadScenario(seed=3, seconds=4.0, standing=1)
    assert all(sample.probability > 0.9 and sample.right for sample in looks(scenario)[-1][:2])


def test_recorded_robots_are_named_by_their_odometry(recorded):
    dataset = load_dataset(recorded("mrclam6"))
    found = figures(observer_samples(dataset, 5, until_s=90.0))
    assert found["reported"] > 0.3
    assert found["right"] > 0.5
    assert found["error_m"] < 0.15


def hear_all(localizer, time, names=(7, 9)):
    for name in names:
        localizer.hear(name, Displacement(time, 0.1, 0.02, 0.0, 0.0, 1e-6, 1e-6))


def a_frame(time, *places):
    positions = np.array(places, dtype=float).reshape(-1, 2)
    return Positions(time, positions, np.tile(1e-4 * np.eye(2), (len(positions), 1, 1)))


def test_a_robot_that_sends_nothing_any_more_leaves():
    localizer = IdPhd(IdPhdSettings(silent_s=1.0))
    for k in range(1, 30):
        hear_all(localizer, 0.1 * k, (7, 9) if k < 10 else (9,))
        localizer.update(a_frame(0.1 * k, (0.02 * k, 0.5)))
    assert localizer.identities == [9]
    assert [belief.identity for belief in localizer.beliefs()] == [9]
    hear_all(localizer, 3.0, (7, 9))
    localizer.update(a_frame(3.0, (0.6, 0.5)))
    assert localizer.identities == [9, 7]


def test_nobody_heard_and_nothing_seen_is_no_error():
    localizer = IdPhd(IdPhdSettings())
    for k in range(3):
        localizer.update(a_frame(0.1 * k))
        localizer.update(a_frame(0.1 * k + 0.05, (1.0, 1.0), (-1.0, 0.5)))
    assert localizer.beliefs() == []


def test_two_identities_never_share_a_robot():
    """One robot is seen, two send the same odometry: what both may claim adds up to at most 1."""
    localizer = IdPhd(IdPhdSettings())
    for k in range(1, 40):
        hear_all(localizer, 0.1 * k)
        localizer.update(a_frame(0.1 * k, (0.02 * k, 0.5)))
    assert sum(belief.probability for belief in localizer.beliefs()) < 1.0 + 1e-9
    assert all(belief.probability > 0.3 for belief in localizer.beliefs())


def test_odometry_that_comes_late_is_not_lost():
    """Half of it arrives a frame later: the robot is where it truly is once all is there."""
    late, prompt = IdPhd(IdPhdSettings()), IdPhd(IdPhdSettings())
    for k in range(1, 30):
        for localizer, delay in ((prompt, 0), (late, 1)):
            if k > delay:
                hear_all(localizer, 0.1 * (k - delay), (7,))
            localizer.update(a_frame(0.1 * k, (0.02 * k, 0.5)))
    assert late.beliefs()[0].pose == pytest.approx(prompt.beliefs()[0].pose, abs=0.02)


def test_the_filter_as_printed_runs_on_the_same_source():
    """It names robots, too; how well is for the documentation."""
    (row,) = (
        row
        for row in score_systems(["overhead:seed=1,seconds=1"], ["id_phd"])
        if row.variant == "printed"
    )
    assert row.figures["error_m"] < 2.0 or math.isinf(row.figures["error_m"])
    (refused,) = score_systems(["intruder:seed=1"], ["id_phd"])
    assert "odometry that the others send" in refused.why


def test_the_simulated_camera_is_deterministic():
    first, second = (Overhead(OverheadScenario(seed=8, seconds=1.0)) for _ in range(2))
    for step in range(1, 20):
        assert np.array_equal(first.readings(step).positions, second.readings(step).positions)
