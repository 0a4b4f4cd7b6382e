"""Whole scenes: what the filter makes of them, and what holds for every one."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import FilterSettings, Lidar
from host.estimator.phd import PhdFilter
from host.messages import Displacement, Positions
from tests.estimator.standing_robot import MOST, PLAIN_VIEW, RATE_HZ, Run, heard, seen

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
    """Components (mean, covariance, weight) after a set of readings, with clutter and birth.

    A component gives at most one reading: what was seen of it was not missed as well.
    """
    seen = [0.0] * len(mixture)
    after = []
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
        seen = [s + updated[k][2] / below for k, s in enumerate(seen)]
        after += [(mean, matrix, weight / below) for mean, matrix, weight in updated]
    for (mean, matrix, weight), share in zip(mixture, seen, strict=True):
        after.append((mean, matrix, weight * (1 - DETECTED) * max(1 - share, 0.0)))
    return after


def scattered(seed, scans=3, readings=3, size=0.3):
    random = np.random.default_rng(seed)
    return [np.array([1.0, -0.5]) + random.uniform(0, size, (readings, 2)) for _ in range(scans)]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_without_merging_every_component_is_that_of_equation_6(seed):
    run = Run(FilterSettings(**EVERYTHING, merge_distance=1e-9), UNIFORM)
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
    run = Run(FilterSettings(**EVERYTHING), UNIFORM.model_copy(update={"clutter_per_m2": 2.0}))
    for readings in scattered(seed, scans=2, size=1.0):
        before = run.estimate()
        after = run.scan(readings, sigma=0.1)
    mixture = list(zip(before.positions, before.covariances, before.weights, strict=True))
    expected = equation_6(mixture, readings, 0.01 * np.eye(2), clutter=2.0)
    assert np.sum(after.weights) == pytest.approx(sum(w for *_, w in expected), rel=0.03)
    assert len(after.weights) < len(expected)


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
