"""Belief propagation against all joint associations, enumerated one by one."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.estimator.things.association import associate
from host.messages import FloatArray


def enumerate_all(ratios: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Marginals of pairs (n, m), missed (n,) and unclaimed (m,) by every joint association."""
    n, m = ratios.shape
    pairs, missed, unclaimed, total = np.zeros((n, m)), np.zeros(n), np.zeros(m), 0.0
    for choice in itertools.product(range(-1, m), repeat=n):
        taken = [j for j in choice if j >= 0]
        if len(set(taken)) < len(taken):
            continue
        weight = float(np.prod([ratios[i, j] for i, j in enumerate(choice) if j >= 0]))
        total += weight
        for i, j in enumerate(choice):
            if j >= 0:
                pairs[i, j] += weight
            else:
                missed[i] += weight
        unclaimed[[j for j in range(m) if j not in taken]] += weight
    return pairs / total, missed / total, unclaimed / total


def propagate(ratios: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    n, m = ratios.shape
    i, j = ratios.nonzero()
    found = associate(i, j, ratios[i, j], n, m)
    pairs = np.zeros((n, m))
    pairs[i, j] = found.pairs
    return pairs, found.missed, found.unclaimed


def ratios_of(seed: int, n: int, m: int, decades: float = 3.0) -> FloatArray:
    return np.asarray(10.0 ** np.random.default_rng(seed).uniform(-decades, decades, (n, m)))


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_it_is_exact_for_one_target_and_for_one_reading(seed: int, other: int) -> None:
    for shape in ((1, other), (other, 1)):
        ratios = ratios_of(seed, *shape)
        for ours, exact in zip(propagate(ratios), enumerate_all(ratios), strict=True):
            assert ours == pytest.approx(exact, abs=1e-3)


@given(st.integers(0, 2**32 - 1), st.integers(2, 5))
@settings(max_examples=40, deadline=None)
def test_it_is_exact_where_the_pairs_form_a_chain(seed: int, n: int) -> None:
    """Target k may have caused readings k and k + 1: a tree, on which the iteration is exact."""
    full = ratios_of(seed, n, n + 1)
    ratios = np.where(np.isin(np.arange(n + 1) - np.arange(n)[:, None], (0, 1)), full, 0.0)
    for ours, exact in zip(propagate(ratios), enumerate_all(ratios), strict=True):
        assert ours == pytest.approx(exact, abs=0.01)


@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.integers(2, 4))
@settings(max_examples=60, deadline=None)
def test_it_is_near_where_all_compete_for_all(seed: int, n: int, m: int) -> None:
    """With larger ratios and more loops it is surer than it should be, as is known of it."""
    ratios = ratios_of(seed, n, m, decades=1.0)
    for ours, exact in zip(propagate(ratios), enumerate_all(ratios), strict=True):
        assert np.all((ours >= 0.0) & (ours <= 1.0))
        assert np.abs(ours - exact).max() < 0.3
        assert np.abs(ours - exact).mean() < 0.1


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 5))
@settings(max_examples=40, deadline=None)
def test_each_target_and_each_reading_is_used_once(seed: int, n: int, m: int) -> None:
    pairs, missed, unclaimed = propagate(ratios_of(seed, n, m))
    assert pairs.sum(axis=1) + missed == pytest.approx(np.ones(n))
    assert np.all(pairs.sum(axis=0) + unclaimed < 1.02)


def test_without_pairs_everything_is_missed_and_unclaimed() -> None:
    none = np.zeros(0, dtype=np.int64)
    found = associate(none, none, np.zeros(0), 2, 3)
    assert found.missed.tolist() == [1.0, 1.0]
    assert found.unclaimed.tolist() == [1.0, 1.0, 1.0]
    assert len(associate(none, none, np.zeros(0), 0, 0).missed) == 0
