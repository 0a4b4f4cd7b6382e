"""Circles of anonymous robots that tell each other nothing: each goes by its own estimates.

Tasks as in Stegagno 2013, section V. T0: keep clear of things. T1, T2: keep the teammates in view,
there from above, here by keeping near to them. T3: bring the centroid to a goal. T4: stand evenly
on a circle around the centroid. T3 and T4 pass through the null space of T1 and T2, and all of
them below T0.
"""

import math

import numpy as np

from host.behaviour.formations.motion import LOOK_AROUND, at_least, clear, towards
from host.behaviour.interface import Command, Situation
from host.geometry import to_frame
from host.messages import FloatArray

RADIUS_M = 0.9
_RADIUS_PER_S = 0.8
_ANGLE_PER_S = 0.4
_GOAL_PER_S = 0.3
_GOAL_MPS = 0.08  # at the most, so that there is speed left to keep the shape
_VIEW_PER_S = 0.8
_MISSED_S, _MISSING_MPS = 8.0, 0.08


def on_circle(mates: FloatArray, centre: FloatArray, radius_m: float, speed: float) -> FloatArray:
    """T4 (2,) m/s of a robot at the origin: the circle around `centre`, evenly, and along it.

    mates (n, 2) m: the others on the circle. speed: m/s along it, counter-clockwise positive.
    """
    distance = max(float(np.hypot(*centre)), 1e-6)
    outward = -centre / distance
    tangent = np.array([-outward[1], outward[0]])
    around = mates - centre
    angles = np.arctan2(around @ tangent, around @ outward) % math.tau
    uneven = 0.0
    if len(angles):  # nearer to the next one than to the one before, or farther
        uneven = (float(angles.min()) - (math.tau - float(angles.max()))) / 2.0
    tangential = speed + _ANGLE_PER_S * radius_m * uneven
    return np.asarray(_RADIUS_PER_S * (radius_m - distance) * outward + tangential * tangent)


def centroid(mates: FloatArray) -> FloatArray:
    """Of mates (n, 2) and a robot at the origin: (2,) m."""
    return np.asarray(mates.sum(axis=0) / (len(mates) + 1))


class Circle:
    """T0 to T4: all on one circle around their centroid, evenly, and within each other's view.

    speed_mps: along the circle, counter-clockwise positive; 0: they stand once there. goal (x, y)
    m: where the circle goes, in the robot's own odometry, since robots share no frame; None: T3 is
    left out. near_m: T1, no farther from the centroid; view_m: T2, no farther from any teammate.
    shaped: False leaves T3 and T4 out.
    """

    def __init__(
        self,
        speed_mps: float = 0.0,
        goal: tuple[float, float] | None = None,
        near_m: float = 1.3,
        view_m: float = 2.1,
        shaped: bool = True,
    ) -> None:
        self._speed_mps, self._goal, self._shaped = speed_mps, goal, shaped
        self._near_m, self._view_m = near_m, view_m
        self._most, self._last = 0, -math.inf  # teammates known at once, and when they last were

    def command(self, now: Situation) -> Command:
        """Never done. Without a teammate in sight it looks around."""
        mates = now.teammates
        if not len(mates):
            return LOOK_AROUND
        velocity = self._in_view(mates, self._missing(now), self._shape(now, mates))
        return towards(clear(now, velocity))

    def _shape(self, now: Situation, mates: FloatArray) -> FloatArray:
        """T3 and T4."""
        if not self._shaped:
            return np.zeros(2)
        centre = centroid(mates)
        velocity = on_circle(mates, centre, RADIUS_M, self._speed_mps)
        if self._goal is None:
            return velocity
        way = _GOAL_PER_S * (to_frame(np.array(self._goal), np.array(now.pose)) - centre)
        return velocity + way * min(1.0, _GOAL_MPS / max(float(np.hypot(*way)), 1e-9))

    def _missing(self, now: Situation) -> bool:
        """Whether more teammates were known a short while ago."""
        count = len(now.teammates)
        if count >= self._most or now.time - self._last > _MISSED_S:
            self._most, self._last = count, now.time
        return count < self._most

    def _in_view(self, mates: FloatArray, missing: bool, lower: FloatArray) -> FloatArray:
        """T1 and T2: who is too far from the others goes towards their centroid.

        So it does where some are missing: of a circle that is too wide one sees the neighbours
        alone, which look like a small one.
        """
        speed = _VIEW_PER_S * sum(self.view_errors(mates)) + missing * _MISSING_MPS
        if speed <= 0.0:
            return lower
        centre = centroid(mates)
        inward = centre / max(float(np.hypot(*centre)), 1e-6)
        return at_least(inward, speed, lower)

    def view_errors(self, mates: FloatArray) -> tuple[float, float]:
        """How far (m) T1 and T2 are beyond their limits; 0: within."""
        near = float(np.hypot(*centroid(mates)))
        farthest = float(np.hypot(*mates.T).max())
        return max(near - self._near_m, 0.0), max(farthest - self._view_m, 0.0)
