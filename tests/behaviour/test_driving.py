"""A behaviour drives on what the sensors measure, not on what they send."""

import math

import numpy as np

from host.behaviour.driving import Driving
from host.behaviour.walk import RandomWalk
from host.config import RobotConfig
from host.messages import Displacement, Scan

ANGLES = np.linspace(-math.pi, math.pi, 720, endpoint=False)
PERIOD_S = 0.02
FREEZES_S = 1.5


def test_a_robot_whose_lidar_freezes_stops_within_half_a_second() -> None:
    """Its packets go on, with returns in each: nothing but their content shows it."""
    sent: list[tuple[float, float]] = []
    now = 0.0
    driving = Driving(
        RobotConfig(), RandomWalk(0), lambda *to: sent.append(to), lambda: now, lambda: now
    )
    random = np.random.default_rng(0)
    ranges = np.zeros(720)
    for step in range(130):
        now += PERIOD_S
        driving.take(Displacement(now, PERIOD_S, 0.0, 0.0, 0.0))
        if step % 7 == 0:
            if now < FREEZES_S:
                ranges = 1.5 + random.normal(0.0, 0.002, 720)
            driving.take(Scan(now, np.full(720, now), ANGLES, ranges))
        driving.step(now)
    before, after = sent[: round(FREEZES_S / PERIOD_S)], sent[round(2.0 / PERIOD_S) + 1 :]
    assert all(speed > 0.0 for speed, _ in before[10:])
    assert all(command == (0.0, 0.0) for command in after)
    assert driving.safety.halt == "the lidar is lost"
