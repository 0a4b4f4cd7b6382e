"""Whole scenes: what the filter makes of them, and what holds for every one."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import FilterSettings, Lidar, PmbSettings
from host.estimator.gaussians.moving_gaussians import PXX, PXY, PYY, X, Y
from host.estimator.phd import PhdFilter
from host.estimator.things.thing_modes import MODES, MOTION_OF
from host.messages import Displacement, Positions
from tests.estimator.standing_robot import MOST, PLAIN_VIEW, RATE_HZ, Run, heard, seen

# Proposition 2 of Vo & Ma 2006, recomputed in scalars.

CLUTTER, DETECTED = 0.1, 0.8
FLOOR_M, CORRELATED_S, LEAST = 0.001, 0.3, 3e-3  # docs/filters.md, `pmb`
SENSOR = Lidar(
    detection_probability=DETECTED,
    half_range_m=999.0,
    min_range_m=0.0,
    target_diameter_m=0.011,
    clutter_per_m2=CLUTTER,
    blind_sectors=(),
)


def normal(off, covariance):
    """N(off; 0, covariance) of two dimensions."""
    square = off @ np.linalg.solve(covariance, off)
    return math.exp(-0.5 * square) / (2 * math.pi * math.sqrt(np.linalg.det(covariance)))


def gaussian(rows, motion, thing):
    """Mean and covariance of the position of a thing in one of its motions."""
    x, y, pxx, pxy, pyy = rows[[X, Y, PXX, PXY, PYY], motion, thing]
    return np.array([x, y]), np.array([[pxx, pxy], [pxy, pyy]])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_the_weights_after_a_scan_are_those_of_proposition_2(seed):
    """Three things in each other's way, one of them missed; each mode has its weight."""
    random = np.random.default_rng(seed)
    places = np.array([1.0, -0.5]) + np.array([[0.0, 0.0], [0.1, 0.1], [0.0, 0.3]])
    run = Run(FilterSettings(gate=100.0, survival_range_m=50.0), SENSOR)
    run.filter._things.merge_duplicates = lambda: None
    for _ in range(2):
        run.scan(places, sigma=0.05)
    run.wait()
    things = run.filter._things
    rows, before, n = things.rows.copy(), things.weights.copy(), len(things)
    readings = places[:2] + random.normal(0.0, 0.05, (2, 2))
    run.filter.update(seen(run.time, readings, sigma=0.05))
    noise = (0.05**2 + FLOOR_M**2) * np.eye(2)

    birth = PmbSettings().appear_per_m2_s / RATE_HZ
    missing = (1.0 - DETECTED) ** (1.0 - math.exp(-1.0 / RATE_HZ / CORRELATED_S))
    q = np.zeros((MODES, n, len(readings)))
    for mode, thing in np.ndindex(MODES, n):
        mean, covariance = gaussian(rows, MOTION_OF[mode], thing)
        for z, reading in enumerate(readings):
            q[mode, thing, z] = DETECTED * normal(reading - mean, covariance + noise)
    shared = before[:, :, None] * q
    shared /= CLUTTER + birth + shared.sum(axis=(0, 1))
    taken = shared.sum(axis=(0, 2))
    # A thing gives one reading a scan: no more is its own, and what was seen was not missed.
    shared /= np.maximum(taken, 1.0)[:, None]
    expected = shared.sum(axis=2) + before * missing * np.maximum(1.0 - taken, 0.0)
    expected = expected[:, expected.sum(axis=0) > LEAST]
    found = run.filter._things.weights[:, : expected.shape[1]]  # those born come last
    assert found == pytest.approx(expected, rel=1e-9)


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
