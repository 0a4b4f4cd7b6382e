"""Furniture against other geometry: marching along beams, half planes, sampled sight lines."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import RobotConfig
from host.errors import UserError
from host.geometry import to_frame, to_parent
from host.simulation.world.arena import ARENA_STEP_S, BODY_RADIUS_M, Arena
from host.simulation.world.camera import SimulatedCamera, hidden_by_cylinders
from host.simulation.world.furniture import NO_FURNITURE, Furniture, furnish, nearest_points
from host.simulation.world.raycast import meet_boxes, straight_beams, x4_beams
from host.simulation.world.scenarios import parse_scenario
from host.simulation.world.sensors import SimulatedLidar

NOWHERE = (0.0, 0.0, 0.0)
OPEN_VIEW = RobotConfig().lidar.model_copy(update={"blind_sectors": ()})
FULL, HALF_M = "furnished6:chairs=9,tables=2,boxes=6,side_m=7", 3.5


def inside(points: np.ndarray, rectangle: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """Which points (n, 2) a rectangle covers: on the inner side of each of its four sides."""
    x, y, heading, length, width = rectangle
    covered = np.ones(len(points), dtype=bool)
    for angle, half in zip(heading + np.arange(4) * math.pi / 2, 2 * [length, width], strict=True):
        out = np.array([math.cos(angle), math.sin(angle)])
        covered &= (points - [x, y]) @ out < half / 2 + margin
    return covered


def random_boxes(random: np.random.Generator, count: int) -> np.ndarray:
    boxes = random.uniform(-1.0, 1.0, (count, 5)) * [1.4, 1.4, math.pi, 0, 0]
    boxes[:, 3:] = random.uniform(0.05, 0.6, (count, 2))
    return boxes


@pytest.mark.parametrize("seed", range(5))
def test_beams_meet_boxes_where_marching_along_them_does(seed: int) -> None:
    random = np.random.default_rng(seed)
    boxes = random_boxes(random, 6)
    origin = np.zeros((1, 2))
    boxes = np.array([box for box in boxes if not inside(origin, box, 0.1)[0]])
    beams = x4_beams(np.linspace(0, 2 * np.pi, 90), np.tile([0.0, 0.0, 0.4], (90, 1)), NOWHERE)
    hits = meet_boxes(beams, boxes)
    marks = np.arange(0.0, 3.0, 5e-4)
    assert np.isfinite(hits.distances).any()
    for k in range(90):
        points = beams.origins[k] + marks[:, None] * beams.directions[k]
        covered = np.any([inside(points, box) for box in boxes], axis=0)
        if covered.any():
            assert hits.distances[k] == pytest.approx(marks[covered.argmax()], abs=6e-4)
        else:
            assert hits.distances[k] == math.inf


def test_incidence_is_the_angle_to_the_side_that_was_met() -> None:
    raw = np.radians([0.0, 10.0, 20.0])
    beams = straight_beams(raw, np.zeros((3, 3)), NOWHERE)
    straight_on = meet_boxes(beams, np.array([[2.0, 0.0, 0.0, 1.0, 4.0]]))
    assert straight_on.incidence_cosines == pytest.approx(np.cos(raw))
    assert straight_on.distances == pytest.approx(1.5 / np.cos(raw))
    turned = meet_boxes(beams, np.array([[2.0, 0.0, math.pi / 2, 4.0, 1.0]]))
    assert turned.distances == pytest.approx(straight_on.distances)
    # A diamond of half diagonal 1: its sides are 45 degrees off.
    diamond = meet_boxes(beams, np.array([[3.0, -0.1, math.pi / 4, 1, 1]]))
    assert diamond.incidence_cosines[0] == pytest.approx(math.sqrt(0.5))


def test_the_nearest_point_of_a_rectangle_is_nearer_than_any_other_of_it() -> None:
    random = np.random.default_rng(3)
    boxes, points = random_boxes(random, 7), random.uniform(-2, 2, (40, 2))
    nearest = nearest_points(boxes, points)
    cloud = np.linspace(-0.5, 0.5, 41)
    for j, box in enumerate(boxes):
        grid = np.stack(np.meshgrid(cloud * box[3], cloud * box[4]), axis=-1).reshape(-1, 2)
        everywhere = to_parent(grid, box[:3])
        best = np.linalg.norm(points[:, None] - everywhere, axis=2).min(axis=1)
        found = np.linalg.norm(points - nearest[:, j], axis=1)
        assert np.all(found <= best + 1e-12)
        assert np.all(found >= best - 0.02)
        assert inside(nearest[:, j], box, 1e-9).all()


@pytest.mark.parametrize("seed", range(6))
def test_pieces_stand_apart_in_the_room_and_boxes_along_its_walls(seed: int) -> None:
    furniture = furnish(parse_scenario(f"{FULL},seed={seed}"))
    assert len(furniture.legs) == 4 * (9 + 2)
    assert np.all((furniture.leg_radii >= 0.01) & (furniture.leg_radii <= 0.035))
    pieces = np.concatenate((furniture.chairs, furniture.tables, furniture.boxes))
    outlines = [np.array(nearest_points(p[None], ring(p))[:, 0]) for p in pieces]
    assert max(np.abs(outline).max() for outline in outlines) <= HALF_M + 1e-9
    for one, other in itertools.combinations(outlines, 2):
        assert np.linalg.norm(one[:, None] - other, axis=2).min() > 0.4
    reach = np.array([np.abs(outline).max() for outline in outlines[-6:]])
    assert reach[::2] == pytest.approx(HALF_M)
    assert np.all(reach[1::2] < HALF_M - 0.3)


def ring(rectangle: np.ndarray) -> np.ndarray:
    """Points far around a rectangle, whose nearest points are along its outline."""
    angles = np.linspace(0, 2 * np.pi, 120)
    return rectangle[:2] + 3.0 * np.stack((np.cos(angles), np.sin(angles)), axis=1)


def test_furniture_is_the_seeds_alone() -> None:
    def same(one: Furniture, other: Furniture) -> bool:
        return all(
            np.array_equal(getattr(one, name), getattr(other, name))
            for name in ("legs", "leg_radii", "chairs", "tables", "boxes")
        )

    first = furnish(parse_scenario("furnished6:seed=3"))
    assert same(first, furnish(parse_scenario("furnished6:seed=3,robots=2,speed_mps=0.1")))
    assert not same(first, furnish(parse_scenario("furnished6:seed=4")))
    assert same(furnish(parse_scenario("arena4")), NO_FURNITURE)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_robots_drive_around_furniture_and_are_never_held(seed: int) -> None:
    arena = Arena(parse_scenario(f"{FULL},seed={seed}"))
    poses = arena.poses(np.arange(0.0, 60.0, 5 * ARENA_STEP_S))
    for robot in range(arena.count):
        for rectangle in np.concatenate((arena.furniture.chairs, arena.furniture.boxes)):
            assert not inside(poses[:, robot, :2], rectangle, BODY_RADIUS_M * math.sqrt(0.5)).any()
        legs = np.linalg.norm(poses[:, robot, None, :2] - arena.furniture.legs, axis=2)
        assert np.all(legs - arena.furniture.leg_radii >= BODY_RADIUS_M - 1e-12)
        travelled = np.linalg.norm(np.diff(poses[:, robot, :2], axis=0), axis=1)
        assert travelled.sum() > 5.0
        assert travelled[-100:].sum() > 0.3


def test_a_robot_too_fast_to_stop_is_held_at_a_box_as_by_a_bumper() -> None:
    arena = Arena(parse_scenario("furnished6:boxes=12,chairs=0,tables=0,speed_mps=2,seed=5"))
    poses = arena.poses(np.arange(0.0, 30.0, ARENA_STEP_S))
    flat = poses[:, :, :2].reshape(-1, 2)
    apart = np.linalg.norm(nearest_points(arena.furniture.boxes, flat) - flat[:, None], axis=2)
    assert BODY_RADIUS_M - 1e-12 <= apart.min() < BODY_RADIUS_M + 0.05


def test_every_return_of_a_furnished_room_lies_on_something_that_stands_there() -> None:
    scenario = replace(
        parse_scenario(f"{FULL},seed=8"),
        range_noise=0.0,
        dropout_share=0.0,
        dark_wall_share=0.0,
        grazing_deg=90.0,
        edge_mrad=0.0,
        interference_deg=0.0,
    )
    arena = Arena(scenario)
    times, raw = np.arange(714) / 5000.0, np.arange(714) * 2 * np.pi / 714
    lidar = SimulatedLidar(arena, 0, scenario, OPEN_VIEW, straight_beams)
    ranges = lidar.ranges(times, raw)
    poses = arena.poses(times)
    ends = to_parent(ranges[:, None] * np.stack((np.cos(raw), -np.sin(raw)), axis=1), poses[:, 0])
    furniture = arena.furniture
    legs = np.linalg.norm(ends[:, None] - furniture.legs, axis=2) - furniture.leg_radii
    turrets = np.linalg.norm(ends[:, None] - poses[:, 1:, :2], axis=2) - 0.0325
    boxes = [inside(ends, box, 1e-9) & ~inside(ends, box, -1e-9) for box in furniture.boxes]
    on_wall = np.abs(np.abs(ends).max(axis=1) - HALF_M) < 1e-9
    on_leg, on_box = np.abs(legs).min(axis=1) < 1e-9, np.any(boxes, axis=0)
    assert np.all(on_wall | on_leg | on_box | (np.abs(turrets).min(axis=1) < 1e-9))
    assert on_leg.sum() > 10
    assert on_box.sum() > 10
    # Nothing stands between the lidar and what it met.
    for share in np.linspace(0.05, 0.999, 60):
        points = poses[:, 0, :2] + share * (ends - poses[:, 0, :2])
        assert not np.any([inside(points, box) for box in furniture.boxes])
        apart = np.linalg.norm(points[:, None] - furniture.legs, axis=2) - furniture.leg_radii
        assert apart.min() > -1e-9


def test_a_leg_hides_a_turret_from_a_camera_if_it_covers_half_of_it() -> None:
    random = np.random.default_rng(4)
    turrets = random.uniform(-2, 2, (60, 2))
    cylinders, radii = random.uniform(-1, 1, (8, 2)), random.uniform(0.01, 0.05, 8)
    hidden = hidden_by_cylinders(turrets, cylinders, radii)
    assert hidden.any()
    for turret, is_hidden in zip(turrets, hidden, strict=True):
        distance, middle = np.hypot(*turret), math.atan2(turret[1], turret[0])
        half = math.asin(min(0.0325 / distance, 1.0))
        ways = middle + half * np.linspace(-1, 1, 2001)
        rays = np.stack((np.cos(ways), np.sin(ways)), axis=1)
        shares = [
            np.mean((np.abs(rays @ [-y, x]) < radius) & (rays @ [x, y] > 0))
            for (x, y), radius in zip(cylinders, radii, strict=True)
            if math.hypot(x, y) < distance
        ]
        if abs(max([*shares, 0.0]) - 0.5) > 2e-3:
            assert is_hidden == (max([*shares, 0.0]) > 0.5)


@pytest.mark.parametrize(("height_m", "seen_behind"), [(0.4, False), (0.2, True)])
def test_cameras_look_over_low_boxes_only(height_m: float, seen_behind: bool) -> None:
    text = f"{FULL},seed=6,camera_detection=1,camera_half_range_m=20,false_blobs=0"
    scenario = parse_scenario(f"{text},box_height_m={height_m}")
    arena = Arena(scenario)
    camera = SimulatedCamera(arena, 0, scenario)
    behind = seen = 0
    for time in np.arange(0.0, 30.0, 0.5):
        found = camera.bearings(time).identities
        (poses,) = arena.poses(np.array([time]))
        for robot in range(1, arena.count):
            way = poses[0, :2] + np.linspace(0, 1, 400)[:, None] * (poses[robot] - poses[0])[:2]
            if np.any([inside(way, box) for box in arena.furniture.boxes]):
                behind += 1
                seen += robot in found
    assert behind > 10
    assert (seen > 0.7 * behind) if seen_behind else seen == 0


def test_furniture_in_a_robots_frame_stands_where_it_stood() -> None:
    furniture = furnish(parse_scenario(FULL))
    pose = np.array([0.7, -0.4, 2.0])
    seen = furniture.seen_from(pose)
    assert to_parent(seen.legs, pose) == pytest.approx(furniture.legs)
    points = np.random.default_rng(2).uniform(-3, 3, (500, 2))
    for before, after in zip(furniture.boxes, seen.boxes, strict=True):
        assert np.array_equal(inside(points, before), inside(to_frame(points, pose), after))


def test_a_pair_drives_side_by_side_and_standing_robots_stand() -> None:
    arena = Arena(parse_scenario("arena4:robots=6,standing=2,pair_m=0.2,seed=3,side_m=4"))
    poses = arena.poses(np.arange(0.0, 60.0, ARENA_STEP_S))
    beside = to_frame(poses[:, 2, :2], poses[:, 1])
    assert beside == pytest.approx(np.tile([0.0, -0.2], (len(poses), 1)))
    assert np.array_equal(poses[:, 1, 2], poses[:, 2, 2])
    travelled = np.linalg.norm(np.diff(poses[:, :, :2], axis=0), axis=2).sum(axis=0)
    assert np.all(travelled[:4] > 5.0)
    assert np.ptp(poses[:, 4:], axis=0) == pytest.approx(0.0)
    for one, other in itertools.combinations(range(6), 2):
        if (one, other) != (1, 2):
            apart = np.linalg.norm(poses[:, one, :2] - poses[:, other, :2], axis=1)
            assert apart.min() >= 2 * BODY_RADIUS_M - 1e-12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("furnished6:chairs=40,side_m=3", "no room for the furniture of furnished6"),
        ("arena4:robots=2,pair_m=0.2", "no pair among 2 robots"),
        ("furnished6:robots=60,side_m=4,chairs=1,tables=0", "no room for 60 robots"),
    ],
)
def test_what_does_not_fit_is_said(text: str, words: str) -> None:
    with pytest.raises(UserError, match=words) as caught:
        Arena(parse_scenario(text))
    assert caught.value.next_step


@given(
    st.integers(0, 9),
    st.integers(0, 3),
    st.integers(0, 6),
    st.floats(2.5, 9.0),
    st.sampled_from([0.0, 0.2, 0.4]),
    st.integers(0, 2),
    st.floats(0.0, 2.0),
    st.integers(0, 1000),
)
@settings(max_examples=30, deadline=None)
def test_whatever_the_layout_nothing_overlaps(
    chairs: int,
    tables: int,
    boxes: int,
    side_m: float,
    pair_m: float,
    standing: int,
    speed_mps: float,
    seed: int,
) -> None:
    scenario = replace(
        parse_scenario("arena4"),
        chairs=chairs,
        tables=tables,
        boxes=boxes,
        side_m=side_m,
        pair_m=pair_m,
        standing=standing,
        speed_mps=speed_mps,
        seed=seed,
    )
    try:
        arena = Arena(scenario)
    except UserError:  # it is too full
        return
    poses = arena.poses(np.arange(0.0, 8.0, ARENA_STEP_S))
    places = poses[:, :, :2].reshape(-1, 2)
    reach = BODY_RADIUS_M - 1e-9
    assert np.abs(places).max() <= side_m / 2 - reach
    closed = nearest_points(arena.furniture.closed, places) - places[:, None]
    assert np.hypot(closed[..., 0], closed[..., 1]).min(initial=9.0) >= reach
    legs = np.linalg.norm(places[:, None] - arena.furniture.legs, axis=2)
    assert np.min(legs - arena.furniture.leg_radii, initial=9.0) >= reach
    for one, other in itertools.combinations(range(4), 2):
        if pair_m == 0.0 or (one, other) != (1, 2):
            apart = np.linalg.norm(poses[:, one, :2] - poses[:, other, :2], axis=1)
            assert apart.min() >= 2 * reach
