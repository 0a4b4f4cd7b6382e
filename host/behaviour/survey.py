"""A drive to calibrate by: rotations and curves both ways, near teammates and far from them.

What fits need: wheels ways, curves of both hands, and straight parts; lidar and cameras teammates
at all bearings and ranges, and rotations that begin and end. The robot keeps to free space: what
comes in its way ends what it was at, and it turns to where there is more room.
"""

import math
import threading

import numpy as np

from host.behaviour.interface import Command, Situation
from host.behaviour.walk import AHEAD_M, SIDE
from host.geometry import wrap

LEAST_WAY_M = 10.0  # on shorter ones the slip of the wheels hides their radii
_ROTATION = 1.05 * math.tau
_RATE_RADPS = 1.8
_WALK_MPS, _SLOW_MPS = 0.3, 0.15
_NEAR_M = 0.6  # to a teammate's middle: near enough
_STEP_S = 5.0  # at the most, of what is no rotation
_BLOCKED_M = 0.7 * AHEAD_M  # straight ahead
_TOO_NEAR_M = 0.36  # to a surface: safety lets it come no nearer
_MOVES_MPS, _STUCK_S = 0.03, 0.8  # so long slower: safety lets it go no further
_AIM_RAD = math.radians(10.0)  # so well it turns to where room is
_AHEAD_RAD = math.radians(50.0)  # a teammate further aside is turned to before it drives

# What it does in turn: rotations by so much (rad), curves by speed (m/s) and turn rate (rad/s),
# "near": up to the nearest teammate, "far": where most room is.
_PROGRAM: tuple[float | tuple[float, float] | str, ...] = (
    _ROTATION,
    "near",
    "far",
    (_WALK_MPS, 0.5),
    "far",
    (_WALK_MPS, -0.5),
    -_ROTATION,
    "near",
    "far",
    (_SLOW_MPS, 0.9),
    "far",
    (_SLOW_MPS, -0.9),
    "far",
    (-_SLOW_MPS, 0.3),
)
_QUICK = ("far", (_WALK_MPS, 0.5), (_WALK_MPS, -0.5))  # parts that make way


class Survey:
    """Drives LEAST_WAY_M, and on until `end`, which whoever knows what fits still lack calls."""

    def __init__(self, start: int = 0) -> None:
        """start: with which of its parts it begins."""
        self._number = start % len(_PROGRAM)
        self._began: tuple[float, float] | None = None  # time and heading
        self._free = 0.0  # heading of the most room, when it was looked for
        self._turning = False  # to there
        self._moved = -math.inf  # when it last moved on
        self._ended = threading.Event()
        self._way_m = 0.0
        self._time = math.inf

    def end(self) -> None:
        """It is enough; from any thread."""
        self._ended.set()

    def command(self, now: Situation) -> Command | None:
        """The next part where this one is done; None once it is enough."""
        self._way_m += abs(now.speed_mps) * max(now.time - self._time, 0.0)
        self._time = now.time
        if self._ended.is_set() and self._way_m >= LEAST_WAY_M:
            return None
        if self._began is None or self._is_done(now, *self._began):
            self._begin_next(now)
        part = _PROGRAM[self._number]
        if isinstance(part, float):
            return Command(0.0, math.copysign(_RATE_RADPS, part))
        if part == "near" and len(now.teammates):
            return _towards(_nearest_mate(now)[1])
        if isinstance(part, tuple) and part[0] < 0.0:
            return Command(*part)
        return self._in_free_space(now, part)

    def _begin_next(self, now: Situation) -> None:
        self._number = (self._number + (self._began is not None)) % len(_PROGRAM)
        while self._ended.is_set() and _PROGRAM[self._number] not in _QUICK:
            self._number = (self._number + 1) % len(_PROGRAM)  # only ways are lacking
        self._began = now.time, now.pose[2]
        self._moved = now.time
        self._free = now.pose[2] + most_open_direction(now)
        self._turning = _PROGRAM[self._number] == "far"

    def _is_done(self, now: Situation, began: float, heading: float) -> bool:
        part = _PROGRAM[self._number]
        if isinstance(part, float):
            return abs(now.pose[2] - heading) >= abs(part)
        if now.time - began >= _STEP_S:
            return True
        if part == "near":
            return _nearest_mate(now)[0] < _NEAR_M or now.nearest(0.0, SIDE / 2) < _BLOCKED_M
        backward = isinstance(part, tuple) and part[0] < 0.0
        return backward and now.nearest(math.pi, SIDE) < AHEAD_M

    def _in_free_space(self, now: Situation, part: tuple[float, float] | str) -> Command:
        """The curve, or straight on; what comes in its way it turns from, to the most room.

        What is beside that way does not turn it again, or in a crowd it would never drive on.
        """
        if abs(now.speed_mps) > _MOVES_MPS or self._turning:
            self._moved = now.time
        stuck = now.time - self._moved > _STUCK_S
        if not self._turning and (stuck or now.nearest(0.0, SIDE / 2) < _BLOCKED_M):
            self._turning, self._free = True, now.pose[2] + most_open_direction(now)
        goal = float(wrap(self._free - now.pose[2]))
        self._turning = self._turning and abs(goal) > _AIM_RAD
        if self._turning:
            return Command(0.0, math.copysign(_RATE_RADPS, goal))
        return Command(*part) if isinstance(part, tuple) else Command(_WALK_MPS, 0.0)


def _towards(bearing: float) -> Command:
    """Turn to it, and drive on it once it is ahead."""
    if abs(bearing) > _AHEAD_RAD:
        return Command(0.0, math.copysign(_RATE_RADPS, bearing))
    return Command(_WALK_MPS * math.cos(bearing), 2.0 * bearing)


def _nearest_mate(now: Situation) -> tuple[float, float]:
    """Distance (m) and bearing (rad) of the nearest teammate; inf where none is known."""
    if not len(now.teammates):
        return math.inf, 0.0
    distances = np.hypot(*now.teammates.T)
    x, y = now.teammates[int(np.argmin(distances))]
    return float(distances.min()), math.atan2(y, x)


def most_open_direction(now: Situation) -> float:
    """The bearing (rad) in which the robot can go on farthest; of equal ones the straightest.

    Safety lets it drive only away from what it is too near to.
    """
    bearings = np.radians(np.arange(-180.0, 180.0, 15.0))
    room = np.array([min(now.nearest(b, SIDE / 2), 3.0) for b in bearings])
    free = np.array([now.nearest(b, math.pi / 2) > _TOO_NEAR_M for b in bearings])
    best: float = bearings[int(np.argmax(room * free - 0.1 * np.abs(wrap(bearings))))]
    return float(best)
