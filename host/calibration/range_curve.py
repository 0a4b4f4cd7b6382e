"""Views of teammates, seen or missed → detection probability by distance, with its uncertainty.

The curve is eq. 19 and 30 of Perera 2021 in their common form: p(r) = most / (1 + exp(k (r - h))).
It is fitted by maximum likelihood. What is seen now is mostly seen a moment later too, so the
covariance sums the scores of whole seconds of one teammate (the "sandwich" of robust statistics).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from host.messages import BoolArray, FloatArray, IntArray

BLOCK_S = 5.0  # views of one teammate so near in time count as one piece of evidence
_BEYOND_VIEWS, _BEYOND_BLOCKS = 30, 3  # needed beyond the half-range, to tell it
_LEAST_P = 1e-6
# A guess worth one view keeps what the data leave open from running away.
_STEEPNESS, _STEEPNESS_SPREAD = 5.0, 1.0  # 1/m, and how far off its logarithm may be
_BOUNDS = ((-6.0, 7.0), (0.1, 11.9), (math.log(0.3), math.log(90.0)))
_STARTS_M = (0.8, 1.5, 2.5, 4.0)


@dataclass(frozen=True, slots=True)
class Views:
    """When a teammate stood in plain view of a sensor, and whether the sensor told of it.

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
        return Views(
            self.times[chosen],
            self.teammates[chosen],
            self.distances[chosen],
            self.bearings[chosen],
            self.seen[chosen],
            self.caught[chosen],
            self.mistaken[chosen],
        )

    @property
    def blocks(self) -> IntArray:
        """Which piece of evidence each view belongs to (n,), from 0 on without gaps."""
        pieces = np.stack((self.teammates, np.floor(self.times / BLOCK_S).astype(np.int64)))
        return np.unique(pieces, axis=1, return_inverse=True)[1].reshape(-1)


@dataclass(frozen=True, slots=True)
class RangeCurve:
    """A fitted curve. values (3,): most, half-range (m), steepness (1/m), covariance (3, 3).

    reached: there are views enough beyond the half-range. Where not, half-range and steepness are
    those that were configured, with nan for their variances. reach_m: how far the views go.
    """

    values: FloatArray
    covariance: FloatArray
    reached: bool
    reach_m: float

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations (3,) of the values."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    def at(self, distances: FloatArray) -> FloatArray:
        """Detection probability (n,) at distances (n,) m."""
        most, half, steepness = self.values
        return np.asarray(most * _share(distances, half, steepness))


def _share(distances: FloatArray, half: float, steepness: float) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(steepness * (distances - half), -50.0, 50.0))))


def fit_curve(views: Views, configured: tuple[float, float]) -> RangeCurve:
    """Fit the curve to views, at least one. configured: half-range (m) and steepness (1/m)."""
    reach = float(np.quantile(views.distances, 0.98))
    fits = [_descend(views, start) for start in _STARTS_M]
    parameters = min(fits, key=lambda fit: fit[1])[0]
    half = parameters[1]
    beyond = views.distances > half
    blocks = views.blocks
    if beyond.sum() >= _BEYOND_VIEWS and len(np.unique(blocks[beyond])) >= _BEYOND_BLOCKS:
        most, steepness = _logistic(parameters[0]), math.exp(parameters[2])
        slopes = np.diag([most * (1.0 - most), 1.0, steepness])
        covariance = slopes @ _sandwich(*_scores(views, parameters), blocks) @ slopes
        return RangeCurve(np.array([most, half, steepness]), covariance, True, reach)
    return _only_most(views, configured, reach)


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x))


def _descend(views: Views, start: float) -> tuple[FloatArray, float]:
    """The best parameters (logit of most, half-range, log of steepness) from one start."""

    def cost(parameters: FloatArray) -> tuple[float, FloatArray]:
        probability = _probability(views, parameters)
        odd = (parameters[2] - math.log(_STEEPNESS)) / _STEEPNESS_SPREAD
        most = _logistic(parameters[0])
        chosen = np.where(views.seen, probability, 1.0 - probability)
        value = -float(np.log(chosen).sum()) + 0.5 * odd**2 - 0.5 * math.log(most * (1.0 - most))
        slope = -_scores(views, parameters)[0].sum(axis=0)
        slope += (most - 0.5, 0.0, odd / _STEEPNESS_SPREAD)
        return value, slope

    found = minimize(
        cost,
        np.array([2.0, start, math.log(_STEEPNESS)]),
        jac=True,
        method="L-BFGS-B",
        bounds=_BOUNDS,
    )
    return np.asarray(found.x), float(found.fun)


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


def _sandwich(scores: FloatArray, information: FloatArray, blocks: IntArray) -> FloatArray:
    """Covariance of parameters from scores (n, k) that are correlated within blocks (n,)."""
    count = int(blocks.max()) + 1
    sums = np.stack([np.bincount(blocks, column, count) for column in scores.T], axis=1)
    inverse = np.linalg.pinv(information)
    few = count / max(count - 1.0, 1.0)
    return np.asarray(few * inverse @ (sums.T @ sums) @ inverse)


def _only_most(views: Views, configured: tuple[float, float], reach: float) -> RangeCurve:
    """The greatest probability alone, where the fall with distance is out of the views' reach."""
    half, steepness = configured
    share = _share(views.distances, half, steepness) if half > reach else np.ones(len(views))
    true = views.seen - views.mistaken  # each on average caught * most * share
    expected = views.caught * share * (1.0 - views.mistaken)
    most = float(np.clip(true.sum() / expected.sum(), 1e-3, 1.0 - 0.5 / (len(views) + 1.0)))
    blocks = views.blocks
    off = np.bincount(blocks, true - most * expected)
    # Not one miss in n blocks does not mean that there are none.
    variance = float((off**2).sum()) / expected.sum() ** 2 + (0.5 / len(views)) ** 2
    covariance = np.full((3, 3), math.nan)
    covariance[0, 0] = variance
    return RangeCurve(np.array([most, half, steepness]), covariance, False, reach)
