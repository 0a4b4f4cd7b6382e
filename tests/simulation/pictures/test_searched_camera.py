"""Offline pictures: whom the search finds in them, told by the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from host.config import Camera, Cameras, RobotConfig
from host.messages import Bearings, Message
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario

SMALL = Camera(
    width_px=960, height_px=540, focal_px=305.6, centre_x_px=479.5, centre_y_px=269.5, x_m=0.05
)
ROBOT = RobotConfig(
    camera=Cameras(
        front=SMALL, rear=SMALL.model_copy(update={"x_m": -0.05, "heading_rad": math.pi})
    )
)
SCENARIO = parse_scenario("arena4:seed=2,rendered=1,seconds=3,camera_hz=5,camera_delay_s=0.2")


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return list(Simulation(SCENARIO, ROBOT).messages())


def test_each_camera_tells_what_it_sees_from_where_it_is(messages: list[Message]) -> None:
    bearings = [message for message in messages if isinstance(message, Bearings)]
    assert {round(b.origin[0], 3) for b in bearings} == {0.05, -0.05}
    times = sorted({b.time for b in bearings})
    assert times == pytest.approx([k / 5.0 for k in range(15)])  # the last arrives at 3 s
    assert len(bearings) == 2 * len(times)
    for front, rear in zip(bearings[::2], bearings[1::2], strict=True):
        assert front.time == rear.time
        assert front.origin == (0.05, 0.0)
        assert rear.origin == (-0.05, 0.0)
        assert front.view != rear.view


def test_named_bearings_point_at_whom_they_name(messages: list[Message]) -> None:
    truth = Simulation(SCENARIO, ROBOT)
    named = seen = 0
    for message in messages:
        if not isinstance(message, Bearings):
            continue
        now = truth.truth(message.time)
        assert message.identities is not None
        assert len(message.identities) == len(message.bearings)
        for identity, bearing in zip(message.identities, message.bearings, strict=True):
            seen += 1
            if identity == -1:
                continue
            x, y = now.positions[list(now.identities).index(identity)] - message.origin
            off = math.remainder(bearing - math.atan2(y, x), math.tau)
            assert abs(off) < math.radians(2.0) + 0.06 / math.hypot(x, y)
            named += 1
    assert named > 25
    assert named >= 0.9 * seen


def test_the_same_scenario_gives_the_same_bearings(messages: list[Message]) -> None:
    short = replace(SCENARIO, seconds=1.0)
    again = [m for m in Simulation(short, ROBOT).messages() if isinstance(m, Bearings)]
    before = [m for m in messages if isinstance(m, Bearings)]
    assert len(again) == 2 * 5
    for one, other in zip(again, before, strict=False):
        assert np.array_equal(one.bearings, other.bearings)
        assert np.array_equal(one.identities, other.identities)  # type: ignore[arg-type]


def test_without_rendering_one_sensor_tells_all_around() -> None:
    plain = replace(SCENARIO, rendered=0, seconds=1.0)
    bearings = [m for m in Simulation(plain, ROBOT).messages() if isinstance(m, Bearings)]
    assert len(bearings) == 5
    assert {b.view for b in bearings} == {(0.0, math.pi)}


def test_what_surrounds_the_robot_is_in_its_frame_and_turns_with_it() -> None:
    simulation = Simulation(SCENARIO, ROBOT)
    for time in (0.5, 1.7, 2.9):
        here = simulation.surroundings(time)
        assert here.teammates == pytest.approx(simulation.truth(time).positions)
        assert here.posts.shape == (2, 2)
        assert here.half_side_m == 1.5
        later = simulation.surroundings(time + 0.001)
        turned = (later.pose[2] - here.pose[2]) / 0.001
        assert here.turn_rate_radps == pytest.approx(turned, abs=0.5)
        # Posts stand still: in the room they are where they were.
        c, s = math.cos(here.pose[2]), math.sin(here.pose[2])
        room = here.posts @ np.array([[c, s], [-s, c]]) + here.pose[:2]
        assert np.all(np.abs(room) < 1.5)
