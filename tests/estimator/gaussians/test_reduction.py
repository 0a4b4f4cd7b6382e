"""Groups, merging, pruning and labels, each recomputed a component at a time."""

import numpy as np
import pytest

from host.config import FilterSettings
from host.estimator.gaussians.gaussian_mixture import PXX, PXY, PYY, WEIGHT, X, Y
from host.estimator.gaussians.reduction import groups_by_reading, merge, pass_on_labels
from host.estimator.things.kinds import (
    CONFIRMED,
    LABEL,
    OBSTACLE,
    PARENT,
    SEEN,
    STATE,
    TEAMMATE,
    existence,
    rows_of,
)

SETTINGS = FilterSettings(merge_distance=4.0, prune_weight=0.01, capacity=100)


def state_of(things):
    """A state of things (x, y, variance, teammate's weight, obstacle's weight)."""
    state = np.zeros((STATE, len(things)))
    rows = rows_of(state)
    for k, (x, y, variance, teammate, obstacle) in enumerate(things):
        rows[[X, Y, PXX, PYY], :, k] = np.array([x, y, variance, variance])[:, None]
        rows[WEIGHT, :, k] = teammate, obstacle
    state[LABEL] = 10 + np.arange(len(things))
    state[CONFIRMED] = 1.0
    return state


def moments(parts):
    """Weight, mean and covariance of weighted Gaussians, straight from their definition."""
    weights = np.array([weight for weight, _, _ in parts])
    means = np.array([mean for _, mean, _ in parts])
    mean = np.average(means, axis=0, weights=weights)
    spread = [
        np.asarray(covariance) + np.outer(place - mean, place - mean)
        for _, place, covariance in parts
    ]
    return weights.sum(), mean, np.average(spread, axis=0, weights=weights)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_group_becomes_its_moments_for_each_kind(seed):
    random = np.random.default_rng(seed)
    things = [
        (*random.normal(1.0, 0.02, 2), random.uniform(0.01, 0.02), *random.uniform(0.01, 0.1, 2))
        for _ in range(6)
    ]
    group = np.array([0, 1, 0, 1, 0, 1])
    merged = rows_of(merge(state_of(things), group, SETTINGS))
    assert merged.shape[2] == 2
    for kind in (TEAMMATE, OBSTACLE):
        expected = {
            tuple(np.round([weight, *mean, *np.ravel(covariance)], 9))
            for weight, mean, covariance in (
                moments([(t[3 + kind], t[:2], t[2] * np.eye(2)) for t in things[start::2]])
                for start in (0, 1)
            )
        }
        found = {
            tuple(np.round(merged[[WEIGHT, X, Y, PXX, PXY, PXY, PYY], kind, k], 9))
            for k in range(2)
        }
        assert np.array(sorted(found)) == pytest.approx(np.array(sorted(expected)), abs=1e-8)


@pytest.mark.parametrize(("variances", "offset"), [((0.01, 0.01), 0), ((0.004, 0.03), 1)])
def test_members_merge_up_to_the_mahalanobis_distance_of_the_settings(variances, offset):
    """The squared distance by the covariance of the difference, P1 + P2."""
    limit = np.sqrt(SETTINGS.merge_distance * sum(variances))
    for factor, count in ((0.99, 1), (1.01, 2)):
        place = [0.0, 0.0]
        place[offset] = factor * limit
        things = [(0.0, 0.0, variances[0], 0.5, 0.0), (*place, variances[1], 0.3, 0.0)]
        merged = merge(state_of(things), np.array([0, 0]), SETTINGS)
        assert merged.shape[1] == count, factor


def test_what_is_merged_is_one_thing_and_keeps_the_share_of_its_kinds():
    things = [(0.0, 0.0, 0.01, 0.6, 0.3), (0.01, 0.0, 0.01, 0.6, 0.0)]
    weights = rows_of(merge(state_of(things), np.zeros(2, dtype=int), SETTINGS))[WEIGHT, :, 0]
    assert weights == pytest.approx(np.array([1.2, 0.3]) / 1.5)


def test_memory_is_that_of_the_heaviest():
    state = state_of([(0.0, 0.0, 0.01, 0.1, 0.1), (0.01, 0.0, 0.01, 0.1, 0.2)])
    state[SEEN] = 3.0, 4.0
    merged = merge(state, np.zeros(2, dtype=int), SETTINGS)
    assert (merged[SEEN, 0], merged[LABEL, 0]) == (4.0, 11.0)


def test_light_things_are_pruned_and_the_heaviest_kept():
    weights = np.array([0.2, 0.009, 0.5, 0.3, 0.011, *np.linspace(0.6, 0.9, 8)])
    things = [(float(k), 0.0, 0.01, weight, 0.0) for k, weight in enumerate(weights)]
    kept = merge(state_of(things), np.arange(13), SETTINGS)
    assert rows_of(kept)[X, TEAMMATE].tolist() == [0.0, *np.arange(2.0, 13.0)]
    few = FilterSettings(prune_weight=0.01, capacity=10)
    capped = merge(state_of(things), np.arange(13), few)
    assert sorted(rows_of(capped)[X, TEAMMATE].tolist()) == [2.0, 3.0, *np.arange(5.0, 13.0)]


def test_a_label_goes_to_the_heaviest_heir_alone():
    weights = [0.3, 0.5, 0.2, 0.4, 0.9]
    state = state_of([(float(k), 0.0, 0.01, w / 2, w / 2) for k, w in enumerate(weights)])
    state[LABEL] = [7, 7, 8, 8, 5]
    state[PARENT] = [0, 0, 1, 1, 2]  # the last is newborn
    pass_on_labels(state, parents=2)
    assert state[LABEL].tolist() == [0, 7, 0, 8, 0]
    assert state[CONFIRMED].tolist() == [0, 1, 0, 1, 0]


def test_what_was_missed_goes_with_its_likeliest_reading_if_it_has_one():
    # Two readings; component 0 with both, 1 with a reading that is hardly its own, 2 with none.
    i, j = np.array([0, 0, 1]), np.array([0, 1, 1])
    mass, left = np.array([0.3, 0.6, 0.05]), np.array([0.1, 0.9, 0.5])
    group = groups_by_reading(i, j, mass, left, readings=2)
    missed, seen, born = group[:3], group[3:6], group[6:]
    assert missed[0] == 1
    assert len({missed[1], missed[2], 0, 1}) == 4  # by themselves
    assert seen.tolist() == [0, 1, 1]
    assert born.tolist() == [0, 1]


def test_existence_is_the_weight_of_both_kinds():
    assert existence(rows_of(state_of([(0, 0, 1, 0.2, 0.5)]))) == pytest.approx([0.7])
