"""Curves of detection by range, from views that are drawn from a known one."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import minimize

from host.calibration.detection.range_curve import RangeCurve, Views, fit_curve
from host.messages import FloatArray

MOST, HALF_M, STEEPNESS = 0.9, 3.0, 5.0
CONFIGURED = (3.2, 6.0)


def chance(distances: FloatArray) -> FloatArray:
    """The curve, by the hyperbolic tangent."""
    return np.asarray(0.5 * MOST * (1.0 + np.tanh(0.5 * STEEPNESS * (HALF_M - distances))))


def views(
    random: np.random.Generator,
    count: int = 1200,
    farthest: float = 4.5,
    mistaken: float = 0.0,
    caught: float = 1.0,
    sticky: int = 1,
) -> Views:
    """Of 3 teammates over 2 minutes; `sticky` views in a row share one throw of the dice."""
    distances = np.repeat(random.uniform(0.4, farthest, count // sticky), sticky)
    luck = np.repeat(random.random(len(distances) // sticky), sticky)
    wrong = random.random(len(distances)) < mistaken
    return Views(
        times=np.linspace(0.0, 120.0, len(distances)),
        teammates=np.full(len(distances), 2),
        distances=distances,
        bearings=np.zeros(len(distances)),
        seen=(luck < caught * chance(distances)) | wrong,
        caught=np.full(len(distances), caught),
        mistaken=np.full(len(distances), mistaken),
    )


def errors(curve: RangeCurve) -> FloatArray:
    return np.asarray((curve.values - (MOST, HALF_M, STEEPNESS)) / curve.sigmas)


def test_a_known_curve_is_found_to_its_own_sigmas() -> None:
    curve = fit_curve(views(np.random.default_rng(1)), CONFIGURED)
    assert curve.reached
    assert np.abs(errors(curve)).max() < 3.5
    assert curve.sigmas[1] < 0.04
    assert curve.at(np.array([HALF_M]))[0] == pytest.approx(0.5 * MOST, abs=0.06)


@pytest.mark.parametrize("sticky", [1, 10])
def test_sigmas_are_honest_also_where_views_in_a_row_say_the_same(sticky: int) -> None:
    z = [
        errors(fit_curve(views(np.random.default_rng([7, k]), sticky=sticky), CONFIGURED))
        for k in range(80)
    ]
    spread = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all((spread > 0.8) & (spread < 1.25)), spread


@pytest.mark.parametrize("count", [40, 400])
def test_the_likeliest_curve_has_a_prior_worth_one_observation(count: int) -> None:
    """The same maximum by scipy, from the formulas: one view each of so many teammates.

    Independent views: log-likelihood, less (log k - log 5)² / 2, plus log(p (1 - p)) / 2 of the
    probability close by.
    """
    drawn = views(np.random.default_rng([8, count]), count=count)
    alone = dataclasses.replace(drawn, teammates=np.arange(count))

    def surprise(x: FloatArray) -> float:
        most, steepness = 1.0 / (1.0 + math.exp(-x[0])), math.exp(x[2])
        p = most / (1.0 + np.exp(steepness * (alone.distances - x[1])))
        seen = np.where(alone.seen, np.log(p), np.log1p(-p)).sum()
        return float(0.5 * (x[2] - math.log(5.0)) ** 2 - 0.5 * math.log(most * (1 - most)) - seen)

    best = minimize(surprise, np.array([2.0, 3.0, 1.6]), method="Nelder-Mead", tol=1e-9).x
    expected = 1.0 / (1.0 + math.exp(-best[0])), best[1], math.exp(best[2])
    assert fit_curve(alone, CONFIGURED).values == pytest.approx(expected, rel=1e-3)


def test_false_readings_and_missed_gates_are_accounted_for() -> None:
    """One view in five would be taken for seen anyway: a plain count would say 0.92 and far."""
    drawn = views(np.random.default_rng(2), count=4000, mistaken=0.2, caught=0.95)
    curve = fit_curve(drawn, CONFIGURED)
    assert np.abs(errors(curve)).max() < 3.5


def test_a_half_range_beyond_the_views_is_not_told() -> None:
    curve = fit_curve(views(np.random.default_rng(3), farthest=2.0), CONFIGURED)
    assert not curve.reached
    assert curve.values[1:] == pytest.approx(CONFIGURED)
    assert np.isnan(curve.sigmas[1:]).all()
    assert curve.reach_m == pytest.approx(2.0, abs=0.1)
    assert abs(curve.values[0] - MOST) < 4.0 * curve.sigmas[0]


def test_a_fall_that_is_barely_in_view_is_not_told_either() -> None:
    drawn = views(np.random.default_rng(4), farthest=3.0)
    assert not fit_curve(drawn, CONFIGURED).reached


def test_views_without_a_miss_do_not_make_detection_certain() -> None:
    drawn = views(np.random.default_rng(5), count=60, farthest=1.0)
    sure = drawn.part(drawn.seen)
    curve = fit_curve(sure, CONFIGURED)
    assert 0.9 < curve.values[0] < 1.0
    assert 0.0 < curve.sigmas[0] < 0.1


def test_one_view_gives_a_curve_without_an_error() -> None:
    drawn = views(np.random.default_rng(6), count=4)
    for k in range(4):
        curve = fit_curve(drawn.part(np.arange(4) == k), CONFIGURED)
        assert 0.0 < curve.values[0] < 1.0
        assert math.isfinite(curve.reach_m)
