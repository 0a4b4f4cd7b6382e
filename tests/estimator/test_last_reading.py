import math

import numpy as np
import pytest

from host.estimator.last_reading import LastReading
from host.messages import Bearings, Displacement, Positions


def seen(time, *points):
    n = len(points)
    points = np.array(points, dtype=float).reshape(n, 2)
    return Positions(time, points, np.tile(0.01 * np.eye(2), (n, 1, 1)))


def test_a_reading_is_kept_for_its_time_and_carried():
    floor = LastReading(keep_s=5.0)
    floor.update(seen(0.0, [2.0, 0.0]))
    floor.predict(Displacement(4.9, 4.9, 1.0, 0.0, math.pi / 2))
    found = floor.estimate()
    assert found.positions == pytest.approx(np.array([[0.0, -1.0]]), abs=1e-12)
    assert found.ages == pytest.approx([4.9])
    floor.predict(Displacement(5.0, 0.1, 0.0, 0.0, 0.0))
    assert len(floor.estimate().positions) == 0


def test_a_new_reading_replaces_the_old_ones_near_it():
    floor = LastReading(merge_m=0.5)
    floor.update(seen(0.0, [1.0, 0.0], [0.0, 2.0]))
    floor.update(seen(0.0, [1.4, 0.0], [0.0, 2.6]))
    found = floor.estimate()
    assert found.positions.tolist() == [[0.0, 2.0], [1.4, 0.0], [0.0, 2.6]]
    assert len(set(found.labels.tolist())) == 3


def test_readings_of_one_frame_are_different_things_however_near():
    floor = LastReading(merge_m=0.5)
    floor.update(seen(0.0, [1.0, 0.0], [1.1, 0.0]))
    assert len(floor.estimate().positions) == 2


def test_bearings_and_empty_frames_change_nothing_but_the_time():
    floor = LastReading()
    floor.update(seen(0.0, [1.0, 0.0]))
    floor.update(Bearings(0.1, np.array([0.0]), np.array([0.01])))
    floor.update(seen(0.2))
    found = floor.estimate()
    assert found.positions.tolist() == [[1.0, 0.0]]
    assert found.time == 0.2
