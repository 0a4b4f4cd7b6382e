"""What a row that fails says to do next."""

import math

import pytest

from host.calibration.result import Calibration, Fitted

LIMIT = math.radians(0.1)


def failures(kind: str, sigma: float, halves: tuple[float, float] | None = None) -> list[str]:
    row = Fitted(key="", name="heading", value=0.0, sigma=sigma, limit=LIMIT, halves=halves)
    return Calibration(kind=kind, fitted=(row,), checks=(), residuals="").failures


def test_a_sigma_too_large_says_how_much_longer_to_record() -> None:
    # Errors of independent stretches: a sigma 1.2 times too large needs 1.44 times as many.
    (said,) = failures("lidar", 1.2 * LIMIT)
    assert "record about 1.4 times as long, with teammates" in said
    assert "calibrate wheels" in said
    (hidden,) = failures("wheels", 30.0 * LIMIT)
    assert "this drive hardly shows it: record again, straight on, in wide" in hidden
    (hair,) = failures("wheels", 1.000001 * LIMIT)
    assert "record about 1.1 times as long, straight on, in wide and narrow curves" in hair


@pytest.mark.parametrize("kind", ["wheels", "lidar", "detection", "joint"])
def test_what_is_not_observable_says_how_to_record(kind: str) -> None:
    for sigma in (math.inf, math.nan):
        (said,) = failures(kind, sigma)
        assert "not observable in this drive: record again, " in said
        assert "both ways" in said


def test_halves_that_disagree_say_what_may_be_loose() -> None:
    (said,) = failures("wheels", 0.5 * LIMIT, (0.0, 9.0 * LIMIT))
    assert "see that nothing is loose, slips or is pushed, and record again" in said
    assert not failures("wheels", 0.5 * LIMIT, (0.0, LIMIT))
