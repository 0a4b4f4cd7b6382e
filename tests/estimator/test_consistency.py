"""A linear world that the filter knows: is it as good, and as sure, as it may be?"""

from datetime import datetime, timedelta

import numpy as np
import pytest
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    OrnsteinUhlenbeck,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.state import TaggedWeightedGaussianState
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.pointprocess import PHDUpdater

from host.config import FilterSettings, Lidar, PmbSettings
from host.estimator.phd import PhdFilter
from host.evaluation.metrics import Accumulator, gospa
from host.messages import Displacement, Positions

RATE_HZ = 7.0
DETECTED, NOISE_M = 0.9, 0.02
# How teammates move (docs/filters.md): m²/s³ and s by mode; changes of mode, 1/s.
MODES = STANDING, MOVING, CRUISING = range(3)
NOISE_OF_SPEED, KEPT_S = np.array([0.0, 0.05, 0.0005]), np.array([1.0, 3.0, 20.0])
RATES = {
    (STANDING, MOVING): 0.7,
    (MOVING, STANDING): 0.7,
    (MOVING, CRUISING): 3.0,
    (CRUISING, MOVING): 0.7,
}
SPEED_MPS = 0.2
SIDE_M = 3.0
CLUTTER, BIRTH = 0.1, 0.005  # 1/m²
WARM_UP = 10

SETTINGS = FilterSettings(
    survival_range_m=50.0,
    pmb=PmbSettings(appear_per_m2_s=BIRTH * RATE_HZ, obstacle_share=0.0),
)
SENSOR = Lidar(
    target_diameter_m=0.011,
    min_range_m=0.0,
    detection_probability=DETECTED,
    half_range_m=999.0,
    clutter_per_m2=CLUTTER,
    blind_sectors=(),
)


def world(seed, targets=5, scans=80):
    """Times, true positions (n, 2) and readings (m, 2) of targets that stand, move and cruise."""
    random = np.random.default_rng(seed)
    half, steps = SIDE_M / 2, 20
    dt = 1.0 / RATE_HZ / steps
    truth, speeds = random.uniform(-half, half, (targets, 2)), np.zeros((targets, 2))
    modes = np.full(targets, STANDING)
    for scan in range(1, scans + 1):
        for _ in range(steps):
            for k, mode in enumerate(modes):
                chances = [RATES.get((mode, other), 0.0) * dt for other in MODES]
                modes[k] = random.choice(
                    MODES, p=[*chances[:mode], 1.0 - sum(chances), *chances[mode + 1 :]]
                )
                if modes[k] == STANDING:
                    speeds[k] = 0.0
                elif mode == STANDING:
                    speeds[k] = random.normal(0.0, SPEED_MPS, 2)
            noise, kept_s = NOISE_OF_SPEED[modes], KEPT_S[modes]
            truth = truth + speeds * dt
            kick = random.normal(0.0, np.sqrt(noise * dt)[:, None], speeds.shape)
            speeds = speeds * (1.0 - dt / kept_s)[:, None] + kick
        seen = truth[random.random(targets) < DETECTED]
        clutter = random.uniform(-half, half, (random.poisson(CLUTTER * SIDE_M**2), 2))
        readings = np.concatenate((seen + random.normal(0.0, NOISE_M, seen.shape), clutter))
        yield scan / RATE_HZ, truth, random.permutation(readings)


def ours(events):
    """Our estimate after each scan."""
    phd = PhdFilter(SETTINGS, SENSOR)
    for time, _, readings in events:
        phd.predict(Displacement(time, 1.0 / RATE_HZ, 0.0, 0.0, 0.0))
        noise = np.tile(NOISE_M**2 * np.eye(2), (len(readings), 1, 1))
        phd.update(Positions(time, readings, noise))
        yield phd.estimate()


def stone_soups(events):
    """The positions (n, 2) that Stone Soup's GM-PHD filter gives after each scan."""
    wander = OrnsteinUhlenbeck(NOISE_OF_SPEED[MOVING], 1.0 / KEPT_S[MOVING])
    sensor = LinearGaussian(4, (0, 2), NOISE_M**2 * np.eye(2))
    kalman = KalmanUpdater(sensor)
    predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel([wander, wander]))
    hypothesiser = GaussianMixtureHypothesiser(
        DistanceHypothesiser(predictor, kalman, Mahalanobis(), missed_distance=4.0),
        order_by_detection=True,
    )
    updater = PHDUpdater(
        kalman, clutter_spatial_density=CLUTTER, prob_detection=DETECTED, prob_survival=0.995
    )
    reducer = GaussianMixtureReducer(prune_threshold=1e-3, merge_threshold=4.0)
    mixture = []
    for time, _, readings in events:
        stamp = datetime(2020, 1, 1) + timedelta(seconds=time)
        birth = TaggedWeightedGaussianState(
            np.zeros((4, 1)),
            np.diag([(SIDE_M / 2) ** 2, SPEED_MPS**2] * 2),
            weight=BIRTH * SIDE_M**2,
            tag=TaggedWeightedGaussianState.BIRTH,
            timestamp=stamp,
        )
        detections = {
            Detection(reading[:, None], timestamp=stamp, measurement_model=sensor)
            for reading in readings
        }
        hypotheses = hypothesiser.hypothesise([*mixture, birth], detections, stamp)
        mixture = reducer.reduce(updater.update(hypotheses).components)
        found = [np.ravel(c.state_vector)[::2] for c in mixture if c.weight > 0.5]
        yield np.array(found, dtype=float).reshape(-1, 2)


@pytest.mark.parametrize("seed", [1, 2])
def test_it_is_no_worse_than_stone_soups_filter_on_the_same_data(seed):
    events = list(world(seed))
    distances = np.array(
        [
            (
                gospa(truth, own.positions, c=0.5).distance,
                gospa(truth, theirs, c=0.5).distance,
            )
            for (_, truth, _), own, theirs in zip(
                events, ours(events), stone_soups(events), strict=True
            )
        ]
    )
    own, theirs = distances[WARM_UP:].mean(axis=0)
    assert own <= theirs
    assert theirs < 0.4  # or it was not set up fairly


def test_it_is_as_sure_as_it_may_be():
    """NEES over many worlds: 1 for a filter whose covariance is that of its error.

    Over these twelve it was 1.13, their median 1.02: a false estimate beside a target that is
    matched with it weighs much. So the mean has a standard error of 0.08.
    """
    parts = []
    for seed in range(10, 22):
        part = Accumulator()
        events = list(world(seed))
        for (_, truth, _), estimate in list(zip(events, ours(events), strict=True))[WARM_UP:]:
            part.add(truth, np.zeros((0, 2)), estimate)
        parts.append(part)
    row = Accumulator.pooled(parts).row("", "", "", "")
    assert 0.9 < row.anees < 1.3
    assert row.missed < 0.07  # 0.037
    assert row.false < 0.09  # 0.048
    assert abs(row.cardinality_error) < 0.1
