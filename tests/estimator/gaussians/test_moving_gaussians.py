"""Gaussians as columns, against the same formulas with one matrix at a time."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from host.estimator.gaussians.moving_gaussians import (
    COVARIANCE,
    ENTRY,
    FIRST,
    MEAN,
    ROWS,
    SECOND,
    absorb,
    change,
    innovations,
    mix,
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


@given(SEEDS, st.floats(0.0, 0.3))
def test_a_position_changes_gaussians_as_kalman_does(seed: int, lag: float) -> None:
    random = np.random.default_rng(seed)
    before, noise = some(random, 2, 3), some(random, 3)
    places = before[:2, 0] + random.normal(0.0, 0.2, (2, 3))
    read = np.stack([matrix(noise, k)[:2, :2] for k in range(3)])
    found = innovations(before, places[:, None], read, lag)
    after = before.copy()
    absorb(after, found.changes(np.arange(3)), np.arange(3), np.ones((2, 3)))
    h = np.hstack((np.eye(2), -lag * np.eye(2)))
    for motion in range(2):
        for k in range(3):
            p, r = matrix(before, motion, k), matrix(noise, k)[:2, :2]
            s = h @ p @ h.T + r
            off = places[:, k] - h @ before[MEAN, motion, k]
            gain = p @ h.T @ np.linalg.inv(s)
            expected = before[MEAN, motion, k] + gain @ off
            assert after[MEAN, motion, k] == pytest.approx(expected, abs=1e-9)
            assert matrix(after, motion, k) == pytest.approx(p - gain @ h @ p, abs=1e-9)
            density = multivariate_normal.pdf(off, np.zeros(2), s)
            assert found.likelihood[motion, k] == pytest.approx(density, rel=1e-6)
            assert found.squares[motion, k] == pytest.approx(off @ np.linalg.solve(s, off))


def moments(parts: list[tuple[float, FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a mixture of (share, mean, covariance)."""
    mean = sum((share * m for share, m, _ in parts), np.zeros(4))
    spread = [share * (p + np.outer(m - mean, m - mean)) for share, m, p in parts]
    return mean, sum(spread, np.zeros((4, 4)))


@given(SEEDS)
def test_what_is_absorbed_has_the_moments_of_the_mixture(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, after, into = some(random, 2, 2), some(random, 2, 5), np.array([0, 1, 0, 0, 1])
    shares = random.uniform(0.0, 0.3, (2, 5))
    absorbed = rows.copy()
    absorb(absorbed, change(rows.take(into, axis=2), after), into, shares)
    for motion in range(2):
        for k in range(2):
            members = np.flatnonzero(into == k)
            stays = 1.0 - shares[motion, members].sum()
            parts = [(stays, rows[MEAN, motion, k], matrix(rows, motion, k))]
            for i in members:
                parts.append((shares[motion, i], after[MEAN, motion, i], matrix(after, motion, i)))
            mean, spread = moments(parts)
            assert absorbed[MEAN, motion, k] == pytest.approx(mean)
            assert matrix(absorbed, motion, k) == pytest.approx(spread)


@given(SEEDS)
def test_a_mix_has_the_moments_of_the_mixture(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, shares = some(random, 3, 2), random.dirichlet(np.ones(3), (3, 2)).transpose(2, 0, 1)
    mixed = mix(rows, shares)
    for into in range(3):
        for k in range(2):
            parts = [
                (shares[start, into, k], rows[MEAN, start, k], matrix(rows, start, k))
                for start in range(3)
            ]
            mean, spread = moments(parts)
            assert mixed[MEAN, into, k] == pytest.approx(mean)
            assert matrix(mixed, into, k) == pytest.approx(spread)
