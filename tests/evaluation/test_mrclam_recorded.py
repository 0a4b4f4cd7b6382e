"""The reader and the scoring rule on the dataset as recorded."""

import os
from pathlib import Path

import numpy as np
import pytest

from host.evaluation.mrclam_scoring import REFERENCES, evaluate, instants
from host.messages import Displacement, Estimate, Positions
from host.recording import mrclam


@pytest.fixture(scope="module")
def dataset():
    root = os.environ.get("SWARMLOC_DATA")
    if not root and os.environ.get("CI") == "true":
        pytest.fail("SWARMLOC_DATA must name the folder of recorded data in CI")
    if not root:
        pytest.skip("SWARMLOC_DATA does not name the folder of recorded data")
    return mrclam.load(Path(root) / "mrclam6")


class Silent:
    """Reports nothing."""

    def __init__(self):
        self._time = 0.0

    def predict(self, motion):
        self._time = motion.time

    def update(self, measurement):
        pass

    def estimate(self):
        nothing = np.zeros(0)
        return Estimate(
            self._time, np.zeros((0, 2)), np.zeros((0, 2, 2)), nothing, nothing, np.zeros(0, int)
        )


def test_the_camera_looks_32_degrees_to_each_side_and_the_noise_fits(dataset):
    """Readings of robots against Vicon: bias, noise, frames and identities in one."""
    normalised, bearings = [], []
    for observer in mrclam.ROBOTS:
        for frame in dataset.messages(observer, "drop"):
            if isinstance(frame, Displacement) or not len(frame.positions):
                continue
            if not dataset.has_vicon(frame.time):
                continue
            truth = dataset.truth(observer, frame.time)
            where = dict(zip(truth.identities.tolist(), truth.positions, strict=True))
            for k, who in enumerate(frame.identities.tolist()):
                if who < 0:
                    continue
                error = frame.positions[k] - where[who]
                normalised.append(error @ np.linalg.solve(frame.covariances[k], error))
                bearings.append(np.arctan2(where[who][1], where[who][0]))
    assert len(normalised) > 3500
    # Chi-squared with two degrees of freedom has the median 1.39; the real tails are heavier.
    assert 0.7 < np.median(normalised) < 2.0
    assert np.quantile(np.abs(bearings), 0.99) < np.radians(33)


def test_frames_keep_the_cameras_pace(dataset):
    for observer in mrclam.ROBOTS:
        frames = [m.time for m in dataset.messages(observer, "drop") if isinstance(m, Positions)]
        gaps = np.diff(frames)
        assert np.min(gaps) > 0.1
        assert np.max(gaps) < 0.36
        assert np.median(gaps) == pytest.approx(mrclam.FRAME_PERIOD_S, abs=0.01)


def test_limit_floor_and_silence_score_as_expected(dataset):
    gospa = {}
    everything = {**REFERENCES, "silent": Silent}
    floor = {"last_reading": REFERENCES["last_reading"]}
    for landmarks, filters in (("drop", everything), ("clutter", floor)):
        for row in evaluate(dataset, filters, landmarks, "mrclam6"):
            if row.observer == "all":
                gospa[row.filter, landmarks] = row.gospa_m
    assert len(instants(dataset)) > 700
    assert gospa["clairvoyant", "drop"] == pytest.approx(0.100, abs=0.004)
    assert gospa["last_reading", "drop"] == pytest.approx(0.102, abs=0.004)
    assert gospa["last_reading", "clutter"] == pytest.approx(0.111, abs=0.004)
    assert gospa["silent", "drop"] == pytest.approx(0.368, abs=0.002)
