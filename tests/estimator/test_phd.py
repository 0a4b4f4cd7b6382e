import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import BlindSector, Filter, Lidar
from host.estimator.phd import PhdFilter
from host.messages import Bearings, Displacement, Positions

RATE_HZ = 7.0
PLAIN_VIEW = np.full(360, 100.0)  # the lidar sees past everything
# What these tests rely on, whatever the defaults are tuned to.
RANDOM_WALK = {"motion_noise_m": 0.1, "motion_growth_per_s": 0.0, "obstacle_share": 0.0}
ONLY_TEAMMATES = Filter(**RANDOM_WALK)
MOST = 1.02  # neither kind of thing is ever ruled out, which may add a hundredth


def seen(time, points, sigma=0.01, clearance=PLAIN_VIEW, lags=None):
    points = np.reshape(np.asarray(points, dtype=float), (-1, 2))
    noise = np.tile(sigma**2 * np.eye(2), (len(points), 1, 1))
    return Positions(time, points, noise, lags, clearance)


def heard(time, bearings, sigma=0.0873, origin=(0.0, 0.0), lag=0.0):
    bearings = np.atleast_1d(np.asarray(bearings, dtype=float))
    return Bearings(time, bearings, np.full(len(bearings), sigma**2), origin, lag)


def standing(time, interval):
    return Displacement(time, interval, 0.0, 0.0, 0.0)


class Run:
    """A filter on a robot that stands still, and its clock."""

    def __init__(self, settings=None, lidar=None, camera=None):
        self.filter = PhdFilter(settings, lidar, camera)
        self.time = 0.0

    def wait(self, interval=1.0 / RATE_HZ):
        self.time += interval
        self.filter.predict(standing(self.time, interval))

    def scan(self, points, **how):
        self.wait()
        self.filter.update(seen(self.time, points, **how))
        return self.filter.estimate()

    def look(self, points, **how):
        """A scan and an image of the same instant."""
        self.scan(points, **how)
        x, y = np.reshape(np.asarray(points, dtype=float), (-1, 2)).T
        self.filter.update(heard(self.time, np.arctan2(y, x)))
        return self.filter.estimate()

    def image(self, bearings, **how):
        self.wait()
        self.filter.update(heard(self.time, bearings, **how))
        return self.filter.estimate()

    def estimate(self):
        return self.filter.estimate()


def tracking(points, settings=ONLY_TEAMMATES, lidar=None, camera=None):
    """A run in which both sensors have seen teammates at these points for a second."""
    run = Run(settings, lidar, camera)
    for _ in range(7):
        run.look(points)
    assert len(run.estimate().positions) == len(np.reshape(points, (-1, 2)))
    return run


def ring(distance):
    return np.full(360, distance)


# Equation 6, recomputed one component at a time.

CLUTTER, BIRTH, DETECTED = 0.1, 0.05, 0.8
UNIFORM = Lidar(
    detection_probability=DETECTED,
    half_range_m=999.0,
    min_range_m=0.0,
    target_diameter_m=0.011,
    clutter_per_m2=CLUTTER,
    blind_sectors=(),
)
# Nothing moves, fades, or is pruned, and everything is reported.
EVERYTHING = {
    "obstacle_share": 0.0,
    "birth_per_m2": BIRTH,
    "motion_noise_m": 1e-6,
    "motion_growth_per_s": 0.0,
    "survival_range_m": 50.0,
    "survival_s": 1e6,
    "report_weight": 2e-9,
    "forget_weight": 1e-9,
    "report_sigma_m": 9.9,
    "prune_weight": 1e-11,
    "gate": 100.0,
}


def equation_6(mixture, readings, noise, clutter=CLUTTER):
    """Components (mean, covariance, weight) after a set of readings, with clutter and birth."""
    after = [(mean, matrix, weight * (1 - DETECTED)) for mean, matrix, weight in mixture]
    for reading in readings:
        updated = []
        for mean, matrix, weight in mixture:
            innovation = matrix + noise
            gain = matrix @ np.linalg.inv(innovation)
            off = reading - mean
            density = math.exp(-0.5 * off @ np.linalg.solve(innovation, off))
            density /= 2 * math.pi * math.sqrt(np.linalg.det(innovation))
            updated.append((mean + gain @ off, matrix - gain @ matrix, DETECTED * weight * density))
        updated.append((reading, noise, BIRTH))
        below = clutter + sum(weight for _, _, weight in updated)
        after += [(mean, matrix, weight / below) for mean, matrix, weight in updated]
    return after


def scattered(seed, scans=3, readings=3, size=0.3):
    random = np.random.default_rng(seed)
    return [np.array([1.0, -0.5]) + random.uniform(0, size, (readings, 2)) for _ in range(scans)]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_without_merging_every_component_is_that_of_equation_6(seed):
    run = Run(Filter(**EVERYTHING, merge_distance=1e-9), UNIFORM)
    expected = []
    for readings in scattered(seed):
        estimate = run.scan(readings, sigma=0.1)
        expected = equation_6(expected, readings, 0.01 * np.eye(2))
    heavy = [component for component in expected if component[2] > 1e-6]
    for mean, matrix, weight in heavy:
        # Components that two readings moved to nearly the same place are one.
        (index,) = np.flatnonzero(np.hypot(*(estimate.positions - mean).T) < 1e-6)
        assert estimate.weights[index] == pytest.approx(weight, rel=0.03)
        assert estimate.covariances[index] == pytest.approx(matrix, abs=1e-9)
    assert len(heavy) >= np.count_nonzero(estimate.weights > 1.1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_merging_keeps_the_mass_of_equation_6(seed):
    # Amid much clutter nothing grows so heavy that it would be cut down to one teammate.
    run = Run(Filter(**EVERYTHING), UNIFORM.model_copy(update={"clutter_per_m2": 2.0}))
    for readings in scattered(seed, scans=2, size=1.0):
        before = run.estimate()
        after = run.scan(readings, sigma=0.1)
    mixture = list(zip(before.positions, before.covariances, before.weights, strict=True))
    expected = equation_6(mixture, readings, 0.01 * np.eye(2), clutter=2.0)
    assert np.sum(after.weights) == pytest.approx(sum(w for *_, w in expected), rel=0.03)
    assert len(after.weights) < len(expected)


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


def test_cameras_tell_within_a_second_that_a_standing_thing_is_a_teammate():
    random, run = np.random.default_rng(1), Run()
    for _ in range(4):
        run.scan([noisy(random, [1.0, 0.5])])
        estimate = run.image(math.atan2(0.5, 1.0) + random.normal(0.0, 0.08))
    assert run.time < 1.2
    assert len(estimate.positions) == 1


def test_cameras_tell_within_a_second_that_a_standing_thing_is_an_obstacle():
    random = np.random.default_rng(1)
    run = Run()
    for k in range(14):
        run.scan([noisy(random, [1.0, 0.2 * k / RATE_HZ])])
    assert len(run.estimate().positions) == 1
    for _ in range(4):
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
    forgiving = Filter(**RANDOM_WALK, forget_weight=0.05)
    strict = Filter(**RANDOM_WALK, forget_weight=0.15)
    for choice, count in ((forgiving, 1), (strict, 0)):
        run = tracking([1.0, 0.0], choice, lidar)
        assert len(run.scan([], clearance=None).positions) == count


def test_a_weight_below_the_report_weight_is_reported_only_if_it_was_before():
    fresh = Run(ONLY_TEAMMATES)
    first = fresh.scan([[1.0, 0.0]])
    assert len(first.positions) == 0
    known = tracking([1.0, 0.0])
    (weight,) = known.scan([], clearance=ring(1.0)).weights
    assert weight < ONLY_TEAMMATES.report_weight


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


@pytest.mark.parametrize("growth", [0.0, 3.0])
def test_the_longer_it_is_unseen_the_faster_it_is_known_less(growth):
    """Its variance grows at the rate q² (1 + growth · time unseen)."""
    choice = {**RANDOM_WALK, "motion_growth_per_s": growth, "report_sigma_m": 5.0}
    run = tracking([1.0, 0.0], Filter(**choice))
    before = run.estimate().covariances[0]
    for _ in range(2000):
        run.wait(0.001)
    expected = before + 0.1**2 * (2.0 + growth * 2.0**2 / 2.0) * np.eye(2)
    assert run.estimate().covariances[0] == pytest.approx(expected, rel=1e-2)


def test_beyond_the_survival_range_it_fades_within_seconds():
    near, far = (
        tracking(
            [1.0, 0.0], Filter(**{**RANDOM_WALK, "motion_noise_m": 0.02}, survival_range_m=reach)
        )
        for reach in (3.0, 0.9)
    )
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
    run = tracking([2.0, 0.0], Filter(**RANDOM_WALK, report_sigma_m=1.0))
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
    for lag in (0.0, 0.5, 5.0):
        run = tracking([2.0, 0.0])
        run.filter.update(heard(run.time, 0.02, 0.01, lag=lag))
        moves.append(run.estimate().positions[0, 1])
    assert moves[0] > moves[1] > moves[2] > 0.0


def test_the_older_a_reading_of_the_lidar_the_less_it_moves_an_estimate():
    moves = []
    for lag in (0.0, 0.5, 5.0):
        run = tracking([2.0, 0.0])
        moves.append(run.scan([[2.0, 0.05]], lags=np.array([lag])).positions[0, 1])
    assert moves[0] > moves[1] > moves[2] > 0.0


def walkers(seed, count=3, seconds=10.0):
    """Events (time, truth (n, 2), readings or None, bearings or None) of walking teammates."""
    random = np.random.default_rng(seed)
    places = np.array([[1.0, 0.3], [-0.8, 0.9], [0.2, -1.4]])[:count]
    headings = random.uniform(-math.pi, math.pi, count)
    for k in range(1, int(seconds * RATE_HZ)):
        headings = headings + random.normal(0.0, 0.3, count)
        # Homesick, so that they stay in sight.
        steps = np.stack((np.cos(headings), np.sin(headings)), axis=1) * 0.15 - 0.05 * places
        places = places + steps / RATE_HZ
        found = places[random.random(count) < 0.9]
        clutter = random.uniform(-2.0, 2.0, (random.poisson(0.2), 2))
        readings = np.concatenate((found + random.normal(0.0, 0.01, found.shape), clutter))
        bearings = np.arctan2(places[:, 1], places[:, 0]) + random.normal(0.0, 0.08, count)
        yield k / RATE_HZ, places, readings, bearings[random.random(count) < 0.8]


def near_estimates(truth, estimate):
    """Distance (n,) from each true position to the nearest estimate."""
    gaps = np.linalg.norm(truth[:, None] - estimate.positions, axis=2)
    return gaps.min(axis=1, initial=math.inf)


@pytest.mark.parametrize("cameras", [True, False], ids=["LC", "LO"])
def test_walking_teammates_are_followed(cameras):
    run, known, wrong, count = Run(), 0, 0, 0
    for time, truth, readings, bearings in walkers(5):
        estimate = run.scan(readings)
        if cameras:
            run.filter.update(heard(run.time, bearings))
            estimate = run.estimate()
        if time > 2.0:
            count += len(truth)
            known += np.count_nonzero(near_estimates(truth, estimate) < 0.3)
            wrong += max(0, len(estimate.positions) - len(truth))
    assert known / count > 0.9
    assert wrong / count < 0.1


def test_it_does_not_matter_which_sensor_of_an_instant_comes_first():
    lidar_first, camera_first = Run(), Run()
    for time, _, readings, bearings in walkers(6):
        messages = [seen(time, readings), heard(time, bearings)]
        for run, order in ((lidar_first, messages), (camera_first, messages[::-1])):
            run.wait()
            for message in order:
                run.filter.update(message)
    one, two = lidar_first.estimate(), camera_first.estimate()
    assert len(one.positions) == len(two.positions) == 3
    assert np.all(near_estimates(one.positions, two) < 0.02)


def test_cameras_follow_a_teammate_that_the_lidar_does_not_see():
    """It walks across behind a pillar of the lidar's own."""
    lidar = Lidar(blind_sectors=(BlindSector(centre_rad=0.0, width_rad=1.0),))
    generous = Filter(**RANDOM_WALK, report_sigma_m=2.0)
    errors = []
    for cameras in (True, False):
        random, run = np.random.default_rng(2), Run(generous, lidar)
        for angle in np.linspace(1.2, -0.2, 70):
            place = 1.5 * np.array([math.cos(angle), math.sin(angle)])
            run.scan([noisy(random, place)] if angle > 0.2 else [])
            if cameras:
                run.filter.update(heard(run.time, angle + random.normal(0.0, 0.08)))
        errors.append(near_estimates(place[None], run.estimate())[0])
    assert errors[0] < 0.3
    assert errors[1] > 0.5


# What holds for every scene.


def drive(filter_, events, turn=0.0, mirrored=False, shuffle=None):
    """Give a filter a scene that is turned by `turn` rad and, before that, mirrored at x."""
    side = -1.0 if mirrored else 1.0
    c, s = math.cos(turn), math.sin(turn)
    axes = np.array([[c, -s], [s, c]]) @ np.diag([1.0, side])
    noise = axes @ np.diag([0.02**2, 0.01**2]) @ axes.T
    before = 0.0
    for time, _, readings, bearings in events:
        order = np.arange(len(readings)) if shuffle is None else shuffle.permutation(len(readings))
        dx, dy = axes @ [0.02, 0.01]
        filter_.predict(Displacement(time, time - before, dx, dy, side * 0.03, 1e-5, 1e-5))
        filter_.update(
            Positions(
                time,
                (readings @ axes.T)[order],
                np.tile(noise, (len(readings), 1, 1)),
                clearance=PLAIN_VIEW,
            )
        )
        turned = np.remainder(side * bearings + turn + math.pi, 2 * math.pi) - math.pi
        filter_.update(heard(time, turned))
        before = time
    return filter_.estimate(), axes


def by_place(positions):
    return np.lexsort(np.round(positions, 6).T)


@given(st.integers(0, 2**32 - 1), st.integers(-180, 180), st.booleans())
@settings(max_examples=15)
def test_a_scene_that_is_turned_or_mirrored_gives_the_estimates_turned_or_mirrored(
    seed, degrees, mirrored
):
    events = list(walkers(seed, seconds=3.0))
    plain, _ = drive(PhdFilter(lidar=Lidar(blind_sectors=())), events)
    turned, axes = drive(
        PhdFilter(lidar=Lidar(blind_sectors=())), events, math.radians(degrees), mirrored
    )
    expected = plain.positions @ axes.T
    one, two = by_place(expected), by_place(turned.positions)
    assert turned.positions[two] == pytest.approx(expected[one], abs=1e-7)
    assert turned.covariances[two] == pytest.approx(
        (axes @ plain.covariances @ axes.T)[one], abs=1e-9
    )
    assert turned.weights[two] == pytest.approx(plain.weights[one], abs=1e-7)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_the_order_of_the_readings_in_a_message_does_not_matter(seed):
    events = list(walkers(seed, seconds=3.0))
    plain, _ = drive(PhdFilter(), events)
    shuffled, _ = drive(PhdFilter(), events, shuffle=np.random.default_rng(seed))
    one, two = by_place(plain.positions), by_place(shuffled.positions)
    assert shuffled.positions[two] == pytest.approx(plain.positions[one], abs=1e-7)
    assert shuffled.weights[two] == pytest.approx(plain.weights[one], abs=1e-7)


def as_bytes(estimate):
    return [
        getattr(estimate, name).tobytes()
        for name in ("positions", "covariances", "weights", "ages", "labels")
    ]


def test_the_same_scene_gives_the_same_bits():
    first, second = (drive(PhdFilter(), walkers(3))[0] for _ in range(2))
    assert len(first.positions) == 3
    assert as_bytes(first) == as_bytes(second)


def test_a_deep_copy_goes_its_own_way_and_ends_in_the_same_bits():
    events = list(walkers(4))
    original = PhdFilter()
    drive(original, events[:40])
    before = original.estimate()
    bits = as_bytes(before)
    duplicate = copy.deepcopy(original)
    one, _ = drive(duplicate, events[40:])
    assert as_bytes(original.estimate()) == bits
    two, _ = drive(original, events[40:])
    assert as_bytes(one) == as_bytes(two)
    # An estimate that was handed out does not change afterwards.
    assert as_bytes(before) == bits


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


def test_readings_from_very_far_or_on_the_robot_itself_do_no_harm():
    run = tracking([1.0, 0.0])
    odd = [[1e6, -1e6], [1e4, 0.0], [0.0, 0.0], [1e-9, 0.0], [1.0, 0.0], [1.0, 0.0]]
    for _ in range(3):
        estimate = run.scan(odd)
        run.filter.update(heard(run.time, [0.0, math.pi, -math.pi]))
    close = np.hypot(*(estimate.positions - [1.0, 0.0]).T) < 0.05
    assert np.any(close)
    assert np.all(np.isfinite(estimate.positions))
    run.wait(5.0)
    assert np.all(np.hypot(*run.scan([]).positions.T) < 1e3)


def test_the_capacity_holds_the_heaviest():
    run = Run(Filter(**RANDOM_WALK, capacity=10))
    random = np.random.default_rng(0)
    teammates = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    for _ in range(10):
        estimate = run.scan(np.concatenate((teammates, random.uniform(-2, 2, (30, 2)))))
    assert np.all(near_estimates(teammates, estimate) < 0.1)
    assert len(estimate.positions) <= 10


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_whatever_comes_the_estimates_are_sound(seed):
    random = np.random.default_rng(seed)
    filter_, time = PhdFilter(), 0.0
    for _ in range(60):
        interval = random.choice([0.0, 0.01, 0.1, 2.0])
        time += interval
        filter_.predict(Displacement(time, interval, *random.normal(0.0, 0.1, 3), 1e-4, 1e-3))
        if random.random() < 0.5:
            points = random.uniform(-2, 2, (random.integers(0, 6), 2)).repeat(2, axis=0)
            clearance = random.choice([0.0, 0.5, 1.0, math.inf], 360)
            lags = random.uniform(0.0, 0.3, len(points))
            sigma = random.choice([1e-4, 0.01, 0.5])
            known = random.random() < 0.5
            filter_.update(seen(time, points, sigma, clearance if known else None, lags))
        else:
            bearings = random.uniform(-math.pi, math.pi, random.integers(0, 5))
            filter_.update(heard(time, bearings, lag=random.uniform(0.0, 0.3)))
        estimate = filter_.estimate()
        assert estimate.time == time
        assert np.all(np.isfinite(estimate.positions))
        assert np.all(np.linalg.eigvalsh(estimate.covariances) > 0.0)
        assert np.all((estimate.weights > 0.0) & (estimate.weights <= MOST))
        assert np.all(estimate.ages >= 0.0)
        assert len(set(estimate.labels.tolist())) == len(estimate.labels)


def test_a_moving_robot_keeps_a_standing_teammate_where_it_is():
    """The robot drives a circle; nothing is seen any more, the estimate follows by odometry."""
    run = tracking([1.0, 0.5], Filter(**{**RANDOM_WALK, "motion_noise_m": 0.01}))
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
