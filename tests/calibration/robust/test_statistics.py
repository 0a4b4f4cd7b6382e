"""Statistics of the fits, against formulas worked out another way and against repeated draws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm, rayleigh

from host.calibration.robust import statistics


def test_robust_sigmas_are_those_of_scipys_distributions() -> None:
    shares = (np.arange(20001) + 0.5) / 20001
    assert statistics.normal_sigma(norm.ppf(shares, scale=3.0)) == pytest.approx(3.0, rel=1e-4)
    lengths = rayleigh.ppf(shares, scale=0.2)
    assert statistics.plane_sigma(lengths) == pytest.approx(0.2, rel=1e-4)
    lengths[:4000] += 9.0  # a fifth of outliers hardly counts
    assert statistics.plane_sigma(lengths) < 0.3


@given(st.lists(st.tuples(st.floats(0.0, 100.0), st.integers(0, 2)), min_size=1, max_size=30))
def test_blocks_are_those_of_a_dictionary(rows: list[tuple[float, int]]) -> None:
    times, groups = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    blocks = statistics.blocks_of(times, 3.0, groups)
    keys = [(group, int(time // 3.0)) for time, group in rows]
    assert [keys.index(key) for key in keys] == [blocks.tolist().index(b) for b in blocks]
    assert sorted(set(blocks.tolist())) == list(range(len(set(keys))))
    values = np.arange(len(rows) * 2.0).reshape(-1, 2)
    sums = statistics.block_sums(values, blocks)
    for number, total in enumerate(sums):
        np.testing.assert_allclose(total, values[blocks == number].sum(axis=0))


def test_a_jackknife_of_means_is_the_standard_error() -> None:
    draws = np.random.default_rng(1).normal(0.0, 2.0, 25)
    others = np.array([np.delete(draws, k).mean() for k in range(25)])
    expected = draws.std(ddof=1) / 5.0
    assert float(statistics.jackknife_sigma(others)) == pytest.approx(expected)


@given(st.integers(1, 9), st.integers(9, 60))
def test_pieces_are_in_order_and_of_one_size(count: int, length: int) -> None:
    times = np.random.default_rng(length).permutation(length).astype(float)
    pieces = statistics.pieces_of(times, count)
    assert (np.diff(pieces[np.argsort(times)]) >= 0).all()
    sizes = np.bincount(pieces, minlength=count)
    assert len(sizes) == count
    assert sizes.max() - sizes.min() <= 1


def test_smoothed_rows_are_the_sums_over_pairs_with_bartletts_weights() -> None:
    random = np.random.default_rng(2)
    scores, drives = random.normal(size=(20, 3)), np.repeat([0, 1], 10)
    expected = np.zeros((20, 3))
    for i in range(20):
        for j in range(20):
            weight = max(1.0 - abs(i - j) / 5, 0.0) * (drives[i] == drives[j])
            expected[i] += weight * scores[j]
    found = statistics.smoothed(scores, statistics.bartlett(5), drives)
    np.testing.assert_allclose(found, expected)


def test_a_ratios_variance_is_its_scatter_over_draws_of_correlated_counts() -> None:
    random = np.random.default_rng(3)
    blocks = np.repeat(np.arange(60), 5)
    found, claimed = [], []
    for _ in range(600):
        sizes = random.uniform(1.0, 3.0, 300)
        counts = random.poisson(np.repeat(random.gamma(2.0, 0.2, 60), 5) * sizes).astype(float)
        ratio = counts.sum() / sizes.sum()
        found.append(ratio)
        claimed.append(statistics.ratio_variance(counts, sizes, ratio, blocks))
    assert 0.85 < math.sqrt(np.mean(claimed)) / np.std(found) < 1.18


def test_a_sandwich_is_the_scatter_of_a_mean_whose_errors_are_correlated() -> None:
    """The mean of 40 blocks of 5 equal errors: sigma / sqrt(40), not sigma / sqrt(200)."""
    random = np.random.default_rng(4)
    squares = []
    for _ in range(2000):
        errors = np.repeat(random.normal(0.0, 1.5, 40), 5)
        left = errors - errors.mean()
        sums = statistics.block_sums(left[:, None], np.repeat(np.arange(40), 5))
        middle = statistics.bent_factor(40, 1) * sums.T @ sums
        squares.append(float(statistics.sandwich(np.array([[1.0 / 200.0]]), middle)[0, 0]))
    assert np.mean(squares) == pytest.approx(1.5**2 / 40.0, rel=0.02)
    assert statistics.bent_factor(3.0, 5.0) == 3.0
