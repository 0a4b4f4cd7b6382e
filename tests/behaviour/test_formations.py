"""Formations of robots that know each other's places: they form, from anywhere, and hold."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.behaviour.catalogue import FORMATIONS
from host.behaviour.formations.circle import RADIUS_M, Circle
from host.behaviour.formations.intruder import Enclose, Keep
from host.behaviour.formations.line import Gather, Line, main_axis
from host.behaviour.formations.motion import CLEAR_M, FASTEST_MPS, WALL_M, at_least, clear, towards
from host.geometry import rotation, to_frame, wrap
from host.messages import FloatArray
from tests.behaviour.ideal_swarm import (
    STEP_S,
    formed,
    in_sight,
    nearest,
    radii_and_gaps,
    scattered,
)
from tests.behaviour.situations import situation

COORDINATE = st.floats(-2.0, 2.0)
INTRUDER_MPS = 0.15
BODIES_TOUCH_M = 0.286


def pacing(time: float) -> tuple[float, float]:
    """An intruder that goes to and fro along 1.2 m."""
    way = (INTRUDER_MPS * time) % 2.4
    return min(way, 2.4 - way) - 0.6, 0.1


def around(history: FloatArray, robots: int, step: int) -> tuple[FloatArray, FloatArray]:
    """Radii and gaps around the intruder, or around the centroid where there is none."""
    places = history[step, :, :2]
    centre = places[-1] if len(places) > robots else places.mean(axis=0)
    return radii_and_gaps(places[:robots], centre)


@pytest.mark.parametrize(("count", "seed"), [(3, 1), (6, 3)])
def test_robots_spread_evenly_on_the_circle_and_go_round(count: int, seed: int) -> None:
    history = formed([Circle(speed_mps=0.12) for _ in range(count)], scattered(count, seed), 30.0)
    radii, gaps = around(history, count, -1)
    assert radii == pytest.approx(np.full(count, RADIUS_M), abs=0.03)
    assert gaps == pytest.approx(np.full(count, math.tau / count), abs=0.1)
    before, after = history[-10, 0], history[-1, 0]
    centre = history[-1, :, :2].mean(axis=0)
    moved = wrap(math.atan2(*(after[:2] - centre)[::-1]) - math.atan2(*(before[:2] - centre)[::-1]))
    assert 0.5 < float(moved) * RADIUS_M / (9 * STEP_S * 0.12) < 1.5


def test_the_platoon_takes_its_circle_to_the_goal() -> None:
    behaviours = [Circle(goal=(1.5, -0.5)) for _ in range(6)]
    history = formed(behaviours, scattered(6, 5), 45.0)
    radii, gaps = around(history, 6, -1)
    assert radii == pytest.approx(np.full(6, RADIUS_M), abs=0.05)
    assert gaps == pytest.approx(np.full(6, math.tau / 6), abs=0.15)
    assert history[-1, :, :2].mean(axis=0) == pytest.approx((1.5, -0.5), abs=0.1)
    assert nearest(history, 6) > BODIES_TOUCH_M


def test_a_circle_that_is_too_wide_to_be_seen_closes() -> None:
    def near(time, robot, places, numbers):
        seen = np.hypot(*places.T) < (4.0 if time < 1.0 else 2.5)
        return places[seen], numbers[seen]

    angles = math.tau * np.arange(6) / 6
    poses = np.column_stack((1.53 * np.cos(angles), 1.53 * np.sin(angles), angles))
    radii, _ = around(formed([Circle() for _ in range(6)], poses, 25.0, near), 6, -1)
    assert radii == pytest.approx(np.full(6, RADIUS_M), abs=0.05)


@pytest.mark.parametrize("seed", [1, 3])
def test_lower_tasks_do_not_add_to_the_error_of_those_above_them(seed: int) -> None:
    errors = []
    for shaped in (False, True):
        platoon = Circle(goal=(2.0, 1.0), near_m=0.9, shaped=shaped)
        others = [Circle(goal=(2.0, 1.0), near_m=0.9, shaped=shaped) for _ in range(4)]
        history = formed([platoon, *others], scattered(5, seed, 3.0), 8.0)
        errors.append(
            sum(
                sum(platoon.view_errors(mates))
                for poses in history
                for robot in range(5)
                for mates in [to_frame(np.delete(poses, robot, axis=0)[:, :2], poses[robot])]
            )
        )
    assert errors[0] > 1.0
    assert errors[1] < 1.05 * errors[0]


@pytest.mark.parametrize("seed", [1, 3])
def test_a_moving_intruder_is_shut_in(seed: int) -> None:
    history = formed(
        [Enclose() for _ in range(6)], scattered(7, seed), 35.0, in_sight, intruder=pacing
    )
    for step in range(-60, 0, 5):
        radii, gaps = around(history, 6, step)
        assert radii == pytest.approx(np.full(6, RADIUS_M), abs=0.2)
        assert gaps.max() < math.radians(90.0)
    assert nearest(history, 6) > BODIES_TOUCH_M


def lost(time, robot, places, numbers):
    """Robot 2 is known to nobody for five seconds."""
    kept = (numbers != 2) | (not 15.0 < time < 20.0)
    return places[kept], numbers[kept]


def ghost(time, robot, places, numbers):
    """A teammate that is none stands beside everyone, for five seconds."""
    if not 15.0 < time < 20.0:
        return places, numbers
    return np.vstack((places, (0.5, 0.4))), np.append(numbers, 99)


def removed(time, robot, places, numbers):
    """Robot 5 has been carried away."""
    kept = (numbers != 5) | (time < 15.0)
    return places[kept], numbers[kept]


def swapped(time, robot, places, numbers):
    """Labels change places: while the team watches, and later."""
    return places, np.roll(numbers, int(time > 1.5) + int(time > 15.0))


@pytest.mark.parametrize("known", [lost, ghost, removed, swapped])
@pytest.mark.parametrize("name", ["circle", "enclose"])
def test_formations_get_over_what_goes_wrong(name: str, known) -> None:
    watched = pacing if name == "enclose" else None
    count = 5 if known is removed else 6
    behaviours = [FORMATIONS[name]() for _ in range(6)]
    history = formed(behaviours, scattered(6 + (watched is not None), 7), 35.0, known, watched)
    if known is removed:
        history = np.delete(history, 5, axis=1)
    radii, gaps = around(history, count, -1)
    assert radii == pytest.approx(np.full(count, RADIUS_M), abs=0.2)
    assert gaps.max() < math.tau / count + math.radians(30.0)
    assert nearest(history, count) > BODIES_TOUCH_M


@pytest.mark.parametrize("seed", [1, 2])
def test_a_line_forms_though_robots_in_it_hide_each_other(seed: int) -> None:
    history = formed([Line()] * 6, scattered(6, seed), 45.0, in_sight)
    places = history[-1, :, :2] - history[-1, :, :2].mean(axis=0)
    axis = main_axis(places)
    assert np.diff(np.sort(places @ axis)) == pytest.approx(np.full(5, Line().spacing_m), abs=0.12)
    assert places @ (-axis[1], axis[0]) == pytest.approx(np.zeros(6), abs=0.05)
    assert nearest(history, 6) > BODIES_TOUCH_M


def test_one_keeps_behind_a_leader() -> None:
    def leader(time: float) -> tuple[float, float]:
        bearing = INTRUDER_MPS * time
        return math.sin(bearing), 1.0 - math.cos(bearing)

    history = formed([Keep(0.8, math.pi)], scattered(2, 1), 40.0, intruder=leader)
    for poses in history[250:]:
        ahead = poses[1, :2] - poses[0, :2]
        assert np.hypot(*ahead) == pytest.approx(0.8, abs=0.15)


def test_robots_meet_and_do_not_touch() -> None:
    history = formed([Gather()] * 5, scattered(5, 2), 30.0)
    places = history[-1, :, :2]
    assert np.hypot(*(places - places.mean(axis=0)).T).max() < 0.65
    assert nearest(history, 5) > BODIES_TOUCH_M


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=2, max_size=6, unique=True),
    st.floats(-3.0, 3.0),
    st.sampled_from(["circle", "gather", "line"]),
)
def test_nobody_has_a_name_and_no_direction_is_special(mates, angle: float, name: str) -> None:
    places = np.array(mates)
    if np.hypot(*places.T).min() < CLEAR_M or abs(_axis_margin(places)) < 1e-3:
        return
    make = FORMATIONS[name]
    plain = make().command(situation(teammates=places))
    shuffled = make().command(situation(teammates=places[::-1]))
    assert shuffled is not None
    assert plain is not None
    assert shuffled.speed_mps == pytest.approx(plain.speed_mps, abs=1e-6)
    # As seen by a robot that looks elsewhere: the way in the room is the same.
    turned = make().command(situation(teammates=places @ rotation(angle)))
    assert turned is not None
    rates = np.array([plain.turn_rate_radps, turned.turn_rate_radps]) / 3.0
    if abs(rates).min() > 1e-3 and abs(abs(rates) - math.pi).min() > 1e-3:
        assert float(wrap(rates[1] + angle - rates[0])) == pytest.approx(0.0, abs=1e-4)


def _axis_margin(mates: FloatArray) -> float:
    """How clear the main axes are that a line goes by."""
    everyone = np.vstack((np.zeros(2), mates))
    values = [np.linalg.eigvalsh(np.cov(points.T)) for points in (everyone, mates)]
    return min(float(high - low) for low, high in values)


@settings(max_examples=100, derandomize=True)
@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE, COORDINATE, COORDINATE)
def test_nothing_drives_it_towards_what_is_too_near(ax, ay, ox, oy, vx, vy) -> None:
    now = situation(np.array([[ox, oy]]), teammates=np.array([[ax, ay]]))
    velocity = clear(now, np.array([vx, vy]))
    things = [((ax, ay), CLEAR_M), ((ox, oy), WALL_M)]
    near = [place for place, least in things if math.hypot(*place) < least]
    if len(near) == 1 and math.hypot(*near[0]) > 1e-3:  # between two things both cannot be left
        assert float(velocity @ near[0]) <= 1e-9
    if not near:
        assert velocity == pytest.approx((vx, vy))


@settings(max_examples=50, derandomize=True)
@given(st.floats(-3.0, 3.0), st.floats(0.0, 0.3), COORDINATE, COORDINATE)
def test_a_task_has_its_speed_and_lower_ones_what_is_across(bearing, speed, vx, vy) -> None:
    direction = np.array([math.cos(bearing), math.sin(bearing)])
    across = np.array([-direction[1], direction[0]])
    lower = np.array([vx, vy])
    velocity = at_least(direction, speed, lower)
    wanted = max(speed, float(lower @ direction))
    assert velocity @ direction == pytest.approx(min(wanted, FASTEST_MPS))
    assert (velocity @ across) * (lower @ across) >= -1e-9
    assert abs(velocity @ across) <= abs(lower @ across) + 1e-9
    assert np.hypot(*velocity) < FASTEST_MPS + 1e-9


def test_a_velocity_is_driven_forwards_or_turned_to() -> None:
    assert towards(np.array([0.2, 0.0])).speed_mps == pytest.approx(0.2)
    behind = towards(np.array([-0.2, 0.01]))
    assert (behind.speed_mps, behind.turn_rate_radps > 1.0) == (0.0, True)
    assert towards(np.array([0.01, 0.0])).turn_rate_radps == 0.0


@pytest.mark.parametrize("name", ["circle", "gather", "line", "platoon"])
def test_alone_it_looks_around(name: str) -> None:
    command = FORMATIONS[name]().command(situation())
    assert command is not None
    assert (command.speed_mps, command.turn_rate_radps) == (0.0, 0.5)


@pytest.mark.parametrize(("name", "stands_s"), [("enclose", 2.9), ("keep", 8.0)])
def test_it_stands_and_watches_for_one_that_moves(name: str, stands_s: float) -> None:
    behaviour = FORMATIONS[name]()
    for time in np.arange(0.0, stands_s, 0.1):
        command = behaviour.command(situation(time=time, teammates=np.array([[1.0, 0.5]])))
        assert command is not None
        assert command.speed_mps == 0.0
