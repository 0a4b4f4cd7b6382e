import math
from datetime import datetime

import numpy as np
import pytest
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.updater.kalman import KalmanUpdater

from host.estimator.clairvoyant import Clairvoyant, predict_positions
from host.messages import Bearings, Displacement, Positions


def reading(time, point, covariance, identity=1, lag=None):
    lags = None if lag is None else np.array([lag])
    return Positions(
        time, np.array([point]), np.array([covariance]), lags, identities=np.array([identity])
    )


def pointing(time, bearing, variance, identity=1, origin=(0.0, 0.0), lag=0.0):
    return Bearings(
        time, np.array([bearing]), np.array([variance]), origin, lag, np.array([identity])
    )


PRIOR = np.array([[0.04, 0.01], [0.01, 0.02]])
NOISE = np.array([[0.09, -0.02], [-0.02, 0.03]])


def test_a_position_update_equals_stone_soups_kalman_updater():
    clairvoyant = Clairvoyant()
    clairvoyant.update(reading(0.0, [1.0, 2.0], PRIOR))
    clairvoyant.update(reading(0.0, [1.3, 1.8], NOISE))
    now = datetime(2020, 1, 1)
    model = LinearGaussian(2, (0, 1), NOISE)
    prior = GaussianStatePrediction(np.array([[1.0], [2.0]]), PRIOR, timestamp=now)
    detection = Detection(np.array([[1.3], [1.8]]), timestamp=now, measurement_model=model)
    posterior = KalmanUpdater(model).update(SingleHypothesis(prior, detection))
    found = clairvoyant.estimate()
    assert found.positions[0] == pytest.approx(np.ravel(posterior.mean), abs=1e-12)
    assert found.covariances[0] == pytest.approx(np.asarray(posterior.covar), abs=1e-12)


def test_a_lag_adds_the_teammates_own_motion_to_the_noise():
    late, noisy = Clairvoyant(process_noise=0.02), Clairvoyant(process_noise=0.02)
    for clairvoyant in (late, noisy):
        clairvoyant.update(reading(0.0, [1.0, 2.0], PRIOR))
    late.update(reading(0.0, [1.3, 1.8], NOISE, lag=0.5))
    noisy.update(reading(0.0, [1.3, 1.8], NOISE + 0.01 * np.eye(2)))
    assert late.estimate().covariances == pytest.approx(noisy.estimate().covariances)


@pytest.mark.parametrize("origin", [(0.0, 0.0), (0.3, -0.1)])
def test_a_bearing_update_equals_the_information_form_with_a_numerical_jacobian(origin):
    place, bearing, variance = np.array([-1.0, 0.05]), -math.pi + 0.02, 0.01
    clairvoyant = Clairvoyant()
    clairvoyant.update(reading(0.0, place, PRIOR))
    clairvoyant.update(pointing(0.0, bearing, variance, origin=origin))

    def direction(point):
        return math.atan2(point[1] - origin[1], point[0] - origin[0])

    step = 1e-6
    jacobian = np.array(
        [
            (direction(place + step * axis) - direction(place - step * axis)) / (2 * step)
            for axis in np.eye(2)
        ]
    )
    residual = bearing - direction(place)
    residual -= 2 * math.pi * round(residual / (2 * math.pi))
    information = np.linalg.inv(PRIOR) + np.outer(jacobian, jacobian) / variance
    covariance = np.linalg.inv(information)
    found = clairvoyant.estimate()
    assert found.covariances[0] == pytest.approx(covariance, rel=1e-6)
    assert found.positions[0] == pytest.approx(
        place + covariance @ jacobian * residual / variance, rel=1e-6
    )


def test_carry_agrees_with_drawn_odometry():
    """Mean and covariance against a cloud pushed through the true, noisy motion."""
    generator = np.random.default_rng(8)
    motion = Displacement(1.0, 0.5, 0.2, -0.1, 0.7, 0.004, 0.0009)
    count = 200_000
    cloud = generator.multivariate_normal([2.0, 1.0], PRIOR, count)
    cloud += generator.normal(0.0, math.sqrt(0.01 * 0.5), (count, 2))
    moved = cloud - [0.2, -0.1] - generator.normal(0.0, math.sqrt(0.004), (count, 2))
    turned = -0.7 + generator.normal(0.0, 0.03, count)
    x = np.cos(turned) * moved[:, 0] - np.sin(turned) * moved[:, 1]
    y = np.sin(turned) * moved[:, 0] + np.cos(turned) * moved[:, 1]
    positions, covariances = predict_positions(np.array([[2.0, 1.0]]), PRIOR[None], motion, 0.01)
    assert positions[0] == pytest.approx([x.mean(), y.mean()], abs=3e-3)
    assert covariances[0] == pytest.approx(np.cov(x, y), abs=1e-3)


def test_a_step_in_two_pieces_is_the_same_step():
    whole, pieces = Clairvoyant(), Clairvoyant()
    for clairvoyant in (whole, pieces):
        clairvoyant.update(reading(0.0, [1.0, 2.0], PRIOR))
    whole.predict(Displacement(1.0, 1.0, 0.0, 0.0, 0.6, 0.01, 0.02))
    for time in (0.5, 1.0):
        pieces.predict(Displacement(time, 0.5, 0.0, 0.0, 0.3, 0.005, 0.01))
    one, two = whole.estimate(), pieces.estimate()
    assert two.positions == pytest.approx(one.positions, abs=1e-12)
    assert two.covariances == pytest.approx(one.covariances, abs=1e-12)
    assert two.ages == pytest.approx(one.ages)


def test_a_bearing_alone_starts_nobody():
    clairvoyant = Clairvoyant()
    clairvoyant.update(pointing(0.0, math.pi / 2, 0.01, origin=(0.1, 0.0)))
    assert len(clairvoyant.estimate().positions) == 0


def test_only_readings_with_an_identity_count_and_the_unseen_are_forgotten():
    clairvoyant = Clairvoyant(forget_s=2.0)
    clairvoyant.update(reading(0.0, [1.0, 0.0], PRIOR, identity=-1))
    assert len(clairvoyant.estimate().positions) == 0
    clairvoyant.update(reading(0.0, [1.0, 0.0], PRIOR, identity=4))
    clairvoyant.predict(Displacement(1.5, 1.5, 0.0, 0.0, 0.0))
    clairvoyant.update(reading(1.5, [0.0, 1.0], PRIOR, identity=2))
    assert clairvoyant.estimate().labels.tolist() == [4, 2]
    clairvoyant.predict(Displacement(2.1, 0.6, 0.0, 0.0, 0.0))
    found = clairvoyant.estimate()
    assert found.labels.tolist() == [2]
    assert found.ages == pytest.approx([0.6])
    assert found.time == 2.1


def test_without_identities_it_says_so():
    with pytest.raises(ValueError, match="identity"):
        Clairvoyant().update(Positions(0.0, np.zeros((1, 2)), np.eye(2)[None]))
