"""The motor against its formula and a solver; the robot against circles."""

import math
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from host.config import Wheels
from host.simulation.devices.motors import STEPS_PER_TURN, DrivenRobot, Gearmotor, Wheel

MOTOR = Gearmotor()
RPM = 2.0 * math.pi / 60.0
VOLTS = st.floats(-9.0, 9.0)


def turned(volts: float, seconds: float, speed: float = 0.0) -> Wheel:
    wheel = Wheel(MOTOR)
    wheel.speed = speed
    wheel.step(volts, seconds)
    return wheel


def test_it_runs_as_fast_as_the_motors_do() -> None:
    assert turned(6.0, 5.0).speed == pytest.approx(160 * RPM, rel=0.01)
    assert turned(7.5, 5.0).speed == pytest.approx(200 * RPM, rel=0.03)
    assert turned(-6.0, 5.0).speed == pytest.approx(-160 * RPM, rel=0.01)


def test_it_gets_there_with_its_time_constant() -> None:
    final = turned(6.0, 5.0).speed
    assert turned(6.0, 0.1).speed == pytest.approx(final * (1.0 - 1.0 / math.e), rel=0.01)
    assert MOTOR.time_constant_s == pytest.approx(0.1, rel=0.01)


def test_friction_holds_it_below_a_tenth_of_the_duty_and_stops_it() -> None:
    assert turned(0.59, 5.0).angle == 0.0
    assert turned(-0.59, 5.0).angle == 0.0
    assert turned(0.61, 5.0).speed > 0.0
    coasting = turned(0.0, 5.0, speed=10.0)
    assert coasting.speed == 0.0
    assert 0.0 < coasting.angle < 10.0 * MOTOR.time_constant_s


def torques(_: float, state: list[float], volts: float) -> list[float]:
    """The equation of Gearmotor; friction smooth within 1 mrad/s, at which a held wheel creeps."""
    speed = state[1]
    current = (volts - MOTOR.torque_constant_v_s * speed) / MOTOR.resistance_ohm
    friction = MOTOR.coulomb_n_m * math.tanh(speed / 1e-3) + MOTOR.viscous_n_m_s * speed
    return [speed, (MOTOR.torque_constant_v_s * current - friction) / MOTOR.inertia_kg_m2]


@pytest.mark.parametrize(
    ("volts", "speed", "seconds"),
    [(6.0, 0.0, 0.3), (3.0, 15.0, 0.2), (-6.0, 15.0, 0.4), (-0.4, 8.0, 0.5), (0.4, -8.0, 0.5)],
)
def test_it_moves_as_a_solver_says(volts: float, speed: float, seconds: float) -> None:
    solution = solve_ivp(
        torques, (0.0, seconds), [0.0, speed], "LSODA", args=(volts,), rtol=1e-8, atol=1e-8
    )
    angle, after = solution.y[:, -1]
    wheel = turned(volts, seconds, speed)
    assert wheel.angle == pytest.approx(angle, abs=5e-4)
    assert wheel.speed == pytest.approx(after, abs=2e-3)


@given(VOLTS, st.floats(-20.0, 20.0), st.floats(0.0, 0.5), st.floats(0.0, 0.5))
def test_how_it_is_cut_into_steps_changes_nothing(
    volts: float, speed: float, first: float, then: float
) -> None:
    whole = turned(volts, first + then, speed)
    parts = turned(volts, first, speed)
    parts.step(volts, then)
    assert parts.speed == pytest.approx(whole.speed, abs=1e-6)
    assert parts.angle == pytest.approx(whole.angle, abs=1e-6)


@given(st.lists(VOLTS, max_size=20))
def test_backward_is_forward_mirrored(volts: list[float]) -> None:
    forward, backward = Wheel(MOTOR), Wheel(MOTOR)
    for v in volts:
        forward.step(v, 0.03)
        backward.step(-v, 0.03)
    assert (backward.angle, backward.speed) == (-forward.angle, -forward.speed)


def test_a_blocked_wheel_stands_and_starts_anew() -> None:
    wheel = turned(6.0, 1.0)
    angle = wheel.angle
    wheel.blocked = True
    wheel.step(6.0, 1.0)
    assert (wheel.angle, wheel.speed) == (angle, 0.0)
    wheel.blocked = False
    wheel.step(6.0, 0.1)
    assert wheel.speed == turned(6.0, 0.1).speed


@dataclass
class ToldBoard:
    """A board that drives its motors as told; its encoders are where they were turned to."""

    motors: tuple[float, float]
    now: float = 0.0
    made: list[int] = field(default_factory=lambda: [0, 0])

    @property
    def steps(self) -> tuple[int, int]:
        return self.made[0], self.made[1]

    def turn(self, wheel: int, steps: int, until: float) -> None:
        assert self.now <= until
        self.made[wheel] += steps

    def run(self, until: float) -> None:
        self.now = until


def test_encoders_follow_the_wheels_down_to_the_step() -> None:
    robot = DrivenRobot(ToldBoard((0.5, -0.9), made=[7, -7]), Wheels())
    robot.run(1.0)
    reference = [turned(duty * 6.0, 1.0) for duty in (0.5, -0.9)]
    assert robot.angles == pytest.approx([wheel.angle for wheel in reference])
    for steps, first, angle in zip(robot.board.steps, (7, -7), robot.angles, strict=True):
        assert 0.0 <= angle / (2.0 * math.pi) * STEPS_PER_TURN - (steps - first) < 1.0


@pytest.mark.parametrize("slip", [(0.0, 0.0), (0.1, 0.1), (0.0, 0.2)])
def test_the_robot_drives_an_arc(slip: tuple[float, float]) -> None:
    geometry = replace_wheels(left_radius_m=0.032, right_radius_m=0.033, track_m=0.15)
    robot = DrivenRobot(ToldBoard((0.5, 0.8)), geometry, slip=slip)
    robot.run(1.0)
    start, before = robot.pose, robot.angles
    robot.run(3.0)
    left = 0.032 * (1.0 - slip[0]) * (robot.angles[0] - before[0])
    right = 0.033 * (1.0 - slip[1]) * (robot.angles[1] - before[1])
    # The wheels' circles have one centre, a track apart: at steady speed by now.
    turn = (right - left) / 0.15
    radius = 0.5 * (right + left) / turn
    x, y, heading = start
    assert robot.pose[2] == pytest.approx(heading + turn)
    assert robot.pose[0] == pytest.approx(
        x + radius * (math.sin(heading + turn) - math.sin(heading)), abs=2e-4
    )
    assert robot.pose[1] == pytest.approx(
        y - radius * (math.cos(heading + turn) - math.cos(heading)), abs=2e-4
    )


def replace_wheels(**changes: float) -> Wheels:
    return Wheels().model_copy(update=changes)


def test_supply_and_motor_are_the_callers() -> None:
    weak = replace(MOTOR, inertia_kg_m2=2.0 * MOTOR.inertia_kg_m2)
    robot = DrivenRobot(ToldBoard((1.0, 1.0)), Wheels(), supply_v=3.0, motor=weak)
    robot.run(5.0)
    slow = robot.wheels[0].speed
    robot.supply_v = 6.0
    robot.run(10.0)
    assert (robot.wheels[0].speed - slow) * MOTOR.volts_per_speed == pytest.approx(3.0, rel=1e-3)


def test_time_that_the_board_ran_alone_is_not_made_up_for() -> None:
    board = ToldBoard((1.0, 1.0))
    robot = DrivenRobot(board, Wheels())
    board.run(2.0)
    robot.run(2.1)
    assert robot.angles[0] == pytest.approx(turned(6.0, 0.1).angle)
