"""What the PHD filter makes of the scores of readings."""

import numpy as np
import pytest

from host.config import FilterSettings, Lidar
from host.estimator.gaussians.gaussian_mixture import WEIGHT, Y
from host.estimator.phd import PhdFilter
from host.messages import Displacement, Positions


def test_a_reading_that_looks_like_furniture_is_less_of_a_teammate() -> None:
    """The same two things, seen six times; one scores as a turret, the other as a chair leg."""
    filter_ = PhdFilter(FilterSettings(), Lidar())
    places, noise = np.array([[1.0, 0.3], [1.0, -0.7]]), np.tile(1e-5 * np.eye(2), (2, 1, 1))
    scores = np.array([5.0, -2.0])
    for step in range(6):
        time = 0.14 * (step + 1)
        filter_.predict(Displacement(time, 0.14, 0.0, 0.0, 0.0))
        filter_.update(Positions(time, places, noise, scores=scores))
    teammates, whole = filter_._things.teammates, filter_._things.whole
    of_turret = np.argmin(np.abs(whole[Y] - 0.3))
    of_leg = np.argmin(np.abs(whole[Y] + 0.7))
    share = teammates[WEIGHT] / whole[WEIGHT]
    assert share[of_leg] < 0.25 * share[of_turret]


def test_scores_above_what_is_plain_change_nothing() -> None:
    """So a post that looks like a turret, revolution by revolution, gains nothing by it."""
    places, noise = np.array([[1.0, 0.3]]), 1e-5 * np.eye(2)[None]
    weights = []
    for scores in (None, np.array([3.0]), np.array([12.0])):
        filter_ = PhdFilter(FilterSettings(), Lidar())
        filter_.update(Positions(0.0, places, noise, scores=scores))
        weights.append(filter_._things.weights)
    assert weights[0] == pytest.approx(weights[1])
    assert weights[0] == pytest.approx(weights[2])
