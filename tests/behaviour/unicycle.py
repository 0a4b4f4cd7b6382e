"""A robot that does exactly what it is told, in an empty room: to see where a behaviour leads."""

import math
from collections.abc import Callable

import numpy as np

from host.behaviour.interface import Behaviour, Situation
from host.messages import FloatArray
from tests.behaviour.situations import NOTHING

STEP_S = 0.02


def led(
    behaviour: Behaviour,
    seconds: float,
    scale: float = 1.0,
    at: Callable[[float], None] = lambda time: None,
) -> FloatArray:
    """Poses (n, 3) until it is done or for so long. scale: of its speed; at: told the time."""
    poses = [(0.0, 0.0, 0.0)]
    speed = rate = 0.0
    for step in range(round(seconds / STEP_S)):
        time = step * STEP_S
        at(time)
        x, y, heading = poses[-1]
        now = Situation(time, NOTHING, np.zeros(0), None, poses[-1], speed, rate)
        command = behaviour.command(now)
        if command is None:
            break
        speed, rate = scale * command.speed_mps, command.turn_rate_radps
        along = heading + 0.5 * rate * STEP_S
        poses.append(
            (
                x + speed * STEP_S * math.cos(along),
                y + speed * STEP_S * math.sin(along),
                heading + rate * STEP_S,
            )
        )
    return np.array(poses)
