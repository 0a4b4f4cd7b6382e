import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import BlindSector, FilterSettings, Lidar, PmbSettings
from host.estimator.phd import PhdFilter
from host.messages import Bearings, Displacement, Positions
from tests.estimator.standing_robot import MOST, RATE_HZ, Run, heard, seen

# What these tests rely on, whatever the defaults are tuned to.
NO_OBSTACLES = {"pmb": PmbSettings(obstacle_share=0.0)}
ONLY_TEAMMATES = FilterSettings(**NO_OBSTACLES)


def generous(**settings):
    """Teammates are reported however badly they are known."""
    return FilterSettings(pmb=PmbSettings(obstacle_share=0.0, report_error_m=5.0), **settings)


def tracking(points, settings=ONLY_TEAMMATES, lidar=None, camera=None):
    """A run in which both sensors have seen teammates at these points for a second."""
    run = Run(settings, lidar, camera)
    for _ in range(7):
        run.look(points)
    assert len(run.estimate().positions) == len(np.reshape(points, (-1, 2)))
    return run


def ring(distance):
    return np.full(360, distance)


# What a thing is: motion and cameras tell.


def noisy(random, point):
    return np.asarray(point) + random.normal(0.0, 0.01, 2)


def test_what_stands_still_without_cameras_is_taken_for_an_obstacle():
    random, run = np.random.default_rng(1), Run()
    for _ in range(42):
        estimate = run.scan([noisy(random, [1.0, 0.5])])
    assert len(estimate.positions) == 0


def test_what_moves_is_a_teammate():
    random, run = np.random.default_rng(1), Run()
    place = np.array([1.0, 0.5])
    for k in range(42):
        place = place + np.array([0.1, -0.2]) / RATE_HZ
        estimate = run.scan([noisy(random, place)])
        if k >= 7:
            assert len(estimate.positions) == 1
            assert np.hypot(*(estimate.positions[0] - place)) < 0.05


def test_a_teammate_that_stops_and_drives_off_again_is_a_teammate_again():
    random, run = np.random.default_rng(1), Run()
    for _ in range(70):
        run.scan([noisy(random, [1.0, 0.5])])
    place = np.array([1.0, 0.5])
    for _ in range(14):
        place = place + np.array([0.0, 0.25]) / RATE_HZ
        estimate = run.scan([noisy(random, place)])
    assert len(estimate.positions) == 1


def test_of_a_thing_that_fades_to_nothing_a_picture_makes_nothing():
    """An interval may be of any length, whatever the times: shares of a weight of 0 are not nan."""
    filter_ = PhdFilter()
    filter_.update(Positions(0.0, np.array([[1.0, 0.0]]), 1e-4 * np.eye(2)[None]))
    filter_.predict(Displacement(0.1, 1e6, 0.0, 0.0, 0.0))
    filter_.update(Bearings(0.1, np.array([0.1]), np.array([0.01])))
    assert np.isfinite(filter_._things.weights).all()


def test_cameras_tell_within_a_second_that_a_standing_thing_is_a_teammate():
    random, run = np.random.default_rng(1), Run()
    for _ in range(4):
        run.scan([noisy(random, [1.0, 0.5])])
        estimate = run.image(math.atan2(0.5, 1.0) + random.normal(0.0, 0.08))
    assert run.time < 1.2
    assert len(estimate.positions) == 1


def test_cameras_tell_within_two_seconds_that_a_standing_thing_is_an_obstacle():
    random = np.random.default_rng(1)
    run = Run()
    for k in range(14):
        run.scan([noisy(random, [1.0, 0.2 * k / RATE_HZ])])
    assert len(run.estimate().positions) == 1
    for _ in range(14):
        run.scan([noisy(random, [1.0, 0.4])])
        estimate = run.image([])
    assert len(estimate.positions) == 0


# Memory: a reported teammate is not forgotten lightly.


def test_a_teammate_that_was_not_told_apart_once_is_still_reported():
    """The beams end where it stands, but no turret was found."""
    run = tracking([1.0, 0.0])
    label = run.estimate().labels[0]
    estimate = run.scan([], clearance=ring(1.0))
    assert estimate.positions == pytest.approx(np.array([[1.0, 0.0]]), abs=0.02)
    assert estimate.labels.tolist() == [label]
    assert estimate.ages == pytest.approx([1.0 / RATE_HZ])


def test_without_a_clearance_one_miss_is_forgiven_where_the_settings_say_so():
    lidar = Lidar(detection_probability=0.9)
    forgiving = FilterSettings(**NO_OBSTACLES, forget_weight=0.3)
    strict = FilterSettings(**NO_OBSTACLES, forget_weight=0.5)
    for choice, count in ((forgiving, 1), (strict, 0)):
        run = tracking([1.0, 0.0], choice, lidar)
        assert len(run.scan([], clearance=None).positions) == count


def test_a_weight_below_one_half_is_reported_only_if_it_was_before():
    fresh = Run(ONLY_TEAMMATES)
    first = fresh.scan([[1.0, 0.0]])
    assert len(first.positions) == 0
    known = tracking([1.0, 0.0])
    (weight,) = known.scan([], clearance=ring(1.0)).weights
    assert weight < 0.5


def test_it_is_forgotten_after_a_few_misses_in_plain_view():
    run = tracking([1.0, 0.0])
    for _ in range(3):
        estimate = run.scan([])
    assert len(estimate.positions) == 0


def test_it_is_kept_for_seconds_while_something_stands_before_it():
    run = tracking([1.0, 0.0])
    for _ in range(14):
        estimate = run.scan([], clearance=ring(0.5))
    assert len(estimate.positions) == 1


def test_it_is_kept_behind_another_teammate_where_no_clearance_is_told():
    run = tracking([[0.8, 0.0], [1.8, 0.0], [0.0, 1.8]])
    for _ in range(7):
        estimate = run.scan([[0.8, 0.0]], clearance=None)
    assert sorted(np.rint(10 * estimate.positions[:, 0]).tolist()) == [8, 18]


def test_it_is_kept_for_long_in_a_blind_sector():
    pillar = Lidar(blind_sectors=(BlindSector(centre_rad=0.0, width_rad=0.2),))
    hidden, plain = tracking([1.0, 0.02], lidar=pillar), tracking([1.0, 0.02])
    for _ in range(21):
        hidden.scan([])
        plain.scan([])
    assert len(hidden.estimate().positions) == 1
    assert len(plain.estimate().positions) == 0


def test_one_that_is_no_longer_known_well_enough_is_not_reported_until_seen_again():
    run = tracking([1.0, 0.0])
    label = run.estimate().labels[0]
    run.wait(10.0)
    assert len(run.estimate().positions) == 0
    assert run.scan([[1.0, 0.0]]).labels.tolist() == [label]


def test_beyond_the_survival_range_it_fades_within_seconds():
    near, far = (tracking([1.0, 0.0], generous(survival_range_m=reach)) for reach in (3.0, 0.9))
    for run in (near, far):
        run.wait(4.0)
        run.scan([], clearance=ring(0.5))
    assert len(near.estimate().positions) == 1
    assert len(far.estimate().positions) == 0


# One thing in one place.


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_two_that_meet_in_one_place_are_never_more_than_one(seed):
    """Two teammates run into the same spot, where one reading a scan stays."""
    random = np.random.default_rng(seed)
    run = Run(ONLY_TEAMMATES)
    for gap in np.linspace(0.6, 0.0, 12):
        points = [[1.0, gap], [1.0, -gap]] if gap > 0.1 else [[1.0, 0.0]]
        estimate = run.scan(np.add(points, random.normal(0.0, 0.01, np.shape(points))))
    for _ in range(7):
        estimate = run.scan([noisy(random, [1.0, 0.0])])
    assert len(estimate.positions) == 1
    assert estimate.weights[0] <= MOST


def test_two_teammates_side_by_side_are_two():
    run = tracking([[1.0, 0.15], [1.0, -0.15]])
    for _ in range(14):
        estimate = run.look([[1.0, 0.15], [1.0, -0.15]])
    assert len(estimate.positions) == 2
    assert len(set(estimate.labels.tolist())) == 2


# Bearings.


def test_a_bearing_pulls_the_estimate_onto_its_ray_from_where_the_ray_started():
    run = tracking([2.0, 0.0], generous())
    run.wait(3.0)
    origin, target = np.array([0.3, -0.6]), np.array([2.0, 0.15])
    toward = target - origin
    before = run.estimate().positions[0]
    run.filter.update(
        heard(run.time, math.atan2(toward[1], toward[0]), 0.005, tuple(origin.tolist()))
    )
    after = run.estimate().positions[0]

    def off_the_ray(point):
        rest = point - origin
        return abs(toward[0] * rest[1] - toward[1] * rest[0]) / np.hypot(*toward)

    assert off_the_ray(before) > 0.1
    assert off_the_ray(after) < 0.02
    along = toward / np.hypot(*toward)
    # It moved across the ray only.
    assert abs((after - before) @ along) < 0.03


def test_the_older_an_image_the_less_it_moves_an_estimate():
    moves = []
    for lag in (0.0, 0.2, 0.5):
        run = tracking([2.0, 0.0])
        run.filter.update(heard(run.time, 0.02, 0.01, lag=lag))
        moves.append(run.estimate().positions[0, 1])
    assert moves[0] > moves[1] > moves[2] > 0.0


def near_estimates(truth, estimate):
    """Distance (n,) from each true position to the nearest estimate."""
    gaps = np.linalg.norm(truth[:, None] - estimate.positions, axis=2)
    return gaps.min(axis=1, initial=math.inf)


def test_cameras_follow_a_teammate_that_the_lidar_does_not_see():
    """It drives behind a pillar of the lidar's own, and there it turns back."""
    lidar = Lidar(blind_sectors=(BlindSector(centre_rad=0.0, width_rad=2.0),))
    errors = []
    for cameras in (True, False):
        random, run = np.random.default_rng(2), Run(generous(), lidar)
        for k, angle in enumerate(0.2 + np.abs(np.linspace(1.0, -0.4, 70))):
            place = 1.5 * np.array([math.cos(angle), math.sin(angle)])
            run.scan([noisy(random, place)] if k < 50 else [])
            if cameras:
                run.filter.update(heard(run.time, angle + random.normal(0.0, 0.08)))
        errors.append(near_estimates(place[None], run.estimate())[0])
    assert errors[0] < 0.3
    assert errors[1] > 0.5


def test_messages_are_left_as_they_were():
    run = tracking([[1.0, 0.0], [0.0, 1.0]])
    scan = seen(run.time, [[1.0, 0.0], [0.0, 1.0]], lags=np.array([0.1, 0.0]))
    image = heard(run.time, [0.0, 1.5], lag=0.1)
    kept = copy.deepcopy((scan, image))
    run.filter.update(scan)
    run.filter.update(image)
    for now, then in zip((scan, image), kept, strict=True):
        for name in ("positions", "covariances", "lags", "clearance", "bearings", "variances"):
            assert np.array_equal(getattr(now, name, 0), getattr(then, name, 0))


def test_empty_messages_are_taken_before_and_after_the_first_teammate():
    run = Run(ONLY_TEAMMATES)
    for estimate in (run.estimate(), run.image([]), run.scan([]), run.scan([], clearance=None)):
        assert estimate.positions.shape == (0, 2)
        assert estimate.covariances.shape == (0, 2, 2)
        assert len(estimate.weights) == len(estimate.ages) == len(estimate.labels) == 0
        assert estimate.time <= run.time
    run.image([0.3])  # a blob where nothing is known
    for _ in range(3):
        run.look([1.0, 0.0])
    run.image([])
    run.look([1.0, 0.0])
    assert len(run.scan([], clearance=ring(1.0)).positions) == 1


def test_a_camera_that_shows_no_bearing_at_all_tells_nothing():
    run = tracking([1.0, 0.0])
    before = run.estimate()
    run.filter.update(Bearings(run.time, np.zeros(0), np.zeros(0), view=(0.3, 0.0)))
    np.testing.assert_allclose(run.estimate().weights, before.weights)
    np.testing.assert_allclose(run.estimate().positions, before.positions)


def test_readings_from_very_far_or_on_the_robot_itself_do_no_harm():
    run = tracking([1.0, 0.0])
    odd = [[900.0, -900.0], [900.0, 0.0], [0.0, 0.0], [1e-9, 0.0], [1.0, 0.0], [1.0, 0.0]]
    for _ in range(3):
        estimate = run.scan(odd)
        run.filter.update(heard(run.time, [0.0, math.pi, -math.pi]))
    close = np.hypot(*(estimate.positions - [1.0, 0.0]).T) < 0.05
    assert np.any(close)
    assert np.all(np.isfinite(estimate.positions))
    run.wait(5.0)
    assert np.all(np.hypot(*run.scan([]).positions.T) < 1e3)


def test_a_moving_robot_keeps_a_standing_teammate_where_it_is():
    """The robot drives a circle; nothing is seen any more, the estimate follows by odometry."""
    run = tracking([1.0, 0.5], ONLY_TEAMMATES)
    step = Displacement(0.0, 0.1, 0.05, 0.0, 0.2)
    pose = np.zeros(3)
    for _ in range(20):
        run.time += 0.1
        run.filter.predict(Displacement(run.time, 0.1, step.dx, step.dy, step.dpsi))
        c, s = math.cos(pose[2]), math.sin(pose[2])
        pose += [c * step.dx, s * step.dx, step.dpsi]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = 1.0 - pose[0], 0.5 - pose[1]
    estimate = run.estimate()
    assert estimate.positions == pytest.approx(np.array([[c * x + s * y, c * y - s * x]]), abs=1e-6)
    assert estimate.ages == pytest.approx([2.0])
