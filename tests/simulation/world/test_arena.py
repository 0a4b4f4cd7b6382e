"""The arena: robots keep apart, move as a differential drive can, and always in the same way."""

import numpy as np
import pytest

from host.errors import UserError
from host.registry import SCENARIOS
from host.simulation.world.arena import ARENA_STEP_S, BODY_RADIUS_M, TURRET_RADIUS_M, Arena
from host.simulation.world.scenarios import parse_scenario


def walk(text: str, seconds: float) -> tuple[Arena, np.ndarray]:
    """An arena and its poses (k, n, 3) at every step."""
    arena = Arena(parse_scenario(text))
    poses = arena.poses(np.arange(round(seconds / ARENA_STEP_S) + 1) * ARENA_STEP_S)
    return arena, poses


@pytest.mark.parametrize(
    ("scenario", "seconds"),
    [
        ("arena4:seed=3", 120.0),
        ("swarm20:seed=2", 60.0),
        ("arena4:robots=9,posts=4,seed=5", 20.0),  # far denser than the walk's sensors like
        ("arena4:robots=12,posts=0,speed_mps=1.5,seed=1", 15.0),  # too fast to stop in time
    ],
)
def test_nothing_ever_overlaps_and_nobody_is_stuck(scenario: str, seconds: float) -> None:
    arena, poses = walk(scenario, seconds)
    xy = poses[:, :, :2]
    assert np.abs(xy).max() <= arena.half_side_m - BODY_RADIUS_M + 1e-12
    for i in range(arena.count):
        for j in range(i):
            apart = np.linalg.norm(xy[:, i] - xy[:, j], axis=1)
            assert apart.min() >= 2 * BODY_RADIUS_M - 1e-12
        for post in arena.posts:
            apart = np.linalg.norm(xy[:, i] - post, axis=1)
            assert apart.min() >= BODY_RADIUS_M + TURRET_RADIUS_M - 1e-12
        travelled = np.linalg.norm(np.diff(xy[:, i], axis=0), axis=1).sum()
        assert travelled > 0.01 * seconds


def test_robots_at_their_usual_speed_stop_well_before_they_touch() -> None:
    arena, poses = walk("arena4:seed=7", 30.0)
    assert np.abs(poses[:, :, :2]).max() < arena.half_side_m - BODY_RADIUS_M - 0.05


def test_motion_is_along_the_heading_and_within_speed_and_slew_limits() -> None:
    _, poses = walk("arena4:seed=4", 20.0)
    step = np.diff(poses, axis=0)
    middle = poses[:-1, :, 2] + 0.5 * step[:, :, 2]
    sideways = step[:, :, 1] * np.cos(middle) - step[:, :, 0] * np.sin(middle)
    forward = step[:, :, 0] * np.cos(middle) + step[:, :, 1] * np.sin(middle)
    assert np.abs(sideways).max() < 1e-12
    assert forward.min() > -1e-12
    assert forward.max() / ARENA_STEP_S == pytest.approx(0.3)
    assert np.abs(step[:, :, 2]).max() / ARENA_STEP_S == pytest.approx(3.0)
    assert np.abs(np.diff(forward, axis=0)).max() / ARENA_STEP_S**2 < 1.0 + 1e-6
    # Straight on most of the time, and both ways of turning in use.
    assert np.mean(np.abs(step[:, :, 2]) < 1e-9) > 0.5
    assert (step[:, :, 2] < -0.05).any()
    assert (step[:, :, 2] > 0.05).any()


def test_the_motion_does_not_depend_on_how_it_is_asked_for() -> None:
    times = np.random.default_rng(1).uniform(0.0, 8.0, 300)
    at_once = Arena(parse_scenario("arena4:seed=9")).poses(times)
    piecewise = Arena(parse_scenario("arena4:seed=9"))
    for until in (0.013, 3.0, 3.001, 7.99):
        piecewise.advance(until)
    one_by_one = np.concatenate([piecewise.poses(times[k : k + 1]) for k in range(len(times))])
    assert np.array_equal(at_once, one_by_one)
    assert not np.array_equal(at_once, Arena(parse_scenario("arena4:seed=10")).poses(times))


def test_poses_between_steps_lie_between_them_and_the_past_stands_still() -> None:
    arena = Arena(parse_scenario("arena4:seed=2"))
    before, between, after, past = arena.poses(np.array([5.0, 5.005, 5.02, -3.0]))
    assert between == pytest.approx(0.75 * before + 0.25 * after)
    assert past == pytest.approx(arena.poses(np.array([0.0]))[0])


def test_sensor_noise_does_not_change_the_motion() -> None:
    times = np.arange(0.0, 10.0, 0.5)
    noisy = Arena(
        parse_scenario("arena4:seed=1,bearing_noise_deg=20,wheel_slip=0.2,dropout_share=0.5")
    )
    assert np.array_equal(noisy.poses(times), Arena(parse_scenario("arena4:seed=1")).poses(times))


def test_scenarios_are_read_as_written() -> None:
    arena4, swarm20 = (
        parse_scenario("arena4"),
        parse_scenario("swarm20:seconds=30,seed=7,camera_hz=5"),
    )
    assert (arena4.robots, arena4.posts, arena4.side_m) == (4, 2, 3.0)
    assert (swarm20.robots, swarm20.posts, swarm20.side_m) == (20, 6, 6.0)
    assert (swarm20.seconds, swarm20.seed, swarm20.camera_hz) == (30.0, 7, 5.0)
    known = {"arena4", "swarm20", "furnished6", "formation6", "enclosure7", "misbuilt4"}
    assert set(SCENARIOS.names()) == known | {"belaroussi1", "belaroussi2", "belaroussi3"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("arena5", ["arena5", "arena4, swarm20"]),
        ("", ["arena4, swarm20"]),
        ("arena4:sed=1", ["sed", "seed", "seconds"]),
        ("arena4:name=x", ["name", "known"]),
        ("arena4:seconds", ["seconds", "0.1"]),
        ("arena4:seed=1.5", ["seed", "whole number"]),
        ("arena4:seed=-1", ["seed", "from 0"]),
        ("arena4:seconds=nan", ["seconds", "nan"]),
        ("arena4:robots=61", ["robots", "from 1 to 60"]),
        ("arena4:dropout_share=0.95", ["dropout_share", "0.9"]),
        ("arena4:seed=1,seed=2", ["seed", "twice"]),
        ("arena4:seed=1,", ["no setting ''"]),
    ],
)
def test_what_is_wrong_with_a_scenario_is_said(text: str, words: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        parse_scenario(text)
    for word in words:
        assert word in str(caught.value)
    assert caught.value.next_step


def test_too_many_robots_for_the_room_are_refused() -> None:
    with pytest.raises(UserError, match="no room for 60 robots"):
        Arena(parse_scenario("arena4:robots=60"))
    with pytest.raises(UserError, match="no room for 4 robots"):
        Arena(parse_scenario("arena4:fence_m=0.5"))
