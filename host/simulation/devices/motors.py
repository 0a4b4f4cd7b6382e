"""Motors and wheels of a simulated robot: what its board drives turns what its board counts."""

import math
from dataclasses import dataclass

from host.config import Wheels
from host.simulation.devices.romeo_elf import LEFT, RIGHT, RomeoElf

STEPS_PER_TURN = 3840  # quadrature steps of the encoder in one turn of a wheel: 4 * 16 * 60
STEP_S = 0.001


@dataclass(frozen=True, slots=True)
class Gearmotor:
    """A DC motor with its gear, seen from the wheel's shaft; its driver's PWM acts as its mean.

        inertia w' = torque_constant i - coulomb sign(w) - viscous w
        supply duty = resistance i + torque_constant w

    As delivered: 160 rpm at 6 V and 204 rpm at 7.5 V without load, standing still below 10 % duty
    of 6 V, with a time constant of 0.1 s. Those are what is known or taken; how they split into
    resistance and torque changes nothing in w.
    """

    torque_constant_v_s: float = 0.30  # N m/A, and the back-EMF in V s/rad
    resistance_ohm: float = 4.0
    coulomb_n_m: float = 0.045
    viscous_n_m_s: float = 0.00167
    inertia_kg_m2: float = 0.00242  # with the share of the robot that the wheel moves

    @property
    def breakaway_v(self) -> float:
        """Mean voltage below which it does not start, V."""
        return self.coulomb_n_m * self.resistance_ohm / self.torque_constant_v_s

    @property
    def volts_per_speed(self) -> float:
        """What each rad/s takes beyond `breakaway_v`, V s/rad."""
        friction = self.viscous_n_m_s * self.resistance_ohm / self.torque_constant_v_s
        return self.torque_constant_v_s + friction

    @property
    def time_constant_s(self) -> float:
        """Time in which it gets to within 1/e of its final speed, s."""
        return (
            self.inertia_kg_m2
            * self.resistance_ohm
            / (self.torque_constant_v_s * self.volts_per_speed)
        )


class Wheel:
    """A wheel on its gearmotor. speed: rad/s; angle: rad since the start; forward positive.

    blocked: held fast as long as it is set. encoder: the share of its angle that is counted: 1, or
    0 where the encoder is dead, -1 where it is the wrong way round.
    """

    def __init__(self, motor: Gearmotor) -> None:
        self.motor = motor
        self.speed = 0.0
        self.angle = 0.0
        self.blocked = False
        self._encoder, self._uncounted = 1.0, 0.0

    @property
    def encoder(self) -> float:
        """Counted share of the angle from now on; what was counted before stays."""
        return self._encoder

    @encoder.setter
    def encoder(self, share: float) -> None:
        self._uncounted += (share - self._encoder) * self.angle
        self._encoder = share

    @property
    def counted(self) -> float:
        """The angle that its encoder has counted, rad."""
        return self._encoder * self.angle - self._uncounted

    def step(self, volts: float, seconds: float) -> None:
        """Go on for so long at a constant mean voltage (with sign). Exact for any length."""
        if self.blocked:
            self.speed = 0.0
            return
        while seconds > 0.0:
            if self.speed == 0.0 and abs(volts) <= self.motor.breakaway_v:
                return
            seconds -= self._until_stop(volts, seconds)

    def _until_stop(self, volts: float, seconds: float) -> float:
        """Go on for so long, or until it stops; return how long that was."""
        direction = math.copysign(1.0, self.speed or volts)
        final = (volts - direction * self.motor.breakaway_v) / self.motor.volts_per_speed
        tau = self.motor.time_constant_s
        excess = self.speed - final
        after = final + excess * math.exp(-seconds / tau)
        if after * direction >= 0.0:
            self.angle += final * seconds + tau * (self.speed - after)
            self.speed = after
            return seconds
        stop = min(seconds, tau * math.log(excess / -final))
        self.angle += final * stop + tau * self.speed
        self.speed = 0.0
        return stop


class DrivenRobot:
    """A board that drives two wheels and counts what they turn: the loop through the real sketch.

    wheels: (left, right); supply_v: battery at the motors; both may be changed at any time.
    pose: the true pose: x, y (m) and heading (rad, not wrapped), from (0, 0, 0).
    """

    def __init__(
        self,
        board: RomeoElf,
        geometry: Wheels,
        supply_v: float = 6.0,
        slip: tuple[float, float] = (0.0, 0.0),
        motor: Gearmotor | None = None,
    ) -> None:
        """geometry: the true radii and track.

        slip: share of the way of each wheel (left, right) that does not move the robot.
        """
        self.board = board
        self.supply_v = supply_v
        self.wheels = Wheel(motor or Gearmotor()), Wheel(motor or Gearmotor())
        self.pose = (0.0, 0.0, 0.0)
        self._track_m = geometry.track_m
        self._metres_per_rad = (
            geometry.left_radius_m * (1.0 - slip[LEFT]),
            geometry.right_radius_m * (1.0 - slip[RIGHT]),
        )
        self._first_steps = board.steps
        self._time = board.now

    @property
    def angles(self) -> tuple[float, float]:
        """True rotation of the wheels (left, right) since the start, rad."""
        return self.wheels[LEFT].angle, self.wheels[RIGHT].angle

    def run(self, until: float) -> None:
        """Run board and wheels until this time of the board, s, by the millisecond.

        Where the board was run without them, its wheels stood still.
        """
        if self.board.now > self._time + STEP_S:
            self._time = self.board.now
        while self._time < until:
            end = min(self._time + STEP_S, until)
            before, duties = self.angles, self.board.motors
            for wheel, duty in zip(self.wheels, duties, strict=True):
                wheel.step(duty * self.supply_v, end - self._time)
            self._turn_encoders(end)
            self._move(before)
            self.board.run(end)
            self._time = end

    def _turn_encoders(self, end: float) -> None:
        for which, wheel in enumerate(self.wheels):
            steps = self._first_steps[which] + math.floor(
                wheel.counted / (2.0 * math.pi) * STEPS_PER_TURN
            )
            self.board.turn(which, steps - self.board.steps[which], end)

    def _move(self, before: tuple[float, float]) -> None:
        left, right = (
            metres * (angle - start)
            for metres, angle, start in zip(self._metres_per_rad, self.angles, before, strict=True)
        )
        x, y, heading = self.pose
        distance, turn = (left + right) / 2.0, (right - left) / self._track_m
        # The chord of so short an arc is the arc, to the nanometre.
        along = heading + turn / 2.0
        self.pose = (
            x + distance * math.cos(along),
            y + distance * math.sin(along),
            heading + turn,
        )
