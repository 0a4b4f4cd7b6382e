import math
from datetime import datetime

import numpy as np
import pytest
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    OrnsteinUhlenbeck,
)
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.updater.kalman import KalmanUpdater

from host.estimator.clairvoyant import WANDERING, Clairvoyant
from host.estimator.motion_modes import MotionModes, MovingTeammates
from host.evaluation.metrics import Accumulator
from host.messages import Bearings, Displacement, Positions

ALWAYS = ((0.0,),)  # rates of switching of a single mode
DRIVING = MotionModes((0.03,), (2.0,), ALWAYS, (1.0,), speed_mps=0.3, drift=0.01)


def forever(modes=DRIVING):
    """A filter that forgets nobody."""
    return Clairvoyant(modes, most_variance=math.inf, forget_s=math.inf)


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


@pytest.mark.parametrize("dt", [0.01, 0.3, 20.0])
def test_a_moving_mode_is_stone_soups_ornstein_uhlenbeck_process(dt):
    modes = MotionModes((0.03,), (2.0,), ALWAYS, (1.0,), speed_mps=0.3, drift=0.0)
    # Stone Soup's noise coefficient is our power spectral density; each axis is position, velocity.
    along = OrnsteinUhlenbeck(0.03, 1.0 / 2.0)
    theirs = CombinedLinearGaussianTransitionModel([along, along])
    seconds = datetime(2020, 1, 2) - datetime(2020, 1, 1)
    interval = dt / 86400.0 * seconds
    ours = [0, 2, 1, 3]  # their order of the state by ours
    transition, noise = modes.dynamics(dt)
    assert transition[0] == pytest.approx(theirs.matrix(time_interval=interval)[np.ix_(ours, ours)])
    expected = np.asarray(theirs.covar(time_interval=interval))[np.ix_(ours, ours)]
    assert noise[0] == pytest.approx(expected, rel=1e-4, abs=1e-10)


def test_a_lagging_reading_shows_where_the_teammate_was():
    """As if the reading had come in time, before the teammate moved on at what is its velocity."""
    calm = MotionModes((1e-12,), (1e6,), ALWAYS, (1.0,), speed_mps=0.3, drift=0.0)
    late, timely = forever(calm), forever(calm)
    for clairvoyant in (late, timely):
        clairvoyant.update(reading(0.0, [1.0, 2.0], PRIOR))
    timely.predict(Displacement(1.0, 1.0, 0.0, 0.0, 0.0))
    timely.update(reading(1.0, [1.3, 1.8], NOISE))
    timely.predict(Displacement(1.4, 0.4, 0.0, 0.0, 0.0))
    late.predict(Displacement(1.4, 1.4, 0.0, 0.0, 0.0))
    late.update(reading(1.4, [1.3, 1.8], NOISE, lag=0.4))
    assert late.estimate().positions == pytest.approx(timely.estimate().positions, rel=1e-5)
    covariances = timely.estimate().covariances
    assert late.estimate().covariances == pytest.approx(covariances, rel=1e-4)


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
    velocity = generator.normal(0.0, 0.3, (count, 2))
    for _ in range(50):  # Euler steps of dv = -v dt / tau + noise
        cloud += 0.01 * velocity + generator.normal(0.0, math.sqrt(0.01 * 0.01), (count, 2))
        velocity *= 1.0 - 0.01 / 2.0
        velocity += generator.normal(0.0, math.sqrt(0.03 * 0.01), (count, 2))
    moved = cloud - [0.2, -0.1] - generator.normal(0.0, math.sqrt(0.004), (count, 2))
    turned = -0.7 + generator.normal(0.0, 0.03, count)
    x = np.cos(turned) * moved[:, 0] - np.sin(turned) * moved[:, 1]
    y = np.sin(turned) * moved[:, 0] + np.cos(turned) * moved[:, 1]
    clairvoyant = forever()
    clairvoyant.update(reading(0.5, [2.0, 1.0], PRIOR))
    clairvoyant.predict(motion)
    found = clairvoyant.estimate()
    assert found.positions[0] == pytest.approx([x.mean(), y.mean()], abs=3e-3)
    assert found.covariances[0] == pytest.approx(np.cov(x, y), abs=1e-3)


def test_a_step_in_two_pieces_is_the_same_step():
    whole, pieces = forever(), forever()
    for clairvoyant in (whole, pieces):
        clairvoyant.update(reading(0.0, [1.0, 2.0], PRIOR))
    whole.predict(Displacement(1.0, 1.0, 0.0, 0.0, 0.6, 0.01, 0.0))
    for time in (0.5, 1.0):
        pieces.predict(Displacement(time, 0.5, 0.0, 0.0, 0.3, 0.005, 0.0))
    one, two = whole.estimate(), pieces.estimate()
    assert two.positions == pytest.approx(one.positions, abs=1e-12)
    assert two.covariances == pytest.approx(one.covariances, abs=1e-12)
    assert two.ages == pytest.approx(one.ages)


def test_modes_switch_as_a_markov_chain_and_keep_the_moments():
    """Mixing changes neither mean nor covariance over all modes (IMM, step 1)."""
    random = np.random.default_rng(3)
    teammates = MovingTeammates(WANDERING)
    teammates.begin(np.array([1.0, 0.5]), PRIOR, 0.1)
    teammates.update(0, random.normal(0.0, 0.3, (3, 2)), np.tile(np.eye(2, 4), (3, 1, 1)), NOISE)
    before = teammates.moments()
    switching = WANDERING.switching(0.4)
    assert switching.sum(axis=1) == pytest.approx(np.ones(3))
    assert switching @ WANDERING.switching(0.6) == pytest.approx(WANDERING.switching(1.0))
    teammates._mix(switching)
    after = teammates.moments()
    assert after[0] == pytest.approx(before[0])
    assert after[1] == pytest.approx(before[1])


def test_it_follows_a_teammate_that_drives_and_stops_and_knows_how_well():
    """The velocity carries it between readings; standing, it settles below the readings' noise."""
    random = np.random.default_rng(11)
    clairvoyant, scored, errors = Clairvoyant(), Accumulator(), {True: [], False: []}
    place, dt = np.array([-3.0, 1.0]), 0.15
    for step in range(800):
        time, drives = dt * step, step // 40 % 2 == 0
        if drives:
            angle = 0.9 * (step // 80)
            place = place + 0.3 * dt * np.array([math.cos(angle), math.sin(angle)])
        clairvoyant.predict(Displacement(time, dt, 0.0, 0.0, 0.0))
        before = clairvoyant.estimate()
        if len(before.positions) and step % 40 > 10:
            errors[drives].append(np.hypot(*(before.positions[0] - place)))
        clairvoyant.update(reading(time, place + random.normal(0.0, 0.01, 2), 1e-4 * np.eye(2)))
        scored.add(place[None], np.zeros((0, 2)), clairvoyant.estimate())
    assert np.mean(errors[True]) < 0.4 * 0.3 * dt  # a random walk is behind by 0.3 dt
    assert np.mean(errors[False]) < 0.007
    # Under 1, as the true motion is calmer within a mode than the model allows.
    assert 0.5 < scored.row("", "", "", "").anees < 1.2


def test_a_bearing_alone_starts_nobody():
    clairvoyant = Clairvoyant()
    clairvoyant.update(pointing(0.0, math.pi / 2, 0.01, origin=(0.1, 0.0)))
    assert len(clairvoyant.estimate().positions) == 0


def test_only_readings_with_an_identity_count_and_the_unseen_are_forgotten():
    clairvoyant = Clairvoyant(most_variance=math.inf, forget_s=2.0)
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


def test_who_is_known_too_badly_is_forgotten():
    clairvoyant = Clairvoyant(most_variance=0.1)
    clairvoyant.update(reading(0.0, [1.0, 0.0], 1e-4 * np.eye(2)))
    clairvoyant.predict(Displacement(0.5, 0.5, 0.0, 0.0, 0.0))
    assert len(clairvoyant.estimate().labels) == 1
    clairvoyant.predict(Displacement(2.5, 2.0, 0.0, 0.0, 0.0))
    assert len(clairvoyant.estimate().labels) == 0


def test_without_identities_it_says_so():
    with pytest.raises(ValueError, match="identity"):
        Clairvoyant().update(Positions(0.0, np.zeros((1, 2)), np.eye(2)[None]))
