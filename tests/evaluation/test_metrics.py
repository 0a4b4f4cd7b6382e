import datetime
import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stonesoup.measures import Euclidean
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.types.state import State

from host.evaluation.metrics import Accumulator, gospa
from host.messages import Estimate

coordinate = st.floats(-2.0, 2.0)
points = st.lists(st.tuples(coordinate, coordinate), max_size=4).map(
    lambda rows: np.array(rows, dtype=float).reshape(-1, 2)
)


def an_estimate(positions, time=0.0, sigma=0.1):
    positions = np.array(positions, dtype=float).reshape(-1, 2)
    n = len(positions)
    return Estimate(
        time=time,
        positions=positions,
        covariances=np.tile(sigma**2 * np.eye(2), (n, 1, 1)),
        weights=np.ones(n),
        ages=np.zeros(n),
        labels=np.arange(n),
    )


def by_brute_force(truth, estimates, p, c):
    """GOSPA over every partial assignment, straight from the definition with alpha = 2."""
    best = math.inf
    for size in range(min(len(truth), len(estimates)) + 1):
        for chosen in itertools.combinations(range(len(truth)), size):
            for partners in itertools.permutations(range(len(estimates)), size):
                paired = sum(
                    math.dist(truth[i], estimates[j]) ** p
                    for i, j in zip(chosen, partners, strict=True)
                )
                alone = len(truth) + len(estimates) - 2 * size
                best = min(best, paired + c**p / 2 * alone)
    return best ** (1 / p)


@settings(derandomize=True, max_examples=150, deadline=None)
@given(truth=points, estimates=points, p=st.sampled_from([1.0, 2.0, 3.5]), c=st.floats(0.1, 3.0))
def test_gospa_is_the_best_of_all_assignments(truth, estimates, p, c):
    found = gospa(truth, estimates, p, c)
    # Taking the root of a rounding error near 0 enlarges it.
    assert found.distance == pytest.approx(by_brute_force(truth, estimates, p, c), abs=1e-7)
    again = found.localisation**p + c**p / 2 * (found.missed + found.false)
    assert found.distance**p == pytest.approx(again, rel=1e-12)


def test_gospa_equals_stone_soup():
    generator = np.random.default_rng(5)
    now = datetime.datetime(2020, 1, 1)
    for _ in range(60):
        m, n = generator.integers(0, 12, 2)
        if m + n == 0:
            continue
        p, c = generator.choice([1.0, 2.0, 3.0]), generator.choice([0.3, 0.5, 1.0])
        truth = generator.uniform(-1, 1, (m, 2))
        estimates = generator.uniform(-1, 1, (n, 2))
        peer = GOSPAMetric(p=p, c=c, measure=Euclidean())
        states = [[State(row.reshape(2, 1), now) for row in rows] for rows in (estimates, truth)]
        theirs = peer.compute_gospa_metric(*states)[0].value
        mine = gospa(truth, estimates, p, c)
        assert mine.distance == pytest.approx(theirs["distance"], abs=1e-12)
        assert mine.localisation**p == pytest.approx(theirs["localisation"], abs=1e-12)
        assert mine.missed * c**p / 2 == pytest.approx(theirs["missed"], abs=1e-12)
        assert mine.false * c**p / 2 == pytest.approx(theirs["false"], abs=1e-12)


def test_a_row_computed_by_hand():
    scored = Accumulator(p=2.0, c=0.5)
    # One match at 0.1 m, one missed, one false.
    scored.add(
        np.array([[0.0, 0.0], [2.0, 0.0]]), np.zeros((0, 2)), an_estimate([[0.1, 0], [9, 9]])
    )
    # Nothing there, nothing said: counts as an instant.
    scored.add(np.zeros((0, 2)), np.zeros((0, 2)), an_estimate([], time=1.0))
    # A match at 0.4 m, beyond 30 cm; the estimate left over is excused by a don't-care.
    scored.add(
        np.array([[1.0, 0.0]]), np.array([[3.0, 0.0]]), an_estimate([[1, 0.4], [3.2, 0]], time=2.5)
    )
    scored.update_seconds += [0.001, 0.002, 0.003]
    row = scored.row("here", "1", "mine", "lidar")
    first, third = math.sqrt(0.01 + 0.25), 0.4
    assert row.gospa_m == pytest.approx((first + 0.0 + third) / 3)
    assert row.localisation_m == pytest.approx((0.1 + 0.0 + 0.4) / 3)
    assert (row.missed, row.false) == pytest.approx((1 / 3, 1 / 3))
    assert row.stray == pytest.approx((1 + 0 + 2) / 3)
    assert row.cardinality_error == pytest.approx(0.0)
    assert row.time_over_30cm == pytest.approx(2 / 3)
    assert row.rmse_m == pytest.approx(math.sqrt((0.01 + 0.16) / 2))
    assert row.p67_m == pytest.approx(0.1 + 0.67 * 0.3)
    assert row.anees == pytest.approx((0.01 / 0.01 + 0.16 / 0.01) / 2 / 2)
    assert row.update_ms_median == pytest.approx(2.0)
    assert row.seconds == pytest.approx(2.5)
    assert " ".join(row.as_json()) == (
        "source observer filter sensors seconds gospa_m localisation_m missed false "
        "stray time_over_30cm rmse_m p67_m cardinality_error label_changes anees "
        "update_ms_median update_ms_p99"
    )


def test_a_dont_care_excuses_one_estimate_only():
    scored = Accumulator()
    nothing, thing = np.zeros((0, 2)), np.array([[1.0, 0.0]])
    assert scored.add(nothing, thing, an_estimate([[1, 0], [1, 0.1]])).false == 1
    assert scored.add(nothing, thing, an_estimate([[1.6, 0]], time=1.0)).false == 1
    assert scored.add(thing, thing, an_estimate([[1, 0], [1, 0.1]], time=2.0)).false == 0


def test_the_nearest_estimate_counts_for_time_over_30cm_even_if_matched_elsewhere():
    scored = Accumulator()
    scored.add(np.array([[0.0, 0.0], [0.1, 0.0]]), np.zeros((0, 2)), an_estimate([[0.0, 0.0]]))
    row = scored.row("", "", "", "")
    assert row.missed == 1.0
    assert row.time_over_30cm == 0.0


def test_anees_is_one_for_errors_of_the_stated_covariance():
    generator = np.random.default_rng(1)
    scored = Accumulator(c=10.0)
    for k in range(2000):
        error = generator.normal(0.0, 0.1, (1, 2))
        scored.add(np.zeros((1, 2)), np.zeros((0, 2)), an_estimate(error, time=float(k)))
    assert scored.row("", "", "", "").anees == pytest.approx(1.0, abs=0.05)


def test_an_estimate_that_claims_to_be_exact_is_scored():
    """A filter of one's own may give no covariance: overconfident without bound, not a fault."""
    scored, truth = Accumulator(), np.array([[0.0, 0.0], [2.0, 0.0]])
    for sigma in (0.0, 0.1):
        guess = an_estimate(truth + 0.1, time=sigma, sigma=sigma)
        scored.add(truth, np.zeros((0, 2)), guess)
    row = scored.row("", "", "", "")
    assert row.anees == math.inf
    assert row.as_json()["anees"] is None
    assert row.rmse_m == pytest.approx(math.hypot(0.1, 0.1))


def test_pooling_is_the_same_as_one_run():
    generator = np.random.default_rng(2)
    together, parts = Accumulator(), [Accumulator(), Accumulator()]
    for k in range(20):
        truth = generator.uniform(0, 1, (k % 4, 2))
        guess = an_estimate(generator.uniform(0, 1, (k % 3, 2)), time=float(k))
        together.add(truth, np.zeros((0, 2)), guess)
        parts[k >= 10].add(truth, np.zeros((0, 2)), guess)
    whole = together.row("s", "all", "f", "x").as_json()
    pooled = Accumulator.pooled(parts).row("s", "all", "f", "x").as_json()
    assert pooled.pop("seconds") == 18.0  # the second between the two runs is nobody's
    assert whole.pop("seconds") == 19.0
    assert pooled == whole
    with pytest.raises(ValueError, match="pooled"):
        Accumulator.pooled([Accumulator(c=1.0), Accumulator(c=2.0)])


def test_figures_that_do_not_exist_are_null_in_json():
    row = Accumulator().row("s", "1", "f", "x")
    assert json.loads(json.dumps(row.as_json(), allow_nan=False))["rmse_m"] is None
