"""Which hypotheses are of one thing, against every pair looked at by itself."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import FilterSettings, PmbSettings
from host.estimator.gaussians.duplicates import duplicates
from host.estimator.pmb import PmbFilter
from host.estimator.things.things import LABEL
from tests.estimator.standing_robot import seen, standing


@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
@settings(max_examples=40, deadline=None)
def test_every_pair_nearer_than_its_readings_scatter_is_found(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    positions, variances = random.uniform(0, 1, (2, n)), random.uniform(1e-4, 0.02, n)
    when, weights = random.integers(0, 3, n).astype(float), random.random(n)
    gone, kept = duplicates(positions, variances, when, weights)
    expected = set()
    for i in range(n):
        for j in range(i):
            reach = 1.5 * math.sqrt(2.0) * (math.sqrt(variances[i]) + math.sqrt(variances[j]))
            if math.dist(positions[:, i], positions[:, j]) < reach:
                newer = max((i, j), key=lambda k: (when[k], weights[k]))
                expected.add((i + j - newer, newer))
    going = {pair[0] for pair in expected}
    expected = {pair for pair in expected if pair[1] not in going}
    assert set(zip(gone.tolist(), kept.tolist(), strict=True)) <= expected
    assert sorted(gone.tolist()) == sorted({pair[0] for pair in expected})


def test_a_thing_found_again_beside_its_old_hypothesis_keeps_its_label_and_is_reported_once() -> (
    None
):
    """Readings of 0.1 m, as far apart from one moment to the next as odometry may drift."""
    filter_ = PmbFilter(FilterSettings(pmb=PmbSettings(obstacle_share=0.0, report_error_m=1.0)))
    for k in range(1, 60):
        filter_.predict(standing(0.2 * k, 0.2))
        place = [2.0 + (0.25 if k > 20 else 0.0), 0.0]
        filter_.update(seen(0.2 * k, [place], sigma=0.1))
        if k > 10:
            estimate = filter_.estimate()
            assert len(estimate.positions) == 1
            assert estimate.labels.tolist() == [1]


@pytest.mark.parametrize("gap_m", [0.05, 0.2])
def test_two_things_further_apart_than_their_readings_scatter_stay_two(gap_m: float) -> None:
    filter_ = PmbFilter(FilterSettings(pmb=PmbSettings(obstacle_share=0.0)))
    for k in range(1, 30):
        filter_.predict(standing(0.14 * k, 0.14))
        filter_.update(seen(0.14 * k, [[1.0, 0.0], [1.0, gap_m]], sigma=0.003))
    weights, labels = filter_._things.weights.sum(axis=0), filter_._things.tracks[LABEL]
    assert np.count_nonzero(weights > 0.9) == 2
    assert len(set(labels[weights > 0.9].tolist())) == 2
