"""The wheels of a robot that obeys its board: turned by its motors, counted by its encoders.

The board runs ahead and asks for ticks; the arena follows in its own steps and asks how far the
wheels carried the robot. A robot pressed against something stays where it is, and its wheels slip.
"""

import math
from collections.abc import Callable

from host.config import Motors, Wheels
from host.simulation.devices.motors import Gearmotor, Wheel
from host.simulation.world.sensors import WheelSlip

STEP_S = 0.005  # the stand-in's speeds are taken as constant for so long
LAG_S = 0.03  # of the stand-in's speed control
COAST_S = 0.05  # time constant of wheels whose motors are off, as the firmware's on its motor model
SUPPLY_V = 6.0
Pair = tuple[float, float]


class MotorDriven:
    """Wheels on gearmotors: `duties()` are those of the board's pins at this moment."""

    def __init__(self, duties: Callable[[], Pair], motors: Motors) -> None:
        """motors: the pins are wired as they say."""
        self._duties = duties
        self._volts = (
            -SUPPLY_V if motors.left_reversed else SUPPLY_V,
            -SUPPLY_V if motors.right_reversed else SUPPLY_V,
        )
        self._wheels = Wheel(Gearmotor()), Wheel(Gearmotor())
        self._time = 0.0

    def angles(self, time: float) -> Pair:
        """How far the wheels (left, right) have rotated by `time` (s), rad; never back in time."""
        for wheel, duty, volts in zip(self._wheels, self._duties(), self._volts, strict=True):
            wheel.step(duty * volts, time - self._time)
        self._time = time
        return self._wheels[0].angle, self._wheels[1].angle


class CommandDriven:
    """Wheels that follow what a board without electronics is asked for: a fast model.

    Speeds follow commands no faster than the board's acceleration, LAG_S late, as the real control
    lets them; one that has timed out switches the motors off.
    """

    def __init__(
        self,
        speeds: Callable[[float], tuple[int, int]],
        timed_out: Callable[[float], bool],
        counts_per_turn: int,
        acceleration: float,
    ) -> None:
        """speeds(time): ticks/s (left, right) asked for. acceleration: rad/s²."""
        self._speeds, self._timed_out = speeds, timed_out
        self._rad_per_tick = 2.0 * math.pi / counts_per_turn
        self._change = acceleration * STEP_S
        self._targets, self._rates, self._angles = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        self._time = 0.0

    def angles(self, time: float) -> Pair:
        """How far the wheels (left, right) have rotated by `time` (s), rad; never back in time."""
        while self._time + STEP_S <= time + 1e-9:
            if self._timed_out(self._time):
                self._step((0, 0), math.inf, COAST_S)
            else:
                self._step(self._speeds(self._time), self._change, LAG_S)
            self._time += STEP_S
        ahead = max(time - self._time, 0.0)
        left, right = (a + ahead * r for a, r in zip(self._angles, self._rates, strict=True))
        return left, right

    def _step(self, speeds: tuple[int, int], most: float, lag_s: float) -> None:
        """most: change of a target, rad/s. lag_s: with which the wheels follow it."""
        follow = 1.0 - math.exp(-STEP_S / lag_s)
        for k, ticks_per_s in enumerate(speeds):
            change = ticks_per_s * self._rad_per_tick - self._targets[k]
            self._targets[k] += min(max(change, -most), most)
            self._rates[k] += follow * (self._targets[k] - self._rates[k])
            self._angles[k] += self._rates[k] * STEP_S


class DrivenWheels:
    """Between a board and the arena. wheels: the robot's true geometry."""

    def __init__(self, wheels: Wheels, slip: WheelSlip) -> None:
        self._radii = wheels.left_radius_m, wheels.right_radius_m
        self._track_m = wheels.track_m
        self._ticks_per_rad = wheels.counts_per_turn / (2.0 * math.pi)
        self._slip = slip
        self._motion: MotorDriven | CommandDriven | None = None
        self._known: list[tuple[float, Pair]] = [(0.0, (0.0, 0.0))]  # the last times asked for
        self._carried: Pair = (0.0, 0.0)

    def attach(self, motion: MotorDriven | CommandDriven) -> None:
        """What turns them from time 0 on."""
        self._motion = motion

    def ticks(self, time: float) -> tuple[int, int]:
        """Encoder counts (left, right) since time 0, at `time` (s), which does not run back."""
        left, right = self._angles(time)
        return math.floor(self._ticks_per_rad * left), math.floor(self._ticks_per_rad * right)

    def carried(self, until: float) -> tuple[float, float]:
        """How far they carried the robot up to `until` (s) since the last call: m, rad."""
        angles = self._angles(until)
        left, right = (
            radius * (angle - before) / (1.0 + slip)
            for radius, angle, before, slip in zip(
                self._radii, angles, self._carried, self._slip.next().tolist(), strict=True
            )
        )
        self._carried = angles
        return (left + right) / 2.0, (right - left) / self._track_m

    def _angles(self, time: float) -> Pair:
        newest, angles = self._known[-1]
        if time > newest and self._motion is not None:
            self._known = [self._known[-1], (time, self._motion.angles(time))]
            return self._known[-1][1]
        before, old = self._known[0]
        if time >= newest or newest <= before:
            return angles
        share = max(time - before, 0.0) / (newest - before)
        left, right = (a + share * (b - a) for a, b in zip(old, angles, strict=True))
        return left, right
