import math

import numpy as np
import pytest

from host.estimator.last_reading import LastReading
from host.evaluation.runner import estimates_at
from host.messages import Displacement, Health, Positions


def seen(time, *points):
    n = len(points)
    points = np.array(points, dtype=float).reshape(n, 2)
    return Positions(time, points, np.tile(0.01 * np.eye(2), (n, 1, 1)))


def driving(start, end, speed, turn_rate, step=0.1):
    count = round((end - start) / step)
    return [
        Displacement(start + step * (k + 1), step, speed * step, 0.0, turn_rate * step)
        for k in range(count)
    ]


def test_readings_up_to_the_instant_are_carried_to_it_by_odometry():
    messages = sorted(
        [*driving(0.0, 4.0, 0.5, 0.0), seen(1.0, [3.0, 1.0]), seen(3.0, [1.0, -2.0])],
        key=lambda message: message.time,
    )
    spent = []
    before, at, between, after = estimates_at(
        LastReading(), messages, [0.95, 1.0, 1.25, 3.95], spent
    )
    assert len(before.positions) == 0
    assert at.positions == pytest.approx(np.array([[3.0, 1.0]]))
    assert between.positions == pytest.approx(np.array([[2.875, 1.0]]))
    assert between.time == 1.25
    assert after.positions == pytest.approx(np.array([[1.525, 1.0], [0.525, -2.0]]))
    assert len(spent) == 2


def test_asking_leaves_no_trace():
    generator = np.random.default_rng(4)
    sightings = [seen(t, *generator.uniform(-2, 2, (2, 2))) for t in np.arange(0.33, 8.0, 0.7)]
    messages = sorted([*driving(0, 8, 0.3, 0.8), *sightings], key=lambda message: message.time)
    often = list(estimates_at(LastReading(), messages, np.arange(1.0, 8.1, 0.25).tolist(), []))
    once = list(estimates_at(LastReading(), messages, [8.0], []))
    assert np.array_equal(often[-1].positions, once[0].positions)
    assert np.array_equal(often[-1].covariances, once[0].covariances)


def test_a_minute_without_readings_does_not_lose_the_way():
    turn_rate = 2.0 * math.pi / 60.0
    messages = [seen(0.0, [1.0, 0.0]), *driving(0.0, 60.0, 0.0, turn_rate)]
    (half, whole) = estimates_at(LastReading(keep_s=1e9), messages, [30.0, 60.0], [])
    assert half.positions == pytest.approx(np.array([[-1.0, 0.0]]), abs=1e-9)
    assert whole.positions == pytest.approx(np.array([[1.0, 0.0]]), abs=1e-9)


def test_other_messages_are_passed_over_and_late_instants_still_answered():
    messages = [Health(0.0, "lidar", True, "", {}), seen(1.0, [1.0, 1.0])]
    assert len(list(estimates_at(LastReading(), messages, [2.0, 3.0], []))) == 2
