"""The chain of modes against matrix exponentials, integrals and sampled motion."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec
from scipy.linalg import expm

from host.config import PmbSettings
from host.estimator.gaussians.moving_gaussians import COVARIANCE, ENTRY, MEAN, PVXVX, VELOCITY
from host.estimator.things.thing_modes import (
    _NOISE,
    _RATES,
    _TIMES,
    MODES,
    MOTION_OF,
    MOTIONS,
    STILL,
    ThingModes,
    by_motion,
    mixtures,
    moments,
)
from host.messages import Displacement, FloatArray

SPEED = 0.2
DRIVES, CRUISES = 1, 2  # motions
SEEDS = st.integers(0, 2**32 - 1)
INTERVALS = st.floats(1e-3, 2.0)


def modes() -> ThingModes:
    return ThingModes(PmbSettings(speed_mps=SPEED))


Thing = tuple[FloatArray, FloatArray]


def thing(weights: list[float]) -> Thing:
    """One thing at (1, 2) m, certain to 1 cm, with these weights of its modes: rows, weights."""
    one = np.ones(1)
    rows, _ = modes().born(np.array([[1.0, 2.0]]), 1e-4 * np.eye(2)[None], 0.0, one, one)
    return rows, np.array(weights)[:, None]


def moved(thing: Thing, dt: float, **motion: float) -> Thing:
    step = {"dx": 0.0, "dy": 0.0, "dpsi": 0.0, **motion}
    return modes().predict(*thing, Displacement(dt, dt, **step))


@given(INTERVALS, st.integers(0, MODES - 1))
def test_modes_change_as_the_chain_does(dt: float, start: int) -> None:
    weights = [float(mode == start) for mode in range(MODES)]
    after = moved(thing(weights), dt)[1][:, 0]
    generator = _RATES - np.diag(_RATES.sum(axis=1))
    assert after == pytest.approx(expm(generator * dt)[start], abs=1e-9)


@pytest.mark.parametrize("mode", [1, 2])
@pytest.mark.parametrize("dt", [0.02, 0.14, 1.5])
def test_motion_is_that_of_the_stochastic_integral(mode: int, dt: float) -> None:
    """F = exp(A dt), Q = integral of exp(A s) B q B^T exp(A s)^T ds, worked out numerically."""
    drift = np.zeros((4, 4))
    drift[(0, 1), (2, 3)], drift[(2, 3), (2, 3)] = 1.0, -1.0 / _TIMES[mode]
    transitions, noise = modes()._steps(dt)
    assert transitions[mode] == pytest.approx(expm(drift * dt))

    def rate(s: float) -> FloatArray:
        spread = expm(drift * s)[:, 2:]
        return np.asarray(_NOISE[mode] * spread @ spread.T)

    expected = quad_vec(rate, 0.0, dt)[0]
    assert noise[:, mode][ENTRY] == pytest.approx(expected, rel=1e-6, abs=1e-13)


def test_what_stands_or_is_an_obstacle_does_not_move() -> None:
    after, _ = moved(thing([0.5, 0.0, 0.0, 0.0, 0.0]), 2.0)
    assert after[COVARIANCE, STILL, 0][:3] == pytest.approx([1e-4, 0.0, 1e-4], rel=1e-3)
    assert not after[VELOCITY, STILL].any()


def test_what_starts_to_move_may_have_any_velocity() -> None:
    after, _ = moved(thing([0.0, 0.0, 1.0, 0.0, 0.0]), 0.01)
    assert after[MEAN, DRIVES, 0] == pytest.approx([1.0, 2.0, 0.0, 0.0])
    velocity = after[COVARIANCE, DRIVES, 0][[7, 8, 9]]
    assert velocity == pytest.approx([SPEED**2, 0.0, SPEED**2], rel=0.05)


@given(st.lists(st.floats(0.01, 0.2), min_size=MODES, max_size=MODES), INTERVALS, SEEDS)
def test_each_motion_is_mixed_of_what_may_have_changed_into_it(
    weights: list[float], dt: float, seed: int
) -> None:
    """By a loop over pairs of modes.

    What comes from standing still has any velocity; what ends to cruise changes it at once.
    """
    rows, shares = thing(weights)
    rows[MEAN, :, 0] += np.random.default_rng(seed).normal(0.0, 0.1, (4, MOTIONS))
    rows[VELOCITY, STILL] = 0.0
    chances = expm((_RATES - np.diag(_RATES.sum(axis=1))) * dt)
    mixed, _ = modes()._mixed(rows.copy(), shares, dt)
    for motion in range(MOTIONS):
        flows = {
            (a, b): weights[a] * chances[a, b]
            for a in range(MODES)
            for b in range(MODES)
            if MOTION_OF[b] == motion
        }
        mean = sum(f * rows[MEAN, MOTION_OF[a], 0] for (a, _), f in flows.items())
        mean = mean / sum(flows.values())
        fast = sum(f * SPEED**2 for (a, _), f in flows.items() if MOTION_OF[a] == STILL)
        for (a, _), f in flows.items():
            source = rows[MEAN, MOTION_OF[a], 0]
            fast += f * (source[2] - mean[2]) ** 2
            if MOTION_OF[a] != STILL:
                fast += f * rows[PVXVX, MOTION_OF[a], 0]
            if (MOTION_OF[a], motion) == (CRUISES, DRIVES):
                fast += f * SPEED**2
        moves = motion != STILL
        assert mixed[MEAN, motion, 0] == pytest.approx(mean * (1, 1, moves, moves), abs=1e-9)
        expected = moves * fast / sum(flows.values())
        assert mixed[PVXVX, motion, 0] == pytest.approx(expected, abs=1e-9)


def test_the_robots_own_motion_moves_everything_the_other_way() -> None:
    rows, weights = thing([1.0, 0.0, 0.0, 0.0, 1e-6])
    rows[VELOCITY, CRUISES, 0] = 0.1, 0.0
    after, _ = moved((rows, weights), 1e-6, dx=0.5, dy=0.0, dpsi=0.5 * math.pi)
    assert after[MEAN, STILL, 0] == pytest.approx([2.0, -0.5, 0.0, 0.0], abs=1e-6)
    assert after[MEAN, CRUISES, 0] == pytest.approx([2.0, -0.5, 0.0, -0.1], abs=1e-4)


def test_a_heading_error_spreads_across_the_ray_and_turns_velocities() -> None:
    rows, weights = thing([0.0, 0.0, 0.0, 1e-9, 1.0])
    rows[VELOCITY, CRUISES, 0] = 0.1, 0.0
    step = Displacement(1e-9, 1e-9, 0.0, 0.0, 0.0, 0.01, 0.04)
    before = rows[COVARIANCE, CRUISES, 0][ENTRY]
    after = modes().predict(rows, weights, step)[0][COVARIANCE, CRUISES, 0][ENTRY]
    lever = np.array([-2.0, 1.0, 0.0, 0.1])
    expected = before + 0.04 * np.outer(lever, lever) + 0.01 * np.diag([1.0, 1.0, 0.0, 0.0])
    assert after == pytest.approx(expected, abs=1e-6)


def test_the_whole_has_the_moments_of_the_motions() -> None:
    random = np.random.default_rng(1)
    rows, weights = thing([0.1, 0.1, 0.1, 0.3, 0.2])
    rows[MEAN, :, 0] += random.normal(0.0, 0.1, (4, MOTIONS))
    draws = [
        random.multivariate_normal(rows[:2, k, 0], rows[COVARIANCE, k, 0][ENTRY][:2, :2], 20_000)
        for k in range(MOTIONS)
    ]
    shares = np.array([0.3, 0.3, 0.2]) / 0.8
    mean = sum(s * d.mean(axis=0) for s, d in zip(shares, draws, strict=True))
    spread = sum(
        s * ((d - mean).T @ (d - mean)) / len(d) for s, d in zip(shares, draws, strict=True)
    )
    whole = mixtures(moments(rows), by_motion(weights))[:, 0, 0]
    assert whole[:2] == pytest.approx(mean, abs=1e-3)
    assert whole[2:5] == pytest.approx(spread[[0, 0, 1], [0, 1, 1]], abs=2e-4)
    assert whole[5] == pytest.approx(0.8)
    assert by_motion(weights)[1, :, 0] == pytest.approx([0.2, 0.3, 0.2])
