"""Whatever is wanted, the robot stops before it hits anything, and where it is blind."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.behaviour.interface import STILL, Command
from host.behaviour.safety import BODY_RADIUS_M, STOP_S, Safety, arc
from host.config import RobotConfig
from host.geometry import to_frame
from host.messages import FloatArray
from tests.behaviour.situations import situation, wall

CONFIG = RobotConfig()
STEP_S = 0.02
BRAKING = CONFIG.motors.acceleration_mps2


def driven(wanted: Command, things: FloatArray, seconds: float, lag_s: float = 0.06) -> FloatArray:
    """Poses (n, 3) of a robot that obeys late and brakes as the board does, by small steps."""
    safety, poses = Safety(CONFIG), [(0.0, 0.0, 0.0)]
    sent = [STILL] * round(lag_s / STEP_S)
    speed = rate = 0.0
    for step in range(round(seconds / STEP_S)):
        x, y, heading = poses[-1]
        seen = to_frame(things, np.array(poses[-1]))
        sent.append(safety.allowed(wanted, situation(seen, step * STEP_S), ""))
        asked = sent.pop(0)
        change = BRAKING * STEP_S
        speed += min(max(asked.speed_mps - speed, -change), change)
        rate = asked.turn_rate_radps
        along = heading + 0.5 * rate * STEP_S
        poses.append(
            (
                x + speed * STEP_S * math.cos(along),
                y + speed * STEP_S * math.sin(along),
                heading + rate * STEP_S,
            )
        )
    return np.array(poses)


@settings(max_examples=25, deadline=None)
@given(
    speed=st.floats(-1.0, 1.0),
    rate=st.floats(-3.0, 3.0),
    distance=st.floats(0.35, 0.9),
    bearing=st.floats(-math.pi, math.pi),
)
def test_no_wanted_motion_ends_in_a_wall(
    speed: float, rate: float, distance: float, bearing: float
) -> None:
    things = wall(distance, bearing)
    poses = driven(Command(speed, rate), things, 4.0)
    apart = np.hypot(*np.moveaxis(poses[:, None, :2] - things, 2, 0)).min()
    assert apart > 2 * BODY_RADIUS_M - 0.0325  # a teammate may be around whatever is seen


def test_it_drives_where_there_is_room_and_comes_to_rest_before_what_is_ahead() -> None:
    poses = driven(Command(0.2, 0.0), wall(2.0), 12.0)
    assert poses[100, 0] > 0.25
    assert poses[-1, 0] == pytest.approx(poses[-50, 0])
    assert 2.0 - 0.32 < poses[-1, 0] < 2.0 - 2 * BODY_RADIUS_M + 0.0325


def test_too_near_already_it_may_leave_and_rotate_but_come_no_nearer() -> None:
    near = wall(0.2)
    for wanted, moves in ((Command(0.2, 0.0), False), (Command(-0.2, 0.0), True)):
        safety = Safety(CONFIG)
        for step in range(20):
            command = safety.allowed(wanted, situation(near, step * STEP_S), "")
        assert (command.speed_mps != 0.0) == moves
    assert Safety(CONFIG).allowed(Command(0.0, 1.0), situation(near, 1.0), "").turn_rate_radps > 0.0
    poses = driven(Command(0.0, 2.0), near, 2.0)
    assert poses[-1, 2] > 3.0
    assert np.allclose(poses[:, :2], 0.0)


def test_a_teammate_that_only_the_filter_knows_stops_it_too() -> None:
    safety = Safety(CONFIG)
    for step in range(20):
        now = situation(time=step * STEP_S, teammates=np.array([[0.3, 0.0]]))
        command = safety.allowed(Command(0.2, 0.0), now, "")
    assert command.speed_mps == 0.0
    assert safety.halt == "something is in the way"


def test_older_returns_keep_it_further_away() -> None:
    rests = []
    for age in (0.0, 0.3):
        safety, x = Safety(CONFIG), 0.0
        for step in range(300):
            seen = situation(wall(1.0 - x), step * STEP_S, age=age)
            x += STEP_S * safety.allowed(Command(0.2, 0.0), seen, "").speed_mps
        rests.append(x)
    assert rests[0] - rests[1] == pytest.approx(0.075, abs=0.02)


def test_blind_or_without_a_finite_wish_it_stands_still_at_once() -> None:
    safety = Safety(CONFIG)
    for step in range(20):
        assert safety.allowed(Command(0.2, 0.5), situation(time=step * STEP_S), "") != STILL or (
            step == 0
        )
    assert safety.allowed(Command(0.2, 0.5), situation(time=0.4), "the lidar is lost") == STILL
    assert safety.halt == "the lidar is lost"
    for wanted in (None, Command(math.nan, 0.0), Command(0.1, math.inf)):
        assert safety.allowed(wanted, situation(time=0.42), "") == STILL


def test_speed_and_acceleration_are_robot_tomls_and_leave_time_to_stop() -> None:
    safety = Safety(CONFIG)
    speeds = [
        safety.allowed(Command(9.0, 9.0), situation(time=step * STEP_S), "") for step in range(60)
    ]
    gains = np.diff([command.speed_mps for command in speeds])
    assert gains.max() <= BRAKING * STEP_S + 1e-9
    assert speeds[-1].turn_rate_radps == CONFIG.wheels.max_turn_rate_radps
    top = speeds[-1].speed_mps
    assert 0.15 < top <= CONFIG.wheels.max_speed_mps
    assert 0.09 + top / BRAKING < STOP_S
    wheels = CONFIG.wheels.model_copy(update={"max_speed_mps": 0.1})
    assert Safety(CONFIG.model_copy(update={"wheels": wheels})).top_speed_mps == 0.1


@pytest.mark.parametrize(("speed", "rate"), [(0.2, 0.0), (0.2, 1.3), (-0.2, 0.7), (0.05, -3.0)])
def test_an_arc_is_where_small_steps_lead(speed: float, rate: float) -> None:
    x = y = heading = 0.0
    length, steps = 0.3, 30000
    seconds = length / abs(speed) / steps
    for _ in range(steps):
        x += speed * seconds * math.cos(heading)
        y += speed * seconds * math.sin(heading)
        heading += rate * seconds
    assert arc(speed, rate, length)[-1] == pytest.approx([x, y], abs=1e-4)
