"""The figures of a run, against sums done by hand."""

import numpy as np

from host.messages import Bearings, Estimate, Scan, Truth
from host.sessions.figures import Delays, Tally, timing


def an_estimate(*points):
    positions = np.array(points, dtype=float).reshape(-1, 2)
    n = len(positions)
    covariances = np.tile(np.eye(2), (n, 1, 1))
    return Estimate(1.0, positions, covariances, np.ones(n), np.zeros(n), np.arange(n))


def a_truth(*points):
    return Truth(1.0, np.arange(len(points)), np.array(points, dtype=float).reshape(-1, 2))


def test_means_are_over_all_estimates_and_errors_over_those_of_someone():
    tally = Tally()
    tally.take(an_estimate([1.0, 0.0], [0.0, 9.0]))
    tally.take(a_truth([1.1, 0.0], [0.0, -3.0]))
    tally.take(an_estimate([1.0, 0.0], [0.0, 1.0], [5.0, 5.0]))
    tally.take(a_truth([1.3, 0.0], [0.0, 1.2]))
    assert tally.figures() == {
        "updates": 2,
        "teammates_reported": 2.5,
        "teammates_in_range": 1.5,
        "mean_error_mm": 200.0,
    }


def test_what_is_not_known_is_no_figure():
    assert Tally().figures() == {"updates": 0, "teammates_reported": None}
    assert timing([]) == {"update_ms_median": None, "update_ms_p99": None}
    assert timing([0.001, 0.002, 0.003])["update_ms_median"] == 2.0


def test_delays_run_from_the_measurement_to_its_estimate():
    now = [0.0]
    delays = Delays(clock=lambda: now[0])
    for k in range(101):
        now[0] = k + 0.001 * k
        delays.note(Scan(float(k), np.zeros(1), np.zeros(1), np.zeros(1)))
    delays.note(Bearings(now[0] - 0.15, np.zeros(1), np.ones(1)))
    assert delays.figures() == {
        "lidar": {"median": 50.0, "p99": 99.0},
        "camera": {"median": 150.0, "p99": 150.0},
    }
