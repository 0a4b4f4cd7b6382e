"""Evidence of readings whose errors are correlated in time."""

import numpy as np
import pytest

from host.calibration.robust.evidence import Prior, correlated, covariance_of
from host.messages import FloatArray

INVERSE = np.diag([0.3, 2.0])  # of the information of all readings
ROWS = np.broadcast_to(np.diag((600.0 * np.diag(INVERSE)) ** -0.5), (600, 2, 2))
TIMES = np.repeat(np.arange(60.0) * 2.0, 10)
PRIOR = Prior(np.zeros(2), np.zeros((2, 2)), np.full(2, True))


def scattered(scores: FloatArray) -> float:
    """How much the fitted values scatter by these scores, in units of their information."""
    found = covariance_of([correlated(TIMES, scores, ROWS, 2.0)], PRIOR)
    return float(np.trace(np.linalg.solve(INVERSE, found)))


def test_readings_whose_errors_last_for_a_second_count_as_few() -> None:
    """Ten equal scores are as one: their sum scatters ten times as much as that of ten others."""
    once = np.random.default_rng(5).normal(size=(60, 2))
    plain = float(np.sum((once.T @ once) * INVERSE))
    assert scattered(np.repeat(once, 10, axis=0)) == pytest.approx(
        100.0 * plain * (60.0 / 59.0) * (599.0 / 600.0) * (1200.0 / 1198.0)
    )
    # Where errors take turns, a block's sum is nearly nothing: no less than reading by reading.
    balanced = np.repeat(once, 10, axis=0) * np.resize([[1.0], [-1.0]], (600, 1))
    assert scattered(balanced) == pytest.approx(10.0 * plain * 1200.0 / 1198.0)


def test_what_no_reading_is_about_takes_nothing_of_their_errors() -> None:
    """Unknowns besides, or two that are one thing, leave scatter and information as they were."""
    scores = np.random.default_rng(6).normal(size=(600, 2))
    alone = correlated(TIMES, scores, ROWS, 2.0)
    more = (*range(2), 0, 0)  # the first once more; the last of the four is made zero
    wide, wide_rows = scores[:, more].copy(), ROWS[:, :, more].copy()
    wide[:, 3] = wide_rows[:, :, 3] = 0.0
    found = correlated(TIMES, wide, wide_rows, 2.0)
    assert found.scatter[:2, :2] == pytest.approx(alone.scatter)
    assert found.information[:2, :2] == pytest.approx(alone.information)
    assert not found.scatter[3].any()
