"""Stone Soup's GM-PHD, GNN and JPDA filters as the benches drive them: one step a scan.

Settings to mind: the KD-trees' distance limit grows with a component's covariance, as a fixed one
would cut off the wide birth; pruning gives lost weight to all alike; P_D is one number.
"""

import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # an optional tree that is not used here
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.dataassociator.probability import JPDAwithLBP
    from stonesoup.deleter.time import UpdateTimeStepsDeleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import (
        GaussianMixtureHypothesiser,
        GaussianMixtureKDTreeHypothesiser,
    )
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.initiator.simple import MultiMeasurementInitiator
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import (
        CombinedLinearGaussianTransitionModel,
        ConstantVelocity,
        RandomWalk,
    )
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState, TaggedWeightedGaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater
    from stonesoup.updater.pointprocess import PHDUpdater

from host.messages import FloatArray

PEERS = ("stone soup GM-PHD", "stone soup GNN", "stone soup JPDA")
_CONFIRM_POINTS, _DELETE_SCANS, _MISSED_DISTANCE = 3, 7, 4.0


def constant_walk(variance: float) -> CombinedLinearGaussianTransitionModel:
    """Positions on a random walk, m²/s per axis."""
    return CombinedLinearGaussianTransitionModel([RandomWalk(variance), RandomWalk(variance)])


def constant_velocity(acceleration: float) -> CombinedLinearGaussianTransitionModel:
    """Positions and velocities, driven by noise of so many m²/s³ per axis."""
    along = ConstantVelocity(acceleration)
    return CombinedLinearGaussianTransitionModel([along, along])


@dataclass(frozen=True)
class Model:
    """What Stone Soup's filters are told. birth_covariance: of a birth around the observer.

    mapping: which of the state's rows are x and y. birth_weight: expected births a scan.
    """

    motion: CombinedLinearGaussianTransitionModel
    mapping: tuple[int, int]
    noise_m: float
    detection_probability: float
    clutter_per_m2: float
    survival: float
    birth_weight: float
    birth_covariance: FloatArray
    prune_weight: float = 1e-3

    @property
    def sensor(self) -> LinearGaussian:
        """Positions with round noise."""
        size = len(self.birth_covariance)
        return LinearGaussian(size, self.mapping, self.noise_m**2 * np.eye(2))


class GmPhd:
    """Stone Soup's GM-PHD over a model; a step gives the estimates and the CPU seconds."""

    def __init__(self, model: Model, trees: bool) -> None:
        self._epoch = datetime(2020, 1, 1)
        self._model = model
        predictor = KalmanPredictor(model.motion)
        self._sensor = model.sensor
        kalman = KalmanUpdater(self._sensor)
        self._updater = PHDUpdater(
            kalman,
            clutter_spatial_density=model.clutter_per_m2,
            prob_detection=model.detection_probability,
            prob_survival=model.survival,
        )
        base = DistanceHypothesiser(predictor, kalman, Mahalanobis(), missed_distance=4.0)
        if trees:
            self._hypothesiser = GaussianMixtureKDTreeHypothesiser(
                base,
                predictor=predictor,
                updater=kalman,
                max_distance_covariance_multiplier=100.0,  # m per m²: 0.5 m for a well known target
                order_by_detection=True,
            )
        else:
            self._hypothesiser = GaussianMixtureHypothesiser(base, order_by_detection=True)
        self._reducer = GaussianMixtureReducer(
            prune_threshold=model.prune_weight,
            merge_threshold=4.0,
            kdtree_max_distance=0.5 if trees else None,
        )
        self._mixture: list[TaggedWeightedGaussianState] = []

    def step(self, now: float, readings: FloatArray) -> tuple[FloatArray, float]:
        stamp = self._epoch + timedelta(seconds=now)
        detections = {
            Detection(reading[:, None], timestamp=stamp, measurement_model=self._sensor)
            for reading in readings
        }
        begin = time.process_time()
        birth = TaggedWeightedGaussianState(
            np.zeros((len(self._model.birth_covariance), 1)),
            self._model.birth_covariance,
            weight=self._model.birth_weight,
            tag=TaggedWeightedGaussianState.BIRTH,
            timestamp=stamp,
        )
        hypotheses = self._hypothesiser.hypothesise([*self._mixture, birth], detections, stamp)
        updated = self._updater.update(hypotheses)
        self._mixture = self._reducer.reduce(updated.components)
        rows = list(self._model.mapping)
        found = [
            component.state_vector[rows] for component in self._mixture if component.weight > 0.5
        ]
        spent = time.process_time() - begin
        return np.array(found, dtype=float).reshape(-1, 2), spent


class Tracker:
    """Stone Soup's GNN or JPDA; a step gives the estimates (k, 2) and the CPU seconds."""

    def __init__(self, model: Model, joint: bool, known: FloatArray | None = None) -> None:
        self._model, self._epoch = model, datetime(2020, 1, 1)
        self._sensor = model.sensor
        predictor, updater = KalmanPredictor(model.motion), KalmanUpdater(self._sensor)
        nearest = GNNWith2DAssignment(
            DistanceHypothesiser(predictor, updater, Mahalanobis(), _MISSED_DISTANCE)
        )
        likely = PDAHypothesiser(
            predictor, updater, model.clutter_per_m2, prob_detect=model.detection_probability
        )
        covariance = model.birth_covariance
        deleter = UpdateTimeStepsDeleter(_DELETE_SCANS)
        initiator = MultiMeasurementInitiator(
            GaussianState(np.zeros((len(covariance), 1)), covariance),
            deleter,
            nearest,
            updater,
            self._sensor,
            min_points=_CONFIRM_POINTS,
        )
        kind = MultiTargetMixtureTracker if joint else MultiTargetTracker
        associator = JPDAwithLBP(likely) if joint else nearest
        self._next: tuple[datetime, set[Detection]]
        self._tracker = kind(initiator, deleter, self._readings(), associator, updater)
        iter(self._tracker)
        for place in np.zeros((0, 2)) if known is None else known:
            self._tracker._tracks.add(Track([self._on(place)]))

    def _on(self, place: FloatArray) -> GaussianState:
        mean = np.zeros((len(self._model.birth_covariance), 1))
        mean[list(self._model.mapping), 0] = place
        spread = self._model.noise_m**2 * np.eye(len(mean))
        return GaussianState(mean, spread, timestamp=self._epoch)

    def _readings(self) -> Iterator[tuple[datetime, set[Detection]]]:
        while True:
            yield self._next

    def step(self, now: float, readings: FloatArray) -> tuple[FloatArray, float]:
        stamp = self._epoch + timedelta(seconds=now)
        self._next = (
            stamp,
            {
                Detection(reading[:, None], timestamp=stamp, measurement_model=self._sensor)
                for reading in readings
            },
        )
        begin = time.process_time()
        _, tracks = next(self._tracker)
        rows = list(self._model.mapping)
        found = [track.state.state_vector[rows] for track in tracks]
        spent = time.process_time() - begin
        return np.array(found, dtype=float).reshape(-1, 2), spent


def peer(name: str, model: Model, known: FloatArray | None = None) -> GmPhd | Tracker:
    """A peer by its name; known (n, 2): where it has a track from the start."""
    if name == PEERS[0]:
        return GmPhd(model, trees=False)
    return Tracker(model, joint=name == PEERS[2], known=known)
