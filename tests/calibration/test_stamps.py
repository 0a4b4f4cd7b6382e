"""Stamps that are late at random, and those that only have holes."""

import numpy as np
import pytest

from host.calibration.stamps import (
    delay_check,
    lateness,
    rounding_step,
    rounding_warnings,
    stamps_check,
)

REGULAR = np.arange(6000) * 0.01


def exponential(mean_s, seed=0):
    return REGULAR + np.random.default_rng(seed).exponential(mean_s, len(REGULAR))


@pytest.mark.parametrize("mean_s", [0.005, 0.01, 0.02])
def test_the_mean_of_exponential_latenesses_is_found(mean_s):
    assert lateness(exponential(mean_s)) == pytest.approx(mean_s, rel=0.15)


def test_late_stamps_fail_also_where_they_came_in_order():
    for times in (
        exponential(0.02),
        np.sort(exponential(0.02)),
        np.maximum.accumulate(exponential(0.02)),
    ):
        check = stamps_check([times])
        assert not check.passed
        assert "late on average" in check.advice


@pytest.mark.parametrize("rate_hz", [10.0, 30.0, 120.0, 240.0])
def test_frames_that_are_lost_or_a_little_irregular_pass(rate_hz):
    random = np.random.default_rng(1)
    times = np.arange(3000) / rate_hz
    kept = times[random.random(len(times)) > 0.1]
    kept = kept[(kept < 5.0) | (kept > 8.0)] + random.normal(
        0.0, 5e-4, np.count_nonzero((kept < 5.0) | (kept > 8.0))
    )
    assert stamps_check([kept]).passed
    assert stamps_check([np.zeros(0)]).passed


@pytest.mark.parametrize("rate_hz", [10.0, 60.0, 120.0])
@pytest.mark.parametrize("kept", ["at random", "two of three", "written in ms"])
def test_a_constant_rate_with_lost_frames_is_regular(rate_hz, kept):
    times = np.arange(2000) / rate_hz
    chosen = {
        "at random": np.random.default_rng(2).random(2000) > 0.4,
        "two of three": np.arange(2000) % 3 != 1,
        "written in ms": np.full(2000, True),
    }[kept]
    times = np.round(times, 3) if kept == "written in ms" else times
    assert stamps_check([times[chosen]]).passed


@pytest.mark.parametrize("rate_hz", [60.0, 120.0, 240.0])
def test_frames_that_come_in_bursts_fail(rate_hz):
    number = np.arange(2000)
    times = (number + (-number) % 5) / rate_hz + 1e-4 * (number % 5)
    assert not stamps_check([np.unique(times)]).passed
    late = np.sort(number / rate_hz + np.random.default_rng(3).exponential(0.02, 2000))
    assert not stamps_check([late]).passed


@pytest.mark.parametrize(
    ("delay", "sigma", "passes"),
    [
        (0.08, 0.001, True),
        (-0.001, 0.001, True),
        (-0.016, 0.0016, False),
        (-0.1, float("nan"), False),
    ],
)
def test_a_negative_delay_is_refused(delay, sigma, passes):
    assert delay_check("delay", delay, sigma).passed is passes


@pytest.mark.parametrize(
    ("rate_hz", "step_s"), [(120, 0.01), (60, 0.01), (200, 0.01), (120, 0.005)]
)
@pytest.mark.parametrize("rounded", [np.round, np.floor])
@pytest.mark.parametrize("lost", [0.0, 0.02])
def test_stamps_that_were_rounded_are_named_with_their_step(rate_hz, step_s, rounded, lost):
    kept = np.random.default_rng(4).random(3000) >= lost
    times = rounded((0.0031 + np.arange(3000) / rate_hz) / step_s)[kept] * step_s
    assert rounding_step(times) == pytest.approx(step_s)
    (words,) = rounding_warnings([times])
    assert f"steps of {1e3 * step_s:g} ms, as if rounded" in words
    check = stamps_check([times])
    assert check.passed or check.advice == words


@pytest.mark.parametrize("rate_hz", [10.0, 30.0, 60.0, 100.0, 120.0, 240.0])
@pytest.mark.parametrize("lost", [0.0, 0.02, 0.1, 0.4, 0.5, 0.7])
@pytest.mark.parametrize("jitter_s", [0.0, 1e-6, 3e-4])
def test_frames_at_a_constant_rate_lost_or_not_are_not_rounded(rate_hz, lost, jitter_s):
    random, number = np.random.default_rng(5), np.arange(3000)
    for kept in (random.random(3000) >= lost, number % 3 != 1, number % 7 != 1):
        times = number[kept] / rate_hz
        assert not rounding_warnings([times + random.normal(0.0, jitter_s, len(times))])
        assert not rounding_warnings([np.round(times, 3)])
    two_rates = np.cumsum(np.repeat([1.0, 2.0, 1.0], [100, 2000, 100]) / rate_hz)
    assert not rounding_warnings([np.zeros(0), np.zeros(100), two_rates])
