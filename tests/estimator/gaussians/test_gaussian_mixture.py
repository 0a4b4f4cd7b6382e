import math
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.updater.kalman import KalmanUpdater

from host.estimator.gaussians.gaussian_mixture import (
    PXX,
    PXY,
    PYY,
    ROWS,
    WEIGHT,
    X,
    Y,
    gated_pairs,
    match_moments,
    predict_mixture,
    update_by_bearings,
    update_by_positions,
)
from host.messages import Displacement

coordinate = st.floats(-5.0, 5.0)
sigma = st.floats(0.01, 1.0)
angle = st.floats(-math.pi, math.pi)
seeds = st.integers(0, 2**32 - 1)


def spd(long, short, turn):
    c, s = math.cos(turn), math.sin(turn)
    axes = np.array([[c, -s], [s, c]])
    return axes @ np.diag([long**2, short**2]) @ axes.T


points = st.tuples(coordinate, coordinate).map(np.array)
covariances = st.builds(spd, sigma, sigma, angle)
gaussians = st.tuples(points, covariances)


def columns(means, matrices, weights=None):
    """Rows of a mixture from means (n, 2), covariances (n, 2, 2), weights (n,)."""
    means, matrices = np.asarray(means, dtype=float), np.asarray(matrices, dtype=float)
    rows = np.zeros((ROWS, len(means)))
    rows[X], rows[Y] = means.T
    rows[PXX], rows[PXY], rows[PYY] = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    rows[WEIGHT] = 0.5 if weights is None else weights
    return rows


def means_of(rows):
    return np.stack((rows[X], rows[Y]), axis=-1)


def matrices_of(rows):
    return np.stack((rows[PXX], rows[PXY], rows[PXY], rows[PYY]), axis=-1).reshape(-1, 2, 2)


def random_mixture(random, n, spread=3.0, largest=0.3):
    axes = random.uniform(0.01, largest, (n, 2))
    turns = random.uniform(-math.pi, math.pi, n)
    matrices = [spd(a, b, t) for (a, b), t in zip(axes, turns, strict=True)]
    return columns(
        random.uniform(-spread, spread, (n, 2)),
        np.reshape(matrices, (-1, 2, 2)),
        random.uniform(0.01, 1.0, n),
    )


def joseph(mean, matrix, jacobian, noise, innovation):
    """The Kalman update by inverse and Joseph's form, and the innovation's density."""
    innovation_covariance = jacobian @ matrix @ jacobian.T + noise
    gain = matrix @ jacobian.T @ np.linalg.inv(innovation_covariance)
    rest = np.eye(2) - gain @ jacobian
    square = innovation @ np.linalg.solve(innovation_covariance, innovation)
    size = np.linalg.det(2 * math.pi * innovation_covariance)
    return (
        mean + gain @ innovation,
        rest @ matrix @ rest.T + gain @ noise @ gain.T,
        math.exp(-square / 2) / math.sqrt(size),
    )


@given(gaussians, gaussians)
def test_a_position_update_equals_josephs_form(prior, reading):
    (mean, matrix), (position, noise) = prior, reading
    updated, likelihood = update_by_positions(
        columns([mean], [matrix], [0.3]), position[:, None], columns([mean], [noise])[PXX:WEIGHT]
    )
    expected = joseph(mean, matrix, np.eye(2), noise, position - mean)
    assert means_of(updated)[0] == pytest.approx(expected[0], rel=1e-6, abs=1e-8)
    assert matrices_of(updated)[0] == pytest.approx(expected[1], rel=1e-6, abs=1e-9)
    assert likelihood[0] == pytest.approx(expected[2], rel=1e-6, abs=1e-300)
    assert updated[WEIGHT, 0] == 0.3


@given(gaussians, gaussians)
def test_a_position_update_equals_stone_soups(prior, reading):
    (mean, matrix), (position, noise) = prior, reading
    now = datetime(2020, 1, 1)
    model = LinearGaussian(2, (0, 1), noise)
    predicted = GaussianStatePrediction(mean[:, None], matrix, timestamp=now)
    detection = Detection(position[:, None], timestamp=now, measurement_model=model)
    theirs = KalmanUpdater(model).update(SingleHypothesis(predicted, detection))
    updated, _ = update_by_positions(
        columns([mean], [matrix]), position[:, None], columns([mean], [noise])[PXX:WEIGHT]
    )
    assert means_of(updated)[0] == pytest.approx(np.ravel(theirs.mean), rel=1e-6, abs=1e-8)
    assert matrices_of(updated)[0] == pytest.approx(np.asarray(theirs.covar), rel=1e-6, abs=1e-8)


def test_an_update_keeps_what_an_exact_reading_of_a_vague_component_says():
    """No digit is lost where P is 1e14 times R."""
    prior = columns([[1.0, 2.0]], [1e6 * np.eye(2)])
    noise = np.array([[1e-8], [0.0], [1e-8]])
    updated, _ = update_by_positions(prior, np.array([[3.0], [4.0]]), noise)
    assert means_of(updated)[0] == pytest.approx([3.0, 4.0], abs=1e-12)
    assert matrices_of(updated)[0] == pytest.approx(1e-8 * np.eye(2), rel=1e-12)


@given(seeds)
def test_updates_of_stacked_mixtures_are_the_updates_of_each(seed):
    random = np.random.default_rng(seed)
    one, two = random_mixture(random, 5), random_mixture(random, 5)
    positions = random.uniform(-3, 3, (2, 5))
    noise = random_mixture(random, 5)[PXX:WEIGHT]
    stacked, likelihood = update_by_positions(
        np.stack((one, two), axis=1), positions[:, None], noise[:, None]
    )
    for k, rows in enumerate((one, two)):
        alone, alone_likelihood = update_by_positions(rows, positions, noise)
        assert stacked[:, k] == pytest.approx(alone, rel=1e-12)
        assert likelihood[k] == pytest.approx(alone_likelihood, rel=1e-12)


@given(
    gaussians.filter(lambda g: np.hypot(*(g[0] - [0.2, -0.1])) > 0.1),
    st.floats(-1.0, 1.0),
    st.floats(0.01, 0.5),
)
def test_a_bearing_update_equals_josephs_form_with_a_numerical_jacobian(prior, off, noise):
    (mean, matrix), origin = prior, np.array([0.2, -0.1])

    def direction(point):
        return math.atan2(*(point - origin)[::-1])

    bearing = direction(mean) + off
    updated, likelihood = update_by_bearings(
        columns([mean], [matrix], [0.3]), np.array([bearing + 2 * math.pi]), noise**2, origin
    )
    distance = np.hypot(*(mean - origin))
    step = 1e-5 * distance
    jacobian = np.array(
        [
            [
                math.remainder(direction(mean + e) - direction(mean - e), 2 * math.pi) / (2 * step)
                for e in step * np.eye(2)
            ]
        ]
    )
    expected = joseph(mean, matrix, jacobian, np.array([[noise**2]]), np.array([off]))
    assert means_of(updated)[0] == pytest.approx(expected[0], rel=1e-4, abs=1e-6)
    assert matrices_of(updated)[0] == pytest.approx(expected[1], rel=1e-3, abs=1e-6)
    assert likelihood[0] == pytest.approx(expected[2], rel=1e-3, abs=1e-12)
    assert updated[WEIGHT, 0] == 0.3


def motion(dx, dy, dpsi, translation=0.0, heading=0.0):
    return Displacement(1.0, 1.0, dx, dy, dpsi, translation, heading)


@given(gaussians, points, angle, sigma, sigma, sigma)
def test_carry_equals_the_matrix_form(component, step, dpsi, translation, heading, noise):
    mean, matrix = component
    rows = columns([mean], [matrix], [0.4])
    predict_mixture(rows, motion(*step, dpsi, translation**2, heading**2), noise**2)
    turn = np.array([[math.cos(dpsi), math.sin(dpsi)], [-math.sin(dpsi), math.cos(dpsi)]])
    place = turn @ (mean - step)
    across = np.array([-place[1], place[0]])
    expected = turn @ (matrix + (translation**2 + noise**2) * np.eye(2)) @ turn.T
    expected += heading**2 * np.outer(across, across)
    assert means_of(rows)[0] == pytest.approx(place, rel=1e-9, abs=1e-12)
    assert matrices_of(rows)[0] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert rows[WEIGHT, 0] == 0.4


@given(seeds, points, angle)
def test_carry_there_and_back_changes_nothing(seed, step, dpsi):
    rows = random_mixture(np.random.default_rng(seed), 7)
    before = rows.copy()
    predict_mixture(rows, motion(*step, dpsi), 0.0)
    back = -np.array(
        [
            math.cos(dpsi) * step[0] + math.sin(dpsi) * step[1],
            math.cos(dpsi) * step[1] - math.sin(dpsi) * step[0],
        ]
    )
    predict_mixture(rows, motion(*back, -dpsi), 0.0)
    assert rows == pytest.approx(before, abs=1e-12)


@given(seeds, points, angle)
def test_carry_keeps_the_distances_and_shapes(seed, step, dpsi):
    rows = random_mixture(np.random.default_rng(seed), 4)
    before = rows.copy()
    predict_mixture(rows, motion(*step, dpsi), 0.0)

    def distances(mixture):
        means = means_of(mixture)
        return np.linalg.norm(means[:, None] - means, axis=2)

    assert distances(rows) == pytest.approx(distances(before), abs=1e-12)
    assert np.linalg.eigvalsh(matrices_of(rows)) == pytest.approx(
        np.linalg.eigvalsh(matrices_of(before)), rel=1e-9, abs=1e-12
    )


def test_a_robot_that_turns_left_sees_what_was_ahead_to_its_right():
    rows = columns([[1.0, 0.0]], [np.diag([0.04, 0.01])])
    predict_mixture(rows, motion(0.0, 0.0, math.pi / 2, heading=0.01), 0.0)
    assert means_of(rows)[0] == pytest.approx([0.0, -1.0])
    # The long axis is along the ray; the heading's error blurs across it.
    assert matrices_of(rows)[0] == pytest.approx(np.diag([0.01 + 0.01, 0.04]))


def test_noise_may_differ_between_stacked_mixtures():
    rows = np.stack([columns([[1.0, 0.0]], [np.eye(2)])] * 2, axis=1)
    predict_mixture(rows, motion(0.0, 0.0, 0.0), np.array([[0.5], [0.0]]))
    assert rows[PXX].ravel().tolist() == [1.5, 1.0]


def pair_set(rows, positions, noises, gate):
    component, reading = gated_pairs(rows, positions, noises, gate)
    assert len(component) == len(set(zip(component.tolist(), reading.tolist(), strict=True)))
    return set(zip(component.tolist(), reading.tolist(), strict=True))


def within_gate(rows, positions, noises, gate):
    """Every pair whose squared Mahalanobis distance is under the gate, one by one."""
    found = set()
    for i, (mean, matrix) in enumerate(zip(means_of(rows), matrices_of(rows), strict=True)):
        for j, position in enumerate(positions):
            off = position - mean
            if off @ np.linalg.inv(matrix + noises[j]) @ off < gate:
                found.add((i, j))
    return found


@given(seeds, st.integers(0, 20), st.integers(0, 20), st.floats(1.0, 30.0))
def test_no_pair_within_the_gate_is_left_out(seed, n, m, gate):
    random = np.random.default_rng(seed)
    rows = random_mixture(random, n)
    noises = matrices_of(random_mixture(random, m))
    positions = random.uniform(-3, 3, (m, 2))
    assert within_gate(rows, positions, noises, gate) <= pair_set(rows, positions, noises, gate)


@given(seeds)
def test_a_large_mixture_is_paired_as_a_small_one_is(seed):
    """Far from the scene, others are added: too many for a table of all distances."""
    random = np.random.default_rng(seed)
    rows = random_mixture(random, 10, spread=2.0, largest=0.2)
    # On a grid of 1.5 m no component reaches more than eight of them.
    places = np.stack(np.meshgrid([-1.5, 0.0, 1.5], [-1.5, 0.0, 1.5]), axis=-1).reshape(-1, 2)
    positions = places + random.uniform(-0.1, 0.1, places.shape)
    noises = np.tile(0.01 * np.eye(2), (len(places), 1, 1))
    small = pair_set(rows, positions, noises, 16.0)
    far = random.uniform(1000.0, 2000.0, (150, 2))
    crowd = columns(far, np.tile(0.01 * np.eye(2), (150, 1, 1)))
    large = pair_set(
        np.concatenate((rows, crowd), axis=1),
        np.concatenate((positions, -far)),
        np.tile(0.01 * np.eye(2), (len(places) + 150, 1, 1)),
        16.0,
    )
    assert large == small
    assert within_gate(rows, positions, noises, 16.0) <= small


def direct_moments(rows):
    """Weight, mean and covariance of a whole mixture, by their definitions."""
    weights, means = rows[WEIGHT], means_of(rows)
    mean = np.average(means, axis=0, weights=weights)
    second = np.average(
        matrices_of(rows) + means[:, :, None] * means[:, None, :], axis=0, weights=weights
    )
    return weights.sum(), mean, second - np.outer(mean, mean)


@given(seeds, st.integers(1, 5), st.integers(0, 12))
def test_merged_components_have_the_moments_of_those_that_went_into_them(seed, groups, extra):
    random = np.random.default_rng(seed)
    into = np.concatenate((np.arange(groups), random.integers(0, groups, extra)))
    random.shuffle(into)
    rows = random_mixture(random, len(into))
    centres = random.uniform(-3, 3, (2, groups))
    merged = match_moments(rows, into, centres)
    for k in range(groups):
        weight, mean, matrix = direct_moments(rows[:, into == k])
        assert merged[WEIGHT, k] == pytest.approx(weight)
        assert means_of(merged)[k] == pytest.approx(mean, abs=1e-9)
        assert matrices_of(merged)[k] == pytest.approx(matrix, abs=1e-9)


def test_merging_far_away_keeps_a_small_covariance():
    place = np.array([1e4, -1e4])
    means = place + np.array([[1e-3, 0.0], [-1e-3, 0.0]])
    rows = columns(means, np.tile(1e-8 * np.eye(2), (2, 1, 1)))
    merged = match_moments(rows, np.zeros(2, dtype=np.int64), place[:, None])
    assert matrices_of(merged)[0] == pytest.approx(np.diag([1e-6 + 1e-8, 1e-8]), rel=1e-6)


@given(seeds)
def test_stacked_mixtures_are_merged_each_by_itself(seed):
    random = np.random.default_rng(seed)
    one, two = random_mixture(random, 6), random_mixture(random, 6)
    into, centres = np.array([0, 1, 0, 1, 1, 0]), random.uniform(-1, 1, (2, 2))
    stacked = match_moments(
        np.stack((one, two), axis=1), into, np.stack((centres, centres), axis=1)
    )
    assert stacked[:, 0] == pytest.approx(match_moments(one, into, centres))
    assert stacked[:, 1] == pytest.approx(match_moments(two, into, centres))
