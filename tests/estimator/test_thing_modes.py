"""The chain of modes against matrix exponentials, integrals and sampled motion."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec
from scipy.linalg import expm

from host.config import PmbSettings
from host.estimator.moving_gaussians import COVARIANCE, ENTRY, MEAN, VELOCITY, WEIGHT
from host.estimator.thing_modes import (
    _NOISE,
    _RATES,
    _TIMES,
    CRUISING,
    MODES,
    MOVING,
    OBSTACLE,
    STANDING,
    ThingModes,
    mixture,
)
from host.messages import Displacement, FloatArray

SPEED = 0.2
INTERVALS = st.floats(1e-3, 2.0)


def modes() -> ThingModes:
    return ThingModes(PmbSettings(speed_mps=SPEED))


def thing(weights: list[float]) -> FloatArray:
    """One thing at (1, 2) m, certain to 1 cm, with these weights of its modes."""
    one = np.ones(1)
    rows = modes().born(np.array([[1.0, 2.0]]), 1e-4 * np.eye(2)[None], 0.0, one, one)
    rows[WEIGHT, :, 0] = weights
    return rows


def moved(rows: FloatArray, dt: float, **motion: float) -> FloatArray:
    step = {"dx": 0.0, "dy": 0.0, "dpsi": 0.0, **motion}
    return modes().predict(rows, Displacement(dt, dt, **step))


@given(INTERVALS, st.integers(0, MODES - 1))
def test_modes_change_as_the_chain_does(dt: float, start: int) -> None:
    weights = [float(mode == start) for mode in range(MODES)]
    after = moved(thing(weights), dt)[WEIGHT, :, 0]
    generator = _RATES - np.diag(_RATES.sum(axis=1))
    assert after == pytest.approx(expm(generator * dt)[start], abs=1e-9)


@pytest.mark.parametrize("mode", [MOVING, CRUISING])
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
    rows = thing([0.5, 0.0, 0.5, 0.0, 0.0])
    rows[WEIGHT, STANDING:] = 0.0
    after = moved(rows, 2.0)
    assert after[COVARIANCE, OBSTACLE, 0][:3] == pytest.approx([1e-4, 0.0, 1e-4], rel=1e-3)
    assert not after[VELOCITY, OBSTACLE].any()
    assert not after[VELOCITY, STANDING].any()


def test_what_starts_to_move_may_have_any_velocity() -> None:
    after = moved(thing([0.0, 0.0, 1.0, 0.0, 0.0]), 0.01)
    assert after[MEAN, MOVING, 0] == pytest.approx([1.0, 2.0, 0.0, 0.0])
    velocity = after[COVARIANCE, MOVING, 0][[7, 8, 9]]
    assert velocity == pytest.approx([SPEED**2, 0.0, SPEED**2], rel=0.05)


def test_the_robots_own_motion_moves_everything_the_other_way() -> None:
    rows = thing([1.0, 0.0, 0.0, 0.0, 1e-6])
    rows[VELOCITY, CRUISING, 0] = 0.1, 0.0
    after = moved(rows, 1e-6, dx=0.5, dy=0.0, dpsi=0.5 * math.pi)
    assert after[MEAN, OBSTACLE, 0] == pytest.approx([2.0, -0.5, 0.0, 0.0], abs=1e-6)
    assert after[MEAN, CRUISING, 0] == pytest.approx([2.0, -0.5, 0.0, -0.1], abs=1e-4)


def test_a_heading_error_spreads_across_the_ray_and_turns_velocities() -> None:
    rows = thing([0.0, 0.0, 0.0, 1e-9, 1.0])
    rows[VELOCITY, CRUISING, 0] = 0.1, 0.0
    step = Displacement(1e-9, 1e-9, 0.0, 0.0, 0.0, 0.01, 0.04)
    before = rows[COVARIANCE, CRUISING, 0][ENTRY]
    after = modes().predict(rows, step)[COVARIANCE, CRUISING, 0][ENTRY]
    lever = np.array([-2.0, 1.0, 0.0, 0.1])
    expected = before + 0.04 * np.outer(lever, lever) + 0.01 * np.diag([1.0, 1.0, 0.0, 0.0])
    assert after == pytest.approx(expected, abs=1e-6)


def test_the_whole_has_the_moments_of_the_modes() -> None:
    random = np.random.default_rng(1)
    rows = thing([0.1, 0.1, 0.1, 0.3, 0.2])
    rows[MEAN, :, 0] += random.normal(0.0, 0.1, (4, MODES))
    draws = [
        random.multivariate_normal(rows[:2, k, 0], rows[COVARIANCE, k, 0][ENTRY][:2, :2], 20_000)
        for k in range(MODES)
    ]
    shares = rows[WEIGHT, :, 0] / rows[WEIGHT].sum()
    mean = sum(s * d.mean(axis=0) for s, d in zip(shares, draws, strict=True))
    spread = sum(
        s * ((d - mean).T @ (d - mean)) / len(d) for s, d in zip(shares, draws, strict=True)
    )
    whole = mixture(rows)[:, 0]
    assert whole[:2] == pytest.approx(mean, abs=1e-3)
    assert whole[2:5] == pytest.approx(spread[[0, 0, 1], [0, 1, 1]], abs=2e-4)
    assert whole[5] == pytest.approx(0.8)
