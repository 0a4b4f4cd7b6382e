"""Views of teammates, seen or missed → detection probability by distance, with its uncertainty.

The curve is eq. 19 and 30 of Perera 2021 in their common form: p(r) = most / (1 + exp(k (r - h))).
It is fitted by maximum likelihood. What is seen now is mostly seen a moment later too, so the
covariance is a sandwich over blocks of time of one teammate.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from host.calibration.robust.statistics import (
    bent_factor,
    block_sums,
    blocks_of,
    ratio_variance,
    sandwich,
)
from host.messages import BoolArray, FloatArray, IntArray

BLOCK_S = 5.0  # views of one teammate so near in time count as one piece of evidence
_SIDE_VIEWS, _SIDE_BLOCKS = 20, 2  # needed on both sides of the half-range to fit it
_LEAST_P = 1e-6
# A weak prior worth one observation: of what is not observable. See `_cost`.
_STEEPNESS, _STEEPNESS_SPREAD = 5.0, 1.0  # 1/m, and how far off its logarithm may be
_BOUNDS = ((-6.0, 7.0), (0.1, 11.9), (math.log(0.3), math.log(90.0)))
_STARTS_M = (1.0, 3.0)


@dataclass(frozen=True, slots=True)
class Views:
    """When a teammate stood in plain view of a sensor, and whether the sensor saw it.

    All (n,): times s, teammates (numbers), distances m, bearings rad (robot frame), seen. caught
    (n,): the share of true readings that lie near enough to be taken for it; mistaken (n,): how
    likely something false does.
    """

    times: FloatArray
    teammates: IntArray
    distances: FloatArray
    bearings: FloatArray
    seen: BoolArray
    caught: FloatArray
    mistaken: FloatArray

    def __len__(self) -> int:
        return len(self.times)

    def part(self, chosen: BoolArray) -> "Views":
        """The views that are chosen (n,)."""
        columns = (getattr(self, each.name)[chosen] for each in dataclasses.fields(self))
        return Views(*columns)

    @property
    def blocks(self) -> IntArray:
        """Which piece of evidence each view belongs to (n,), from 0 on without gaps."""
        return blocks_of(self.times, BLOCK_S, self.teammates)


@dataclass(frozen=True, slots=True)
class RangeCurve:
    """A fitted curve. values (3,): most, half-range (m), steepness (1/m), covariance (3, 3).

    reached: there are views enough beyond the half-range to fit it. Where not, half-range and
    steepness are those that were configured, with nan for their variances, unless the views go
    beyond that half-range and so speak against it. reach_m: how far the views go.
    """

    values: FloatArray
    covariance: FloatArray
    reached: bool
    reach_m: float

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations (3,) of the values."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    def at(self, distances: FloatArray) -> FloatArray:
        """Detection probability (n,) at distances (n,) m."""
        most, half, steepness = self.values
        return np.asarray(most * _share(distances, half, steepness))


def _share(distances: FloatArray, half: float, steepness: float) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(steepness * (distances - half), -50.0, 50.0))))


def fit_curve(views: Views, configured: tuple[float, float]) -> RangeCurve:
    """Fit the curve to views, at least one. configured: half-range (m) and steepness (1/m)."""
    reach = float(np.quantile(views.distances, 0.98))
    blocks = views.blocks
    starts = (np.array([2.0, half, math.log(_STEEPNESS)]) for half in _STARTS_M)
    fits = [_best(views, 1.0, start) for start in starts]
    parameters = min(fits, key=lambda fit: _cost(views, 1.0, fit)[0])
    repeats = _repeats(views, parameters, blocks)
    parameters = _best(views, repeats, parameters)
    half = parameters[1]
    beyond = views.distances > half
    reached = all(
        side.sum() >= _SIDE_VIEWS and len(np.unique(blocks[side])) >= _SIDE_BLOCKS
        for side in (beyond, ~beyond)
    )
    if reached or configured[0] <= reach:
        most, steepness = _logistic(parameters[0]), math.exp(parameters[2])
        slopes = np.diag([most * (1.0 - most), 1.0, steepness])
        covariance = slopes @ _covariance(views, parameters, blocks, repeats) @ slopes
        return RangeCurve(np.array([most, half, steepness]), covariance, reached, reach)
    return _only_most(views, configured, reach)


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x))


def _best(views: Views, repeats: float, start: FloatArray) -> FloatArray:
    """The likeliest parameters: logit of most, half-range, log of steepness.

    repeats: correlated views per independent one; the prior is worth one independent view.
    """
    found = minimize(
        lambda parameters: _cost(views, repeats, parameters),
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=_BOUNDS,
        options={"ftol": 1e-15, "gtol": 1e-8, "maxiter": 500},
    )
    return np.asarray(found.x)


def _cost(views: Views, repeats: float, parameters: FloatArray) -> tuple[float, FloatArray]:
    """The negative logarithm of the posterior, and its derivatives (3,)."""
    probability = _probability(views, parameters)
    chosen = np.where(views.seen, probability, 1.0 - probability)
    odd = (parameters[2] - math.log(_STEEPNESS)) / _STEEPNESS_SPREAD
    most = _logistic(parameters[0])
    prior = 0.5 * odd**2 - 0.5 * math.log(most * (1.0 - most))
    slope = np.array([most - 0.5, 0.0, odd / _STEEPNESS_SPREAD])
    scores, _ = _scores(views, parameters)
    return prior - np.log(chosen).sum() / repeats, slope - scores.sum(axis=0) / repeats


def _curvature(parameters: FloatArray) -> FloatArray:
    """Second derivatives (3, 3) of the prior's cost."""
    most = _logistic(parameters[0])
    return np.diag([most * (1.0 - most), 0.0, 1.0 / _STEEPNESS_SPREAD**2])


def _repeats(views: Views, parameters: FloatArray, blocks: IntArray) -> float:
    """Correlated views per independent one."""
    probability = _probability(views, parameters)
    off = (views.seen - probability) / np.sqrt(probability * (1.0 - probability))
    return max(1.0, float(np.sum(block_sums(off, blocks) ** 2) / np.sum(off**2)))


def _probability(views: Views, parameters: FloatArray) -> FloatArray:
    """How likely each view (n,) is to be one of something seen, be it a false reading."""
    share = _share(views.distances, parameters[1], math.exp(parameters[2]))
    missed = (1.0 - views.caught * _logistic(parameters[0]) * share) * (1.0 - views.mistaken)
    return np.clip(1.0 - missed, _LEAST_P, 1.0 - _LEAST_P)


def _scores(views: Views, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of each view's log-likelihood (n, 3), and the expected information (3, 3)."""
    most, steepness = _logistic(parameters[0]), math.exp(parameters[2])
    excess = views.distances - parameters[1]
    share = _share(views.distances, parameters[1], steepness)
    fall = most * share * (1.0 - share)
    slopes = np.stack((most * (1.0 - most) * share, steepness * fall, -steepness * excess * fall))
    slopes = (slopes * views.caught * (1.0 - views.mistaken)).T
    probability = _probability(views, parameters)
    variance = probability * (1.0 - probability)
    scores = slopes * ((views.seen - probability) / variance)[:, None]
    return scores, np.asarray(slopes.T @ (slopes / variance[:, None]))


def _covariance(
    views: Views, parameters: FloatArray, blocks: IntArray, repeats: float
) -> FloatArray:
    """Covariance (3, 3) of the parameters: the sandwich, and no less than views by themselves.

    Where hardly anything was missed close by, scores are nearly all 0 and say too little.
    """
    scores, information = _scores(views, parameters)
    sums = block_sums(scores, blocks)
    information = information + repeats * _curvature(parameters)
    inverse = np.asarray(np.linalg.pinv(information, hermitian=True), dtype=float)
    found = sandwich(inverse, bent_factor(len(sums), 1) * sums.T @ sums)
    least = repeats * np.diagonal(inverse)
    grown = np.sqrt(np.maximum(least / np.maximum(np.diagonal(found), 1e-12), 1.0))
    return np.asarray(found * np.outer(grown, grown))


def _only_most(views: Views, configured: tuple[float, float], reach: float) -> RangeCurve:
    """The greatest probability alone, where the fall with distance is out of the views' reach."""
    half, steepness = configured
    share = _share(views.distances, half, steepness)
    true = views.seen - views.mistaken  # each on average caught * most * share
    expected = views.caught * share * (1.0 - views.mistaken)
    most = float(np.clip(true.sum() / expected.sum(), 1e-3, 1.0 - 0.5 / (len(views) + 1.0)))
    # Not one miss in n blocks does not mean that there are none.
    variance = ratio_variance(true, expected, most, views.blocks) + (0.5 / len(views)) ** 2
    covariance = np.full((3, 3), math.nan)
    covariance[0, 0] = variance
    return RangeCurve(np.array([most, half, steepness]), covariance, False, reach)
