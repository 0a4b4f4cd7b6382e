"""The reader and the scoring rule on the dataset as recorded."""

import numpy as np
import pytest

from host.evaluation.metrics import Accumulator
from host.evaluation.mrclam_scoring import mrclam_maker, score_observer, scored_instants
from host.messages import Displacement, Estimate, Positions
from host.recording.elsewhere import mrclam


@pytest.fixture(scope="module")
def dataset(recorded):
    return mrclam.load_dataset(recorded("mrclam6"))


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
    for observer in (2, 3):
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
    assert len(normalised) > 1500
    # Chi-squared with two degrees of freedom has the median 1.39; the real tails are heavier.
    assert 0.7 < np.median(normalised) < 2.0
    assert np.quantile(np.abs(bearings), 0.99) < np.radians(33)


def test_frames_keep_the_cameras_pace(dataset):
    for observer in (1, 5):
        frames = [m.time for m in dataset.messages(observer, "drop") if isinstance(m, Positions)]
        gaps = np.diff(frames)
        assert np.min(gaps) > 0.1
        assert np.max(gaps) < 0.36
        assert np.median(gaps) == pytest.approx(mrclam.FRAME_PERIOD_S, abs=0.01)


@pytest.mark.slow
def test_limit_floor_and_silence_score_as_expected(dataset):
    wanted = {
        ("clairvoyant", "drop"): (0.073, 0.003),
        ("last_reading", "drop"): (0.078, 0.004),
        ("last_reading", "clutter"): (0.085, 0.004),
        ("silent", "drop"): (0.286, 0.002),
    }
    scores = {key: [] for key in wanted}
    for observer in (2, 4):
        messages = {kind: dataset.messages(observer, kind) for kind in ("drop", "clutter")}
        for name, kind in wanted:
            if name == "silent":  # needs no odometry to say nothing
                frames = [m for m in messages[kind] if isinstance(m, Positions)]
                scores[name, kind].append(score_observer(dataset, observer, frames, Silent()))
            else:
                scored = score_observer(dataset, observer, messages[kind], mrclam_maker(name)())
                scores[name, kind].append(scored)
    assert len(scored_instants(dataset)) > 700
    for (name, kind), (gospa_m, tolerance) in wanted.items():
        row = Accumulator.pooled(scores[name, kind]).row("mrclam6", "all", name, kind)
        assert row.gospa_m == pytest.approx(gospa_m, abs=tolerance), row
        if name == "clairvoyant":
            assert row.anees == pytest.approx(1.0, abs=0.3)
