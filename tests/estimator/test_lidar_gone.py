"""The lidar stops for ten seconds: the cameras hold the teammates, by rendered pictures."""

import numpy as np
import pytest

from host.config import RobotConfig
from host.estimator import profiles
from host.evaluation.labels import TruthTrack
from host.localizer import Localizer
from host.messages import Bearings, Scan
from host.sessions.recordings import runs

GONE, BACK, END = 5.0, 15.0, 17.5


@pytest.mark.slow
def test_the_cameras_hold_teammates_while_the_lidar_is_gone_and_labels_last() -> None:
    config = RobotConfig()
    run = runs.simulate_scenario(f"arena4:seconds={END:g},seed=31,rendered=1", config)
    localizer = Localizer(config, profiles.make("pmb", config))
    track, before = TruthTrack(run.truths), dict[int, int]()
    held, asked, same, found = 0, 0, 0, 0
    for message in run.messages:
        if isinstance(message, Scan) and GONE <= message.time < BACK:
            continue
        estimates = localizer.handle(message)
        if not isinstance(message, Scan | Bearings):
            continue
        for estimate in estimates:
            truth = track.at(estimate.time)
            if truth is None or estimate.time < GONE - 1.0:
                continue
            for who, place in zip(truth.identities.tolist(), truth.positions, strict=True):
                apart = np.linalg.norm(estimate.positions - place, axis=1)
                near = bool(apart.min(initial=9.0) < 0.4)
                label = int(estimate.labels[apart.argmin()]) if near else 0
                if estimate.time < GONE and near:
                    before[who] = label
                elif who in before and np.hypot(*place) < 2.0:
                    if estimate.time < BACK:
                        asked, held = asked + 1, held + near
                    elif estimate.time > BACK + 1.0 and near:
                        found, same = found + 1, same + (label == before[who])
    assert asked > 200
    assert held / asked > 0.85
    assert found > 50
    assert same / found > 0.9
