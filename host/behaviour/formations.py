"""Formations of anonymous robots that tell each other nothing: each goes by its own estimates.

Tasks as in Stegagno 2013: keep clear of things (T0), and below that keep a distance from the
centroid (T3) and equal angles on the circle around it (T4). What a lower task asks for passes only
where it does not drive against a higher one: its part towards a near thing is projected out
(null-space-based control, Antonelli & Chiaverini 2006).
"""

import math
from dataclasses import dataclass

import numpy as np

from host.behaviour.interface import STILL, Command, Situation
from host.messages import FloatArray

CLEAR_M = 0.5  # from a teammate's middle
WALL_M = 0.35  # from a surface
_AWAY_PER_S = 1.5  # how fast a robot leaves what is nearer than that
_RADIUS_PER_S = 0.8
_ANGLE_PER_S = 0.4
_HEADING_PER_S = 3.0
_FORWARD = math.radians(80.0)  # further aside it rotates on the spot
_SETTLED_MPS = 0.03  # slower is noise of the estimates: the robot stands


@dataclass(frozen=True, slots=True)
class Circle:
    """All on one circle around their centroid, evenly, and round and round it.

    radius_m. speed_mps: along the circle, counter-clockwise positive; 0: they stand once there.
    """

    radius_m: float = 0.9
    speed_mps: float = 0.12

    def command(self, now: Situation) -> Command:
        """Never done. Without a teammate in sight it looks around."""
        if not len(now.teammates):
            return Command(0.0, 0.5)
        return towards(clear(now, self.velocity(now.teammates)))

    def velocity(self, teammates: FloatArray) -> FloatArray:
        """T3 and T4 (2,) m/s for a robot at the origin with teammates at (n, 2) m."""
        centroid = teammates.sum(axis=0) / (len(teammates) + 1)
        distance = max(float(np.hypot(*centroid)), 1e-6)
        outward = -centroid / distance
        along = np.array([-outward[1], outward[0]])
        around = teammates - centroid
        angles = np.arctan2(around @ along, around @ outward) % (2.0 * math.pi)
        uneven = (float(angles.min()) - (2.0 * math.pi - float(angles.max()))) / 2.0
        tangential = self.speed_mps + _ANGLE_PER_S * self.radius_m * uneven
        radial = _RADIUS_PER_S * (self.radius_m - distance)
        return np.asarray(radial * outward + tangential * along)


def clear(now: Situation, wanted: FloatArray) -> FloatArray:
    """A velocity (2,) m/s that leaves near things (T0), and does else what is wanted."""
    velocity = wanted
    away = np.zeros(2)
    for things, least in ((now.teammates, CLEAR_M), (now.obstacles, WALL_M)):
        distances = np.hypot(*things.T) if len(things) else np.zeros(0)
        for row in np.argsort(distances):
            if distances[row] >= least:
                break
            towards_it = things[row] / max(float(distances[row]), 1e-6)
            against = float(velocity @ towards_it)
            velocity = velocity - max(against, 0.0) * towards_it
            push = _AWAY_PER_S * (least - float(distances[row]))
            away = away - max(0.0, push + float(away @ towards_it)) * towards_it
    return np.asarray(velocity + away)


def towards(velocity: FloatArray) -> Command:
    """A velocity (2,) m/s in the robot's frame, as a robot with two wheels can follow it."""
    speed, aside = float(np.hypot(*velocity)), math.atan2(velocity[1], velocity[0])
    if speed < _SETTLED_MPS:
        return STILL
    forward = speed * math.cos(aside) if abs(aside) < _FORWARD else 0.0
    return Command(forward, _HEADING_PER_S * aside)
