"""Belaroussi's fusion: its steps, one by one, and what he reports of its variants."""

import dataclasses
import math

import numpy as np
import pytest

from host.estimator.kalman_hungarian import IMPROVED, KalmanHungarian
from host.messages import Bearings, Displacement, Positions
from host.sessions.offline.evaluating import score_sources

STEP_S = 1.0 / 15.0


def still(time: float, dx: float = 0.0, dpsi: float = 0.0) -> Displacement:
    return Displacement(time, STEP_S, dx, 0.0, dpsi)


def scan(time: float, *places: tuple[float, float]) -> Positions:
    positions = np.array(places, dtype=float).reshape(-1, 2)
    return Positions(time, positions, np.tile(1e-4 * np.eye(2), (len(places), 1, 1)))


def picture(time: float, *places: tuple[float, float]) -> Bearings:
    x, y = np.array(places, dtype=float).reshape(-1, 2).T
    ones = np.ones(len(places))
    return Bearings(
        time, np.arctan2(y, x), 1e-4 * ones, ranges=np.hypot(x, y), range_variances=1e-3 * ones
    )


def test_the_camera_says_who_is_there_and_the_lidar_where() -> None:
    fusion = KalmanHungarian()
    for k in range(30):
        time = STEP_S * (k + 1)
        fusion.predict(still(time))
        fusion.update(scan(time, (0.9, 0.0), (0.0, 2.0)))
        fusion.update(picture(time, (1.06, 0.0)))
    (found,) = fusion.estimate().positions
    # Two sources of sigmas .0212 and .02 about a thing that stands: their weighted mean.
    weights = np.array([1.0 / (0.02 * 1.06) ** 2, 1.0 / 0.02**2])
    assert found[0] == pytest.approx(weights @ (1.06, 0.9) / weights.sum(), abs=0.005)


def test_without_pictures_the_lidar_decides_and_after_ten_rounds_it_gives_up() -> None:
    fusion = KalmanHungarian()
    fusion.predict(still(STEP_S))
    fusion.update(scan(STEP_S, (1.0, 0.0)))
    for k in range(10):
        fusion.predict(still(STEP_S * (k + 2)))
        fusion.update(scan(STEP_S * (k + 2)))
        assert len(fusion.estimate().positions) == 1
    fusion.update(scan(STEP_S * 11))
    assert len(fusion.estimate().positions) == 0


def test_what_is_further_than_half_a_metre_is_another() -> None:
    fusion = KalmanHungarian()
    fusion.predict(still(STEP_S))
    fusion.update(picture(STEP_S, (1.0, 0.0)))
    fusion.update(picture(STEP_S, (1.0, 0.49)))
    assert len(fusion.estimate().positions) == 1
    fusion.update(picture(STEP_S, (1.0, -0.9)))
    assert len(set(fusion.estimate().labels.tolist())) == 2


def test_what_stands_stays_while_the_robot_drives_and_rotates() -> None:
    fusion, place, pose = KalmanHungarian(), np.array([2.0, 1.0]), np.zeros(3)
    for k in range(60):
        time = STEP_S * (k + 1)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        pose += (0.02 * c, 0.02 * s, 0.03)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        seen = np.array([[c, s], [-s, c]]) @ (place - pose[:2])
        fusion.predict(still(time, 0.02, 0.03))
        fusion.update(picture(time, tuple(seen)))
        assert fusion.estimate().positions[0] == pytest.approx(seen, abs=1e-6)


@pytest.mark.parametrize(
    ("matching", "reading", "joins"),
    [
        ("standalone", (1.0, 0.4), True),
        ("standalone", (1.0, 0.6), False),
        ("partial", (3.0, 0.4), True),
        ("partial", (3.0, 0.6), False),
        ("full", (1.0, 0.14), True),
        ("full", (1.0, 0.16), False),
        ("complementary", (3.0, 0.4), True),
    ],
)
def test_which_reading_joins_a_position_at_one_metre(matching, reading, joins) -> None:
    fusion, alone = KalmanHungarian(matching), KalmanHungarian()
    for each in (fusion, alone):
        each.predict(still(STEP_S))
        each.update(picture(STEP_S, (0.0, -2.0)))  # a camera is at work
    fusion.update(scan(STEP_S, reading))
    for each in (fusion, alone):
        each.update(picture(STEP_S, (1.0, 0.0)))
    places = [each.estimate().positions for each in (fusion, alone)]
    moved = len(places[0]) != len(places[1]) or not np.allclose(places[0], places[1])
    assert moved == (joins or matching == "complementary")


def test_the_improved_form_drops_positions_that_the_lidar_does_not_have() -> None:
    fusion = KalmanHungarian(errors=IMPROVED)
    fusion.predict(still(STEP_S))
    fusion.update(picture(STEP_S, (1.0, 0.0)))
    assert len(fusion.estimate().positions) == 0
    fusion.update(scan(STEP_S, (1.1, 0.0)))
    fusion.update(picture(STEP_S, (1.0, 0.0), (-1.0, 1.0)))
    assert len(fusion.estimate().positions) == 1


def test_improved_is_better_as_he_found() -> None:
    names = ["kalman_hungarian", "kh_improved"]
    rows = score_sources(["arena4:seconds=20,seed=22"], names, ["lidar+camera"])
    plain, improved = (row.gospa_m for row in rows)
    assert improved < 0.7 * plain


def test_a_late_reading_counts_as_of_when_it_was_made_if_it_is_asked_for() -> None:
    places = {}
    for delays in (True, False):
        fusion = KalmanHungarian(delays=delays)
        for k in range(300):  # a robot drives at .3 m/s, and every reading of it is .15 s old
            time = STEP_S * (k + 1)
            fusion.predict(still(time))
            seen = picture(time, (1.0 + 0.3 * (time - 0.15), 0.2))
            fusion.update(dataclasses.replace(seen, lag=0.15))
        places[delays] = fusion.estimate().positions[0, 0] - (1.0 + 0.3 * time)
    assert abs(places[True]) < 0.02
    assert places[False] == pytest.approx(-0.045, abs=0.02)
