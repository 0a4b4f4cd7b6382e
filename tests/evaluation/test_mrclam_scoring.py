import math

import numpy as np
import pytest

from host.estimator.last_reading import LastReading
from host.evaluation.mrclam_scoring import (
    mrclam_maker,
    mrclam_rows,
    mrclam_scores,
    score_observer,
    scored_instants,
)
from host.messages import Positions
from host.recording.elsewhere import mrclam

# Robot 1 stands at the origin, looks along x and never moves; nor does anybody else.
PLACES = {1: (0.0, 0.0), 2: (3.0, 0.0), 3: (0.0, 3.0), 4: (-3.0, 0.0), 5: (0.0, -3.0)}
UP, DOWN, BACK = math.pi / 2, -math.pi / 2, math.pi
BIAS = mrclam.RANGE_BIAS_M
READINGS = [
    (57.0, 41, 3.5 + BIAS, UP),  # robot 3, half a metre too far
    (58.5, 14, 3.0 + BIAS, 0.0),  # robot 2, exactly
    (60.5, 99, 1.7 + BIAS, DOWN),  # nobody, 1.3 m from robot 5
    (62.5, 63, 5.0 + BIAS, 0.0),  # the landmark
    (63.5, 99, 3.0 + BIAS, BACK),  # nobody known, but robot 4 is there
]

REFERENCES = ("clairvoyant", "last_reading")


@pytest.fixture
def dataset(tmp_path):
    def write(name, rows):
        lines = [" ".join(repr(float(value)) for value in row) + "\n" for row in rows]
        (tmp_path / name).write_text("# a miniature\n" + "".join(lines))

    write("Barcodes.dat", [(1, 5), (2, 14), (3, 41), (4, 32), (5, 23), (6, 63)])
    write("Landmark_Groundtruth.dat", [(6, 5.0, 0.0, 0.0, 0.0)])
    for robot, (x, y) in PLACES.items():
        # Vicon lost robot 3 around 62 s; robot 5's record ends last.
        vicon = [
            t for t in np.arange(0.0, 64.05 + robot / 10, 0.1) if robot != 3 or abs(t - 62) > 0.3
        ]
        write(f"Robot{robot}_Groundtruth.dat", [(t, x, y, 0.0) for t in vicon])
        write(f"Robot{robot}_Odometry.dat", [(t, 0.0, 0.0) for t in np.arange(0.0, 66.0, 0.5)])
        write(f"Robot{robot}_Measurement.dat", READINGS)
    return mrclam.load_dataset(tmp_path)


def scored(dataset, name, landmarks):
    return score_observer(dataset, 1, dataset.messages(1, landmarks), mrclam_maker(name)())


def test_instants_start_after_a_minute_and_skip_gaps_of_vicon(dataset):
    assert scored_instants(dataset) == [60.0, 61.0, 63.0, 64.0]


@pytest.mark.parametrize("landmarks", ["drop", "clutter"])
def test_last_reading_scored_by_hand(dataset, landmarks):
    row = scored(dataset, "last_reading", landmarks).row("", "", "", "")
    # 60 s: robots 2 and 3, one of them 0.5 m off. 61 s: and a false one. 63 s: robot 3 was read
    # too long ago, robot 2 is right, the false one stays. 64 s: nobody was read, the false one
    # stays, the one where robot 4 stands is excused, and so is the landmark.
    expected = [math.sqrt(0.25), math.sqrt(0.25 + 0.5), math.sqrt(0.5), math.sqrt(0.5)]
    assert row.gospa_m == pytest.approx(np.mean(expected))
    assert row.localisation_m == pytest.approx((0.5 + 0.5) / 4)
    assert row.missed == 0.0
    assert row.false == pytest.approx(3 / 4)
    assert row.cardinality_error == pytest.approx(3 / 4)
    assert row.time_over_30cm == pytest.approx(2 / 5)
    assert row.rmse_m == pytest.approx(math.sqrt((0.25 + 0.25) / 5))
    assert row.seconds == 4.0


def test_the_clairvoyant_scored_by_hand(dataset):
    row = scored(dataset, "clairvoyant", "clutter").row("", "", "", "")
    assert row.gospa_m == pytest.approx((0.5 + 0.5 + 0.0 + 0.0) / 4)
    assert (row.missed, row.false) == (0.0, 0.0)


def test_a_robot_is_to_be_reported_after_it_was_read_not_before(dataset):
    read = Positions(62.5, np.array([[3.0, 0.0]]), 0.01 * np.eye(2)[None], identities=np.array([2]))
    forgets = LastReading(keep_s=0.0)
    row = score_observer(dataset, 1, [read], forgets).row("", "", "", "")
    assert row.missed == (0 + 0 + 1 + 1) / 4  # at 60, 61, 63 and 64 s


def test_rows_are_one_for_each_observer_and_one_for_all(dataset):
    rows = []
    for name in REFERENCES:
        scores = mrclam_scores(dataset, mrclam_maker(name), "drop")
        rows += mrclam_rows(scores, name, "miniature")
    assert [row.observer for row in rows] == ["1", "2", "3", "4", "5", "all"] * 2
    assert [row.filter for row in rows] == ["clairvoyant"] * 6 + ["last_reading"] * 6
    assert {row.source for row in rows} == {"miniature"}
    mean = np.mean([row.gospa_m for row in rows[:5]])
    assert rows[5].gospa_m == pytest.approx(mean)
