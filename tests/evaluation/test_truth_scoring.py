"""Who is to be reported, whose report is no error, and which estimates count."""

import numpy as np
import pytest

from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.truth_scoring import score_by_track
from host.messages import Estimate, Truth


def an_estimate(time, *points):
    n = len(points)
    points = np.array(points, dtype=float).reshape(n, 2)
    labels = np.arange(n)
    return Estimate(time, points, np.tile(np.eye(2), (n, 1, 1)), np.ones(n), np.zeros(n), labels)


def scored_row(teammates, *estimates):
    """The figures where the teammates (m, 2) stand still; range 2 m, border to 2.5 m."""
    teammates = np.array(teammates, dtype=float).reshape(-1, 2)
    who = np.arange(len(teammates))
    track = TruthTrack([Truth(t, who, teammates) for t in (0.0, 10.0)])
    scored = Accumulator()
    score_by_track(estimates, track, scored, range_m=2.0, band_m=0.5, warm_up_s=5.0)
    return scored.row("", "", "", "")


def parts(teammates, *points):
    """Missed and false of one instant."""
    row = scored_row(teammates, an_estimate(0.0), an_estimate(6.0, *points))
    return row.missed, row.false


def test_warming_up_and_times_without_truth_are_left_out():
    row = scored_row(
        [[1.0, 0.0]],
        an_estimate(1.0),
        an_estimate(5.9),
        an_estimate(6.0, [1.0, 0.0]),
        an_estimate(9.0),
        an_estimate(11.0),
    )
    assert row.seconds == 3.0
    assert row.missed == pytest.approx(1 / 2)


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5])
def test_only_teammates_within_range_are_missed(angle):
    ray = np.array([np.cos(angle), np.sin(angle)])
    assert parts([1.99 * ray]) == (1.0, 0.0)
    assert parts([2.01 * ray]) == (0.0, 0.0)


def test_a_teammate_beyond_the_range_excuses_one_report_however_far_it_is():
    assert parts([[4.0, 0.0]], [4.1, 0.0]) == (0.0, 0.0)
    assert parts([[4.0, 0.0]], [4.1, 0.0], [3.9, 0.0]) == (0.0, 1.0)
    assert parts([[4.0, 0.0]], [0.0, 4.0]) == (0.0, 1.0)


def test_what_stands_in_the_border_is_never_false():
    assert parts([], [2.01, 0.0], [0.0, -2.49], [-2.2, 0.0], [-2.2, 0.0]) == (0.0, 0.0)
    assert parts([], [1.99, 0.0]) == (0.0, 1.0)
    assert parts([], [2.51, 0.0]) == (0.0, 1.0)


def test_an_estimate_in_the_border_that_a_teammate_needs_excuses_no_other():
    assert parts([[1.95, 0.0]], [2.05, 0.0]) == (0.0, 0.0)
    assert parts([[1.95, 0.0]], [2.05, 0.0], [1.6, 0.0]) == (0.0, 1.0)


def test_a_stray_estimate_counts_at_any_range_and_nothing_excuses_it():
    def stray(teammates, *points):
        return scored_row(teammates, an_estimate(0.0), an_estimate(6.0, *points)).stray

    assert stray([[1.0, 0.0]], [1.29, 0.0]) == 0.0
    assert stray([[1.0, 0.0]], [1.31, 0.0]) == 1.0  # matched, and yet where nobody is
    assert stray([[1.0, 0.0]], [0.9, 0.0], [1.1, 0.0]) == 0.0  # twice, but where somebody is
    assert stray([[1.0, 0.0]], [0.0, 2.3], [0.0, 7.0]) == 2.0  # in the border and beyond
    assert stray([[4.0, 0.0]], [4.2, 0.0]) == 0.0  # somebody who need not be reported
    assert stray([], [1.0, 0.0]) == 1.0
