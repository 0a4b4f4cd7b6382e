"""Around, or beside, one that moves: an intruder is enclosed (Lee 2012), a leader is followed."""

import math

import numpy as np

from host.behaviour.formations.circle import RADIUS_M, on_circle
from host.behaviour.formations.line import Gather
from host.behaviour.formations.motion import clear, towards
from host.behaviour.formations.target import Target
from host.behaviour.interface import STILL, Command, Situation
from host.geometry import rotation

_PLACE_PER_S = 0.8
_DIRECTION_MPS = 0.04  # a leader that is slower has no direction


class Enclose:
    """All on one circle around whoever moves while the team stands and watches, evenly.

    speed_mps: along the circle, counter-clockwise positive.
    """

    def __init__(self, radius_m: float = RADIUS_M, speed_mps: float = 0.0) -> None:
        self._radius_m, self._speed_mps = radius_m, speed_mps
        self._target, self._meet = Target(radius_m), Gather()

    def command(self, now: Situation) -> Command:
        """Never done. While it does not know whom to enclose it keeps to its teammates."""
        row = self._target.find(now)
        place = self._target.place(now)
        if place is None:
            return STILL if self._target.watching(now) else self._meet.command(now)
        mates = now.teammates if row is None else np.delete(now.teammates, row, axis=0)
        velocity = on_circle(mates, place, self._radius_m, self._speed_mps)
        return towards(clear(now, velocity + self._target.velocity(now)))


class Keep:
    """A distance and an angle to whoever moves while it stands and watches.

    angle_rad: from the direction in which that one moves, counter-clockwise; pi: behind it.
    """

    def __init__(self, distance_m: float = 0.8, angle_rad: float = math.pi) -> None:
        self._distance_m, self._angle_rad = distance_m, angle_rad
        self._target = Target()
        self._heading = 0.0  # of the target, in the odometry

    def command(self, now: Situation) -> Command:
        """Never done. It stands until it knows whom to keep to."""
        self._target.find(now)
        place = self._target.place(now)
        if place is None:
            return STILL
        moves = self._target.velocity(now)
        if float(np.hypot(*moves)) > _DIRECTION_MPS:
            self._heading = math.atan2(moves[1], moves[0]) + now.pose[2]
        beside = rotation(self._heading + self._angle_rad - now.pose[2]) @ (self._distance_m, 0.0)
        return towards(clear(now, moves + _PLACE_PER_S * (place + beside)))
