"""Errors over time, distance and angle, against other ways to compute them."""

import itertools
import math

import numpy as np
import pytest

from host.evaluation import curves
from host.evaluation.metrics import Accumulator, Instant, label_changes
from host.messages import Estimate, Truth

NOWHERE = np.zeros((0, 2))


def an_instant(time, robots, wanted, estimates, labels=None, weights=None):
    """robots: position by number; wanted: their numbers; estimates: positions."""
    positions = np.array(list(robots.values()), dtype=float).reshape(-1, 2)
    points = np.array(estimates, dtype=float).reshape(-1, 2)
    n = len(points)
    estimate = Estimate(
        time,
        points,
        np.tile(np.eye(2), (n, 1, 1)),
        np.ones(n) if weights is None else np.array(weights),
        np.zeros(n),
        np.arange(n) if labels is None else np.array(labels),
    )
    inside = np.isin(list(robots), wanted)
    gospa = Accumulator().add(positions[inside], positions[~inside], estimate)
    return Instant(Truth(time, np.array(list(robots)), positions), inside, estimate, gospa)


def random_instants(seed, count=40):
    random = np.random.default_rng(seed)
    for k in range(count):
        robots = {int(n): random.uniform(-2, 2, 2) for n in random.permutation(6)[:4]}
        wanted = [n for n in robots if random.random() < 0.7]
        estimates = random.uniform(-2, 2, (random.integers(0, 6), 2))
        yield an_instant(0.3 * k, robots, wanted, estimates)


def test_each_robot_has_its_column_and_no_error_while_it_is_out_of_range():
    found = curves.nearest_errors(
        [
            an_instant(1.0, {7: [1, 0], 3: [0, 1]}, [3, 7], [[1, 0.3], [0, 1.1]]),
            an_instant(2.0, {3: [0, 1]}, [3], []),
            an_instant(3.0, {7: [1, 0], 3: [5, 5]}, [7], [[1, 0.1], [5, 5]]),
        ]
    )
    assert found.times.tolist() == [1.0, 2.0, 3.0]
    assert found.robots.tolist() == [3, 7]
    wanted = [[0.1, 0.3], [math.inf, math.nan], [math.nan, 0.1]]
    np.testing.assert_allclose(found.errors, wanted)
    assert curves.time_over(found.errors, 0.2).tolist() == [1 / 2, 1 / 2]


def test_a_robot_that_is_never_in_range_has_no_share():
    assert np.isnan(curves.time_over(np.full((3, 1), math.nan))).all()


def test_the_mean_over_robots_weighted_by_their_time_is_the_row_s_time_over_30cm():
    scored = Accumulator()
    instants = list(random_instants(5))
    for at in instants:
        scored.add(at.truth.positions[at.wanted], NOWHERE, at.estimate)
    errors = curves.nearest_errors(instants).errors
    seen = np.sum(~np.isnan(errors), axis=0)
    share = np.sum(curves.time_over(errors) * seen) / np.sum(seen)
    assert share == pytest.approx(scored.row("", "", "", "").time_over_30cm)


def test_weights_are_summed_beside_the_robots_in_range():
    one = an_instant(0.0, {1: [1, 0], 2: [0, 1]}, [1], [[1, 0], [2, 2]], weights=[0.5, 0.75])
    sums, wanted = curves.weight_sums([one])
    assert (sums.tolist(), wanted.tolist()) == ([1.25], [1.0])


def pairs_by_brute_force(at):
    """Errors of the wanted robots in the best of all ways to pair as many as can be."""
    robots, points = at.truth.positions, at.estimate.positions
    size = min(len(robots), len(points))
    ways = itertools.product(
        itertools.combinations(range(len(robots)), size),
        itertools.permutations(range(len(points)), size),
    )
    best = min(
        (
            [(i, math.dist(robots[i], points[j])) for i, j in zip(a, b, strict=True)]
            for a, b in ways
        ),
        key=lambda pairs: sum(d for _, d in pairs),
    )
    return [(d, math.hypot(*robots[i])) for i, d in best if at.wanted[i]]


def test_pairs_are_the_best_of_all_without_a_cut_off_and_count_where_wanted():
    instants = list(random_instants(11))
    found = curves.pair_errors(instants)
    expected = [pair for at in instants for pair in pairs_by_brute_force(at)]
    assert len(expected) > 60
    assert sorted(zip(found.errors, found.distances, strict=True)) == [
        (pytest.approx(d), pytest.approx(r)) for d, r in sorted(expected)
    ]


def test_an_estimate_of_a_robot_out_of_range_is_no_error_of_one_in_range():
    robots = {1: [1.0, 0.0], 2: [3.0, 0.0]}
    found = curves.pair_errors([an_instant(0.0, robots, [1], [[3.0, 0.1]])])
    assert len(found.errors) == 0


def test_the_cumulative_error_is_the_share_of_errors_up_to_each_edge():
    errors = np.random.default_rng(2).gamma(2.0, 0.05, 500)
    edges, shares = curves.cumulative(errors)
    assert len(edges) == 100
    assert edges[-1] == pytest.approx(errors.max())
    for edge, share in zip(edges[::7], shares[::7], strict=True):
        assert share == pytest.approx(sum(e <= edge for e in errors) / 500)
    assert shares[-1] == 1.0
    # Where the curve reaches .67 is the 67th percentile, up to a bin.
    at_67 = edges[np.searchsorted(shares, 0.67)]
    assert at_67 == pytest.approx(np.percentile(errors, 67), abs=edges[0])
    assert [len(part) for part in curves.cumulative(np.zeros(0))] == [0, 0]


def test_errors_fall_into_bins_of_a_decimetre():
    where, errors = np.array([0.05, 0.3, 0.39, 1.0]), np.array([1.0, 3.0, 4.0, 2.0])
    bins = curves.rms_in_bins(where, errors, 0.1)
    assert bins.middles == pytest.approx([0.05, 0.35, 1.05])
    assert bins.counts.tolist() == [1, 2, 1]
    assert bins.rms_m == pytest.approx([1.0, math.sqrt((9 + 16) / 2), 2.0])


def test_the_bin_behind_the_robot_is_one_on_both_sides_of_pi():
    bearings = np.radians([-179.0, 179.0, 0.0, 7.0, 8.0])
    found = curves.PairErrors(np.array([1.0, 7.0, 2.0, 2.0, 3.0]), np.ones(5), bearings)
    bins = curves.over_angle(found)
    assert np.degrees(bins.middles) == pytest.approx([-180.0, 0.0, 15.0])
    assert bins.rms_m == pytest.approx([5.0, 2.0, 3.0])


def test_gospa_over_time_is_the_mean_of_each_bin():
    instants = list(random_instants(3))
    middles, means = curves.gospa_over_time(instants, 5.0)
    assert middles.tolist() == [2.5, 7.5, 12.5]
    for middle, mean in zip(middles, means, strict=True):
        inside = [a.gospa.distance for a in instants if abs(a.estimate.time - middle) < 2.5]
        assert mean == pytest.approx(np.mean(inside), rel=0.05)
    assert [len(part) for part in curves.gospa_over_time([], 5.0)] == [0, 0]


def test_a_label_changes_when_the_next_match_has_another():
    robots = {1: [1.0, 0.0], 2: [0.0, 1.0]}
    near = [[1.0, 0.0], [0.0, 1.0]]
    instants = [
        an_instant(0.0, robots, [1, 2], near, labels=[4, 5]),
        an_instant(1.0, robots, [1, 2], near, labels=[5, 4]),  # both changed
        an_instant(2.0, robots, [1, 2], []),  # not reported: no change
        an_instant(3.0, robots, [1], near, labels=[5, 9]),  # 2 is out of range
        an_instant(4.0, robots, [1, 2], near, labels=[5, 4]),  # as before
        an_instant(5.0, robots, [1, 2], near, labels=[6, 4]),
    ]
    seconds = 2 + 2 + 1 + 2 + 2
    assert label_changes(instants) == pytest.approx(60 * 3 / seconds)
    # Two runs, one after the other: the second's labels have nothing to do with the first's.
    other = [an_instant(0.0, robots, [1, 2], near, labels=[8, 9]), *instants[1:]]
    assert label_changes([*instants, *other]) == pytest.approx(60 * (3 + 3) / (2 * seconds))
    assert math.isnan(label_changes(instants[:1]))
