"""Remembered obstacles: carried as noisy odometry has it, found again, and given up when gone."""

import math

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from host.estimator.gaussians.gaussian_mixture import PXX, PXY, PYY, ROWS, WEIGHT, X, Y
from host.estimator.things.static_world import StaticWorld
from host.geometry import to_frame, to_parent
from host.messages import Displacement, Positions

NOISE_M2 = 1e-4


def obstacles(*places: tuple[float, float], variance: float = NOISE_M2) -> np.ndarray:
    rows = np.zeros((ROWS, len(places)))
    rows[: Y + 1] = np.array(places).reshape(-1, 2).T
    rows[PXX] = rows[PYY] = variance
    rows[WEIGHT] = 0.9
    return rows


def world_of(*places: tuple[float, float], variance: float = NOISE_M2) -> StaticWorld:
    world = StaticWorld(gate=16.0)
    for known in (0, len(places)):
        things = obstacles(*places, variance=variance)
        world.learn(things, np.ones(len(places)), np.zeros(known), 1.0)
    return world


def forward(metres: float = 0.0, radians: float = 0.0, noise: float = 0.0) -> Displacement:
    return Displacement(0.0, 0.1, metres, 0.0, radians, noise * 4e-5, noise * 1e-4)


def readings(places: np.ndarray) -> tuple[Positions, np.ndarray]:
    noise = np.tile(NOISE_M2 * np.eye(2), (len(places), 1, 1))
    return Positions(0.0, np.asarray(places, dtype=float), noise), noise


def test_where_they_are_and_how_surely_is_what_noisy_odometry_leaves_of_it() -> None:
    random = np.random.default_rng(3)
    places = random.uniform(-2, 2, (600, 2))
    squares = []
    for place in places:
        world, pose = world_of(tuple(place)), np.zeros(3)
        seen = place + math.sqrt(NOISE_M2) * random.standard_normal(2)
        world.rows[: Y + 1, 0] = seen
        for _ in range(60):
            step = forward(0.03, 0.05, noise=0.2)
            world.predict(step)
            # The true motion: what the odometry reads, and its noise.
            true = np.array([step.dx, step.dy, step.dpsi]) + random.standard_normal(3) * np.sqrt(
                [step.translation_variance, step.translation_variance, step.heading_variance]
            )
            pose[:2] = to_parent(true[None, :2], pose)[0]
            pose[2] += true[2]
        (mean,), (covariance,) = world.believed()
        error = to_frame(place[None], pose)[0] - mean
        squares.append(error @ np.linalg.solve(covariance, error))
    low, high = chi2.ppf([0.0005, 0.9995], 2 * len(squares))
    assert low < np.sum(squares) < high


def test_expected_readings_are_the_sum_of_their_gaussians() -> None:
    random = np.random.default_rng(1)
    places = random.uniform(-1, 1, (9, 2))
    world = world_of(*map(tuple, places), variance=0.02)
    world.rows[PXY] = 0.008
    assert np.all(world.intensity(*readings(places), np.ones(9)) == 0.0)  # Bernoullis stand for all
    world.learn(obstacles(), np.zeros(0), np.zeros(9), 1.0)
    detected = random.uniform(0.2, 0.9, 9)
    measured, noise = readings(places[:5] + random.uniform(-0.1, 0.1, (5, 2)))
    spread = np.array([[0.02, 0.008], [0.008, 0.02]]) + NOISE_M2 * np.eye(2)
    there = (places, detected)
    expected = [
        sum(p * multivariate_normal.pdf(z, m, spread) for m, p in zip(*there, strict=True))
        for z in measured.positions
    ]
    found = world.intensity(measured, noise, detected)
    assert found == pytest.approx(np.array([expected, 0.0 * np.array(expected)]), rel=1e-3)
    nothing, no_noise = readings(np.zeros((0, 2)))
    assert world.intensity(nothing, no_noise, detected).shape == (2, 0)
    assert np.all(StaticWorld(16.0).intensity(measured, noise, np.zeros(0)) == 0.0)


def test_what_is_seen_again_is_not_remembered_twice() -> None:
    legs = [(1.0, 0.2), (1.0, -0.2), (1.4, 0.2), (1.4, -0.2)]
    world = world_of(*legs)
    for _ in range(300):
        world.predict(forward(0.0, 0.0, noise=0.3))
    drifted = np.array(legs) + np.array([0.05, 0.04])
    seen = obstacles(*map(tuple, drifted[:3]))
    world.learn(seen, np.ones(3), np.full(4, 0.01), 1.0)
    places, covariances = world.believed()
    assert len(places) == 4
    apart = np.linalg.norm(places[:, None] - np.vstack((drifted[:3], legs[3])), axis=2)
    assert sorted(np.argmin(apart, axis=1)) == [0, 1, 2, 3]
    assert apart.min(axis=0) == pytest.approx(0.0)
    assert np.sum(covariances[:, 0, 0] < 2 * NOISE_M2) == 3


def test_one_that_is_not_where_it_must_be_seen_is_given_up_and_a_hidden_one_is_not() -> None:
    world = world_of((1.0, 0.0), (0.0, 1.0))
    for _ in range(10):
        world.learn(np.zeros((ROWS, 0)), np.zeros(0), np.array([0.9, 0.3]), 1 / 7)
        world.predict(forward())
        if world.rows.shape[1] == 1:
            break
    else:
        pytest.fail("what is gone is remembered")
    (place,), _ = world.believed()
    assert place == pytest.approx([0.0, 1.0])


def test_out_of_view_they_are_believed_in_for_some_minutes() -> None:
    world = world_of((1.0, 0.0))
    for _ in range(1200):
        world.predict(forward())
    assert len(world.believed()[0]) == 1
    for _ in range(2400):
        world.predict(forward())
    assert len(world.believed()[0]) == 0
    for _ in range(3000):
        world.predict(forward())
    assert world.rows.shape == (ROWS, 0)


def test_what_the_odometry_has_lost_is_forgotten() -> None:
    world = world_of((1.0, 0.0))
    for _ in range(200):
        world.predict(forward(0.0, 0.0, noise=40.0))
    assert world.rows.shape == (ROWS, 0)


def test_a_frame_that_turns_takes_them_along() -> None:
    world = world_of((1.0, 0.0))
    world.predict(forward(0.5, math.pi / 2))
    (place,), _ = world.believed()
    assert place == pytest.approx([0.0, -0.5])
    assert world.rows[[X, Y], 0] == pytest.approx(place)


def test_what_is_known_of_a_thing_is_remembered_with_its_doubts() -> None:
    world = StaticWorld(gate=16.0)
    things = obstacles((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0))
    for k in range(9):
        assert len(world.believed()[0]) == 0
        world.learn(things, np.array([0.97, 0.85, 0.4]), np.zeros(2 if k else 0), 1 / 8)
    places, _ = world.believed()
    assert places == pytest.approx(np.array([[1.0, 0.0], [0.0, 1.0]]))
    world.learn(obstacles(), np.zeros(0), np.zeros(2), 1 / 7)
    obstacle, standing = world.intensity(*readings(places), np.ones(2))
    assert standing / (obstacle + standing) == pytest.approx([0.03, 0.15])
    # One that turns out to be a teammate has a Bernoulli, and is no obstacle any more.
    world.learn(obstacles((1.0, 0.0)), np.array([0.1]), np.zeros(2), 1 / 7)
    assert world.believed()[0] == pytest.approx(np.array([[0.0, 1.0]]))


def test_what_stood_for_a_moment_only_is_no_obstacle_and_forgotten_at_once() -> None:
    world = StaticWorld(gate=16.0)
    for k in range(4):
        world.learn(obstacles((1.0, 0.0)), np.ones(1), np.zeros(min(k, 1)), 1 / 7)
    assert len(world.believed()[0]) == 0
    world.learn(obstacles(), np.zeros(0), np.zeros(1), 1 / 7)
    assert world.rows.shape == (ROWS, 0)
