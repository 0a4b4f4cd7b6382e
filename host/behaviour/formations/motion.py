"""From a velocity in the plane to what a robot with two wheels can do, without hitting anything.

Null-space-based control (Antonelli & Chiaverini 2006): what a lower task asks for passes only where
it does not work against a higher one.
"""

import math

import numpy as np

from host.behaviour.interface import STILL, Command, Situation
from host.messages import FloatArray

CLEAR_M = 0.5  # from a teammate's middle
WALL_M = 0.35  # from a surface
_AWAY_PER_S = 1.5  # how fast a robot leaves what is nearer than that
_HEADING_PER_S = 3.0
_FORWARD = math.radians(80.0)  # further aside it rotates on the spot
_SETTLED_MPS = 0.03  # slower is noise of the estimates: the robot stands
FASTEST_MPS = 0.2  # less than safety lets through
LOOK_AROUND = Command(0.0, 0.5)


def clear(now: Situation, wanted: FloatArray) -> FloatArray:
    """A velocity (2,) m/s that leaves near things (T0), and else does what is wanted."""
    velocity = wanted
    away = np.zeros(2)
    for things, least in ((now.teammates, CLEAR_M), (now.obstacles, WALL_M)):
        distances = np.hypot(*things.T) if len(things) else np.zeros(0)
        for row in np.argsort(distances):
            if distances[row] >= least:
                break
            towards_it = things[row] / max(float(distances[row]), 1e-6)
            velocity = velocity - max(float(velocity @ towards_it), 0.0) * towards_it
            push = _AWAY_PER_S * (least - float(distances[row]))
            away = away - max(0.0, push + float(away @ towards_it)) * towards_it
    return np.asarray(velocity + away)


def at_least(direction: FloatArray, speed: float, lower: FloatArray) -> FloatArray:
    """A task that takes `speed` m/s or more along a unit vector (2,); lower ones (2,) the rest.

    The lower velocity goes through the null space of the task, I - J+ J (J: the direction as a
    row), unless it is faster there than the task itself; and it gets what is left of FASTEST_MPS,
    so that it does not slow the task.
    """
    speed = min(max(speed, float(lower @ direction)), FASTEST_MPS)
    across = lower - float(lower @ direction) * direction
    left = math.sqrt(FASTEST_MPS**2 - speed**2)
    share = min(1.0, left / max(float(np.hypot(*across)), 1e-9))
    return np.asarray(speed * direction + share * across)


def towards(velocity: FloatArray) -> Command:
    """A velocity (2,) m/s in the robot's frame, as a robot with two wheels can follow it."""
    speed, aside = float(np.hypot(*velocity)), math.atan2(velocity[1], velocity[0])
    if speed < _SETTLED_MPS:
        return STILL
    forward = speed * math.cos(aside) if abs(aside) < _FORWARD else 0.0
    return Command(forward, _HEADING_PER_S * aside)
