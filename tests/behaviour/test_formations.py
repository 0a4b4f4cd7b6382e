"""The circle: with exact teammates it forms, from anywhere, and rotates; near things come first."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.behaviour.formations import CLEAR_M, WALL_M, Circle, clear, towards
from host.geometry import to_frame, wrap
from tests.behaviour.situations import situation

STEP_S = 0.05
COORDINATE = st.floats(-2.0, 2.0)


def formed(count: int, seed: int, seconds: float = 60.0, lost: int | None = None) -> np.ndarray:
    """Poses (steps, n, 3) of robots that do what they are told; `lost`: nobody sees it for 5 s."""
    random = np.random.default_rng(seed)
    poses = np.column_stack(
        (random.permutation(count) * 0.7 - 1.0, random.uniform(-1.0, 1.0, (count, 2)))
    )
    history = [poses.copy()]
    for step in range(round(seconds / STEP_S)):
        commands = []
        for robot in range(count):
            seen = [k for k in range(count) if k != robot]
            if lost is not None and 30.0 < step * STEP_S < 35.0 and lost in seen:
                seen.remove(lost)
            mates = to_frame(poses[seen, :2], poses[robot])
            commands.append(Circle().command(situation(teammates=mates)))
        for robot, command in enumerate(commands):
            heading = poses[robot, 2] + 0.5 * STEP_S * command.turn_rate_radps
            poses[robot, :2] += (
                STEP_S * command.speed_mps * np.array([math.cos(heading), math.sin(heading)])
            )
            poses[robot, 2] += STEP_S * command.turn_rate_radps
        history.append(poses.copy())
    return np.array(history)


def radii_and_gaps(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    around = poses[:, :2] - poses[:, :2].mean(axis=0)
    angles = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    return np.hypot(*around.T), np.diff(angles, append=angles[0] + 2.0 * math.pi)


@pytest.mark.parametrize(("count", "seed"), [(3, 1), (4, 2), (6, 3), (6, 4)])
def test_robots_spread_evenly_on_the_circle_and_go_round(count: int, seed: int) -> None:
    history = formed(count, seed)
    radii, gaps = radii_and_gaps(history[-1])
    assert radii == pytest.approx(np.full(count, Circle().radius_m), abs=0.03)
    assert gaps == pytest.approx(np.full(count, 2.0 * math.pi / count), abs=0.1)
    before, after = history[-20, 0], history[-1, 0]
    centre = history[-1, :, :2].mean(axis=0)
    moved = wrap(math.atan2(*(after[:2] - centre)[::-1]) - math.atan2(*(before[:2] - centre)[::-1]))
    assert 0.5 < float(moved) * Circle().radius_m / (19 * STEP_S * Circle().speed_mps) < 1.5


def test_a_teammate_that_nobody_sees_for_five_seconds_costs_shape_not_safety() -> None:
    history = formed(5, 7, lost=2)
    for poses in history[round(20.0 / STEP_S) :]:
        apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
        assert apart[np.triu_indices(5, 1)].min() > 0.45
    radii, _ = radii_and_gaps(history[-1])
    assert radii == pytest.approx(np.full(5, Circle().radius_m), abs=0.05)


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


def test_a_velocity_is_driven_forwards_or_turned_to() -> None:
    assert towards(np.array([0.2, 0.0])).speed_mps == pytest.approx(0.2)
    behind = towards(np.array([-0.2, 0.01]))
    assert (behind.speed_mps, behind.turn_rate_radps > 1.0) == (0.0, True)
    assert towards(np.array([0.01, 0.0])).turn_rate_radps == 0.0


def test_alone_it_looks_around() -> None:
    command = Circle().command(situation())
    assert (command.speed_mps, command.turn_rate_radps) == (0.0, 0.5)
