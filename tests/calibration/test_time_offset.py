"""The delay of a sensor: the scan's curve, and what it can tell."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.calibration.time_offset import scan


@given(st.floats(-0.3, 0.8), st.floats(0.1, 100.0))
def test_the_best_delay_of_a_parabola_is_exact(delay: float, bend: float) -> None:
    curve = scan(lambda d: bend * (d - delay) ** 2 + 1.0, -0.5, 1.0, 0.02)
    assert curve.best == pytest.approx(delay, abs=1e-6)


@given(st.floats(-0.3, 0.8), st.floats(0.001, 0.1))
def test_the_interval_holds_all_that_is_not_sure_to_be_worse(delay: float, half: float) -> None:
    curve = scan(lambda d: (d - delay) ** 2, -0.5, 1.0, 0.02)
    low, high = curve.interval(half**2)
    assert delay - half - 0.031 <= low <= delay - half
    assert delay + half <= high <= delay + half + 0.031


def test_a_flat_curve_has_an_interval_as_wide_as_the_scan() -> None:
    curve = scan(lambda d: 1.0 + 0.001 * np.sin(40.0 * d), -0.5, 1.0, 0.02)
    assert curve.interval(0.01) == (-0.5, 1.0)


def test_a_second_dip_as_deep_widens_the_interval() -> None:
    curve = scan(lambda d: min((d - 0.1) ** 2, (d - 0.6) ** 2 + 1e-4), -0.5, 1.0, 0.02)
    low, high = curve.interval(1e-3)
    assert low < 0.1
    assert high > 0.6


def test_a_scan_covers_both_ends() -> None:
    curve = scan(abs, -0.2, 0.3, 0.05)
    np.testing.assert_allclose(curve.delays, np.linspace(-0.2, 0.3, 11), atol=1e-12)
    assert curve.best == pytest.approx(0.0, abs=1e-9)


def test_a_least_cost_at_the_end_of_the_scan_is_taken_as_it_is() -> None:
    curve = scan(lambda d: -d, 0.0, 0.5, 0.1)
    assert curve.best == pytest.approx(0.5)
    assert curve.interval(0.15) == (pytest.approx(0.3), pytest.approx(0.5))
