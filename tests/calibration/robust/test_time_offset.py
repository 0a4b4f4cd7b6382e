"""The delay of a sensor: the scan's curve, and the fit together with the mounting."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.calibration.robust.time_offset import fit_jointly, scan
from host.errors import UserError
from host.messages import FloatArray


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


def wander(times: FloatArray) -> FloatArray:
    """A teammate's path in the robot frame, all around and at changing speed: (k, 2) m."""
    angle = 2.0 * np.sin(0.7 * times) + 3.0 * np.sin(0.31 * times + 1.0)
    reach = 1.2 + 0.5 * np.sin(1.1 * times)
    return np.stack((reach * np.cos(angle), reach * np.sin(angle)), axis=1)


def readings(
    values: FloatArray, times: FloatArray, noise_m: float, random: np.random.Generator
) -> FloatArray:
    """What a sensor mounted and late as `values` (5,) say makes of `wander`: (n, 2) m."""
    x, y, heading, delay, too_far = values
    offset = wander(times - delay) - np.array([x, y])
    seen = (offset[:, 0] + 1j * offset[:, 1]) * np.exp(-1j * heading)
    seen *= 1.0 + too_far / np.abs(seen)
    return np.stack((seen.real, seen.imag), axis=1) + random.normal(0.0, noise_m, (len(seen), 2))


@given(
    st.tuples(
        st.floats(-0.2, 0.2),
        st.floats(-0.2, 0.2),
        st.floats(-3.0, 3.0),
        st.floats(-0.3, 0.5),
        st.floats(-0.02, 0.02),
    )
)
@settings(max_examples=30)
def test_exact_readings_give_back_mounting_and_delay(values: tuple[float, ...]) -> None:
    true = np.array(values)
    times = np.arange(0.0, 40.0, 0.15)
    points = readings(true, times, 0.0, np.random.default_rng(0))
    start = true + np.array([0.01, -0.01, 0.03, 0.02, 0.0])
    found = fit_jointly(points, times, np.ones(len(times)), wander, start)
    np.testing.assert_allclose(found.values, true, atol=1e-6)


def test_wrong_readings_weigh_nothing_and_sigmas_are_those_of_repeated_fits() -> None:
    random = np.random.default_rng(2)
    true = np.array([0.01, -0.02, 0.05, 0.08, 0.004])
    times = np.arange(0.0, 90.0, 0.15)
    normalised = []
    for _ in range(60):
        points = readings(true, times, 0.004, random)
        wrong = random.random(len(times)) < 0.2
        points[wrong] += random.uniform(-0.5, 0.5, (int(wrong.sum()), 2))
        sigmas = np.full(len(times), random.uniform(0.1, 10.0))  # up to a common factor
        found = fit_jointly(points, times, sigmas, wander, true + 0.003)
        assert np.median(found.weights[~wrong]) > 0.8
        assert np.mean(found.weights[wrong]) < 0.05
        miss = found.values - true
        normalised.append(miss @ np.linalg.solve(found.covariance, miss) / len(true))
    assert 0.8 < math.sqrt(np.mean(normalised)) < 1.25


def test_errors_that_last_for_a_second_count_as_few() -> None:
    random = np.random.default_rng(4)
    true = np.array([0.0, 0.0, 0.0, 0.05, 0.0])
    times = np.arange(0.0, 90.0, 0.1)
    normalised = []
    for _ in range(60):
        lasting = np.repeat(random.normal(0.0, 0.01, (len(times) // 10, 2)), 10, axis=0)
        points = readings(true, times, 0.001, random) + lasting
        found = fit_jointly(points, times, np.ones(len(times)), wander, true)
        normalised.append(((found.values - true) ** 2 / np.diag(found.covariance)).mean())
    assert 0.8 < math.sqrt(np.mean(normalised)) < 1.25


def test_readings_without_a_truth_are_left_out() -> None:
    true = np.array([0.02, 0.01, 0.1, 0.06, 0.0])
    times = np.arange(0.0, 60.0, 0.15)
    points = readings(true, times, 0.0, np.random.default_rng(0))

    def patchy(then: FloatArray) -> FloatArray:
        return np.where((then % 10.0 > 5.0)[:, None], wander(then), np.nan)

    found = fit_jointly(points, times, np.ones(len(times)), patchy, true + 0.005)
    np.testing.assert_allclose(found.values, true, atol=1e-5)
    unknown = np.isnan(found.errors).any(axis=1)
    assert 0.4 < np.mean(unknown) < 0.6
    assert not found.weights[unknown].any()


def test_a_teammate_that_stands_before_a_robot_that_stands_tells_nothing() -> None:
    def still(then: FloatArray) -> FloatArray:
        return np.tile((1.0, 0.5), (len(then), 1))

    times = np.arange(0.0, 30.0, 0.15)
    points = still(times) + np.random.default_rng(1).normal(0.0, 0.003, (len(times), 2))
    found = fit_jointly(points, times, np.ones(len(times)), still, np.zeros(5))
    assert np.isinf(np.diag(found.covariance)).all()
    assert np.isfinite(found.values).all()


def test_too_few_readings_are_refused() -> None:
    times = np.arange(10.0)
    with pytest.raises(UserError, match="too few readings"):
        fit_jointly(wander(times), times, np.ones(10), wander, np.zeros(5))


@pytest.mark.parametrize(
    ("low", "high", "step"), [(1.0, 0.0, 0.1), (0.0, 1.0, 0.0), (math.nan, 1.0, 0.1)]
)
def test_a_scan_over_no_delays_is_refused(low: float, high: float, step: float) -> None:
    with pytest.raises(ValueError, match="no delays from"):
        scan(abs, low, high, step)


def test_what_can_be_no_readings_is_refused_in_words() -> None:
    with pytest.raises(ValueError, match="costs are finite but row 0 is nan"):
        scan(lambda delay: math.nan if delay < 0.3 else delay, 0.0, 1.0, 0.1)
    points, ones = np.ones((20, 2)), np.ones(20)
    for name, change in (("points", 0), ("times", 1), ("sigmas", 2)):
        arrays = [points, ones, ones]
        for wrong in (math.nan, math.inf, *[0.0, -1.0] * (name == "sigmas")):
            arrays[change] = np.concatenate(([wrong], arrays[change].ravel()[1:])).reshape(
                arrays[change].shape
            )
            with pytest.raises(ValueError, match=f"{name} are finite.* but row 0"):
                fit_jointly(*arrays, lambda times: points, np.zeros(5))
