"""Overrules every behaviour: the robot stops before obstacles and teammates, and without data.

Rotation on the spot is always allowed, as the body is a disc; so a robot can leave what it stands
before. Of a robot that is too near already every motion is allowed that brings it no nearer.
"""

import math

import numpy as np

from host.behaviour.interface import STILL, Command, Situation
from host.config import RobotConfig
from host.messages import FloatArray

# The circle around a Cherokey of 22.5 x 17.5 cm. Of a teammate the lidar sees the turret only, in
# its middle: whatever returns a beam may have a body around it.
BODY_RADIUS_M = 0.143
MARGIN_M = 0.03
MATE_MPS = 0.25  # a teammate has moved by so much since it was seen
_OLDEST_S = 0.4  # ... and no more than for so long

PERIOD_S = 0.02  # of the commands: a loss is noticed up to so much later
REACTION_S = 0.1  # from a command to the first of its effect: the control's period and lag
SILENCE_S = 0.09  # without a return of the lidar, s; half a revolution and more
STOP_S = 0.3  # within which the robot stands still, whatever is lost
SCAN_S = 0.5  # without a whole revolution
ODOMETRY_S = 0.15  # without a report of the wheels
IN_THE_WAY = "something is in the way"
_STEP_M = 0.01  # along the path that is looked at
_SHARES = np.array([1.0, 0.75, 0.5, 0.25])  # of the wanted speed, tried in this order


class Safety:
    """Limits every command. halt: why it stopped the robot, as text; "": it did not."""

    def __init__(self, config: RobotConfig) -> None:
        wheels, motors = config.wheels, config.motors
        self._braking = motors.acceleration_mps2
        lost_s = SILENCE_S + PERIOD_S + 0.5 * REACTION_S  # until braking begins
        self.top_speed_mps = min(wheels.max_speed_mps, self._braking * (STOP_S - lost_s))
        self.top_turn_rate_radps = wheels.max_turn_rate_radps
        self._turn_acceleration = 2.0 * self._braking / wheels.track_m
        self._overhang_m = BODY_RADIUS_M - 0.5 * config.lidar.target_diameter_m
        self._last, self._time = STILL, -math.inf
        self.halt = ""

    def allowed(self, wanted: Command | None, now: Situation, lost: str) -> Command:
        """The command to send to the board. lost: the lost sensor, as text; "": none."""
        self.halt = lost
        seconds = min(max(now.time - self._time, 0.0), 0.1)
        self._time = now.time
        if lost or wanted is None or not _finite(wanted):
            self._last = STILL
            return STILL
        command = self._slewed(self._clipped(wanted), seconds)
        self._last = self._kept_clear(command, now)
        return self._last

    def _clipped(self, wanted: Command) -> Command:
        return Command(
            _clip(wanted.speed_mps, self.top_speed_mps),
            _clip(wanted.turn_rate_radps, self.top_turn_rate_radps),
        )

    def _slewed(self, wanted: Command, seconds: float) -> Command:
        """The command limited to robot.toml's acceleration since the last one."""
        speed_change = self._braking * seconds
        rate_change = self._turn_acceleration * seconds
        last = self._last
        return Command(
            last.speed_mps + _clip(wanted.speed_mps - last.speed_mps, speed_change),
            last.turn_rate_radps
            + _clip(wanted.turn_rate_radps - last.turn_rate_radps, rate_change),
        )

    def _kept_clear(self, command: Command, now: Situation) -> Command:
        """The same arc or a tighter one, slow enough to stop before any obstacle on it."""
        if command.speed_mps == 0.0:
            return command
        things, limits = self._things(now)
        if not len(things):
            return command
        for speed in (command.speed_mps * _SHARES).tolist():
            stop_m = abs(speed) * REACTION_S + speed**2 / (2.0 * self._braking)
            places = arc(speed, command.turn_rate_radps, stop_m)
            apart = np.hypot(*(places[:, None] - things).transpose(2, 0, 1))
            if np.all(apart >= limits):
                return Command(speed, command.turn_rate_radps)
        self.halt = IN_THE_WAY
        return Command(0.0, command.turn_rate_radps)

    def _things(self, now: Situation) -> tuple[FloatArray, FloatArray]:
        """Near obstacles (k, 2) m, and the least distance (k,) m of the robot's centre to each."""
        seen = (
            BODY_RADIUS_M + self._overhang_m + MARGIN_M + MATE_MPS * np.minimum(now.ages, _OLDEST_S)
        )
        mates = now.teammates
        known = np.full(len(mates), 2.0 * BODY_RADIUS_M + MARGIN_M)
        things = np.concatenate((now.obstacles, mates))
        limits = np.concatenate((seen, known))
        distances = np.hypot(*things.T)
        near = distances < limits + STOP_S * self.top_speed_mps
        # Who is too near already may not come nearer.
        return things[near], np.minimum(limits, distances - 1e-4)[near]


def arc(speed: float, turn_rate: float, length: float) -> FloatArray:
    """Points (k, 2) m on the robot's arc of `length` (m) at this speed and turn rate."""
    count = max(1, math.ceil(length / _STEP_M))
    way = math.copysign(length, speed) * np.arange(1, count + 1) / count
    bend = way * (turn_rate / speed)
    # sinc keeps the straight line; numpy's is that of pi x.
    chord = way * np.sinc(bend / (2.0 * math.pi))
    return np.stack((chord * np.cos(0.5 * bend), chord * np.sin(0.5 * bend)), axis=1)


def _finite(command: Command) -> bool:
    return math.isfinite(command.speed_mps) and math.isfinite(command.turn_rate_radps)


def _clip(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
