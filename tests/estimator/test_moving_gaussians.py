"""Gaussians as columns, against the same formulas with one matrix at a time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimator.moving_gaussians import (
    COVARIANCE,
    ENTRY,
    FIRST,
    MEAN,
    ROWS,
    SECOND,
    WEIGHT,
    from_moments,
    match_moments,
    moments,
    propagate,
    update_along,
)
from host.messages import FloatArray

SEEDS = st.integers(0, 2**32 - 1)


def some(random: np.random.Generator, *shape: int) -> FloatArray:
    """Gaussians (ROWS, *shape) with any positive definite covariance."""
    rows = np.empty((ROWS, *shape))
    roots = random.normal(0.0, 0.3, (*shape, 4, 4))
    matrices = roots @ roots.swapaxes(-1, -2) + 1e-3 * np.eye(4)
    rows[MEAN] = random.normal(0.0, 1.0, (4, *shape))
    rows[COVARIANCE] = np.moveaxis(matrices[..., FIRST, SECOND], -1, 0)
    rows[WEIGHT] = random.uniform(0.1, 1.0, shape)
    return rows


def matrix(rows: FloatArray, *index: int) -> FloatArray:
    """The covariance (4, 4) of one Gaussian."""
    return np.asarray(rows[COVARIANCE][(slice(None), *index)][ENTRY])


@given(SEEDS)
def test_propagation_is_that_of_kalman(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows = some(random, 2, 3)
    before = rows.copy()
    transitions, noise = random.normal(0.0, 1.0, (2, 4, 4)), some(random, 2)
    propagate(rows, transitions, noise[COVARIANCE])
    for mode in range(2):
        f, q = transitions[mode], matrix(noise, mode)
        for k in range(3):
            assert rows[MEAN, mode, k] == pytest.approx(f @ before[MEAN, mode, k])
            expected = f @ matrix(before, mode, k) @ f.T + q
            assert matrix(rows, mode, k) == pytest.approx(expected)


@given(SEEDS, st.floats(0.0, 0.3), st.floats(0.05, 1.0))
def test_a_scalar_update_is_that_of_kalman(seed: int, lag: float, share: float) -> None:
    random = np.random.default_rng(seed)
    rows = some(random, 2, 3)
    before = rows.copy()
    angle = random.uniform(-math.pi, math.pi, 3)
    directions = np.stack((np.cos(angle), np.sin(angle)))[:, None]
    off, variances = random.normal(0.0, 0.1, (2, 3)), random.uniform(1e-4, 0.1, 3)
    density = update_along(rows, directions, off, variances, lag, share)
    for mode in range(2):
        for k in range(3):
            h = np.concatenate((directions[:, 0, k], -lag * directions[:, 0, k]))
            p = matrix(before, mode, k)
            gain = p @ h / (h @ p @ h + variances[k] / share)
            assert rows[MEAN, mode, k] == pytest.approx(before[MEAN, mode, k] + gain * off[mode, k])
            assert matrix(rows, mode, k) == pytest.approx(p - np.outer(gain, h @ p))
            spread = h @ p @ h + variances[k]
            expected = math.exp(-0.5 * off[mode, k] ** 2 / spread) / math.sqrt(math.tau * spread)
            assert density[mode, k] == pytest.approx(expected)


@given(SEEDS)
def test_moments_and_back_change_nothing(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, centres = some(random, 2, 3), random.normal(0.0, 1.0, (2, 3))[:, None]
    assert from_moments(moments(rows, centres), centres) == pytest.approx(rows)


@given(SEEDS)
def test_a_match_has_the_mean_and_covariance_of_the_mixture(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, into = some(random, 2, 5), np.array([0, 1, 0, 0, 1])
    merged = match_moments(rows, into, random.normal(0.0, 1.0, (2, 2)))
    for mode in range(2):
        for k in range(2):
            members = np.flatnonzero(into == k)
            shares = rows[WEIGHT, mode, members] / rows[WEIGHT, mode, members].sum()
            mean = sum(s * rows[MEAN, mode, i] for s, i in zip(shares, members, strict=True))
            assert merged[WEIGHT, mode, k] == pytest.approx(rows[WEIGHT, mode, members].sum())
            assert merged[MEAN, mode, k] == pytest.approx(mean)
            expected = sum(
                s * (matrix(rows, mode, i) + np.outer(off, off))
                for s, i in zip(shares, members, strict=True)
                for off in [rows[MEAN, mode, i] - mean]
            )
            assert matrix(merged, mode, k) == pytest.approx(expected)
