"""Turrets in scenes whose geometry is known exactly: where they are, how sure, and what is none."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from host.config import Lidar
from host.drivers.x4.packets import UNIT_RAD, UNITS_PER_REVOLUTION, encode_revolution
from host.drivers.x4.protocol import ScanDecoder
from host.geometry import SECTORS, Path
from host.messages import Positions, Scan
from host.perception.turrets import segments as turret_segments
from host.perception.turrets import turrets
from host.simulation.world.raycast import x4_beams
from tests.perception.scene import (
    SAMPLE_RATE_HZ,
    STANDING,
    TURN_S,
    Array,
    Drive,
    Scene,
    Walls,
    take_turn,
)
from tests.x4_turns import NEXT_TURN

LIDAR = Lidar()
RADIUS = LIDAR.target_diameter_m / 2.0
ROOM: Walls = [((-3, -3), (-3, 3)), ((-3, 3), (3, 3)), ((3, 3), (3, -3)), ((3, -3), (-3, -3))]
BEARINGS = np.linspace(-math.pi, math.pi, 41)


def polar(distance: float, bearing: float) -> Array:
    return np.array([distance * math.cos(bearing), distance * math.sin(bearing)])


def turret(place: Array) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), RADIUS


def find(scan: Scan, lidar: Lidar = LIDAR, path: Path | None = None) -> Positions:
    return turrets.find(scan, lidar, path or Path())


def only_one(found: Positions) -> Array:
    assert len(found.positions) == 1
    return found.positions[0]


def with_ranges(scan: Scan, ranges: Array) -> Scan:
    return Scan(scan.time, scan.times, scan.angles, ranges)


@pytest.mark.parametrize("walls", [[], ROOM], ids=["open", "room"])
@pytest.mark.parametrize("distance", [0.2, 0.4, 0.8, 1.3, 1.9, 2.4])
def test_the_centre_is_that_of_the_cylinder_not_of_its_visible_arc(
    distance: float, walls: Walls
) -> None:
    radial, arc = [], []
    for bearing in BEARINGS:
        place = polar(distance, bearing)
        scan = take_turn(Scene([turret(place)], walls))
        error = only_one(find(scan)) - place
        assert np.hypot(*error) < 0.005, f"bearing {bearing}"
        radial.append(error @ place / distance)
        on_it = (scan.ranges > 0.0) & (scan.ranges < distance)
        arc.append(scan.ranges[on_it].mean() - distance)
    assert abs(np.mean(radial)) < 0.0005
    assert np.mean(arc) < -0.02  # what a centroid would be off by


@pytest.mark.parametrize("distance", [0.3, 1.0, 1.7, 2.4])
def test_through_the_bytes_of_an_x4(distance: float) -> None:
    raw_units = np.rint(346.6 * 64 + np.arange(714) * UNITS_PER_REVOLUTION / 714).astype(int)
    beams = x4_beams(raw_units * UNIT_RAD, np.zeros((714, 3)), (0.0, 0.0, 0.0))
    for bearing in BEARINGS[::4]:
        place = polar(distance, bearing)
        ways = Scene([turret(place)], ROOM).distances(beams.origins, beams.directions)
        ranges = np.hypot(*(beams.origins + ways[:, None] * beams.directions).T)
        packets = encode_revolution(
            raw_units % UNITS_PER_REVOLUTION, np.rint(ranges * 4000).astype(int)
        )
        (scan,) = ScanDecoder().feed(b"".join(packets) + NEXT_TURN, 0.0)
        assert np.hypot(*(only_one(find(scan)) - place)) < 0.006, f"bearing {bearing}"


@pytest.mark.parametrize("distance", [0.3, 0.7, 1.2, 1.8, 2.4])
def test_covariances_are_honest(distance: float) -> None:
    seed = round(distance * 1000)
    random = np.random.default_rng(seed)
    normalised = []
    for _ in range(250):
        place = polar(distance, random.uniform(-math.pi, math.pi))
        scan = take_turn(Scene([turret(place)], ROOM))
        noise = LIDAR.range_noise_m * np.maximum(scan.ranges, 0.3)
        scan = with_ranges(scan, scan.ranges + noise * random.standard_normal(len(noise)))
        found = find(scan)
        error = only_one(found) - place
        normalised.append(error @ np.linalg.solve(found.covariances[0], error) / 2.0)
    # Below 1, for part of what is allowed for does not happen here: ends of the arc that do not
    # return, and movement of the turret.
    assert 0.4 < np.mean(normalised) < 1.0, f"seed {seed}"
    assert np.quantile(normalised, 0.95) < 3.0, f"seed {seed}"  # chi-squared / 2 has 3.0 there


def test_the_covariance_is_wide_across_the_beam_and_grows_with_range() -> None:
    near, far = (find(take_turn(Scene([turret(polar(d, 0.0))]))).covariances[0] for d in (0.5, 2.0))
    assert far[1, 1] > far[0, 0]
    assert np.trace(far) > np.trace(near)
    assert np.abs(far[0, 1]) < 0.1 * far[0, 0]


PLACES = [polar(d, b) for d, b in ((0.5, 0.3), (1.0, 1.9), (1.6, -2.4), (2.1, -0.9), (0.8, 3.1))]


@pytest.mark.parametrize(
    "drive", [Drive(0.4, 0.0), Drive(0.0, 3.0), Drive(0.3, -2.0), Drive(-0.2, 1.5)]
)
@pytest.mark.parametrize("mounting", [(0.0, 0.0, 0.0), (0.05, -0.03, 2.0)])
def test_a_turn_taken_while_driving_shows_the_same(
    drive: Drive, mounting: tuple[float, float, float]
) -> None:
    lidar = Lidar(x_m=mounting[0], y_m=mounting[1], heading_rad=mounting[2])
    scan = take_turn(Scene([turret(p) for p in PLACES], ROOM), drive, mounting, 0.4, start=1.0)
    found = find(scan, lidar, drive.path(1.3))
    expected = drive.to_robot(np.array(PLACES), scan.time)
    assert len(found.positions) == len(PLACES)
    distances = np.hypot(*np.moveaxis(found.positions[:, None] - expected, 2, 0))
    assert distances.min(axis=0).max() < 0.005
    assert found.lags is not None
    # When the beam passed: clockwise from 0.4 rad in the lidar's frame.
    for lag, match in zip(found.lags, distances.argmin(axis=1), strict=True):
        seen = drive.to_robot(np.array(PLACES), scan.time - lag)[match] - mounting[:2]
        bearing = math.atan2(seen[1], seen[0]) - mounting[2]
        passed = ((0.4 - bearing) / math.tau % 1.0) * TURN_S
        assert scan.time - lag - 1.0 == pytest.approx(passed, abs=0.001)


@pytest.mark.parametrize("distance", [0.4, 1.0, 1.8])
@pytest.mark.parametrize("spin", [-4.0, -1.5, 1.5])
def test_a_turret_where_the_revolution_begins_and_ends_is_one(distance: float, spin: float) -> None:
    drive, mounting = Drive(0.1, spin), (0.0, 0.0, 0.0)
    place = polar(distance, 0.0)
    for off in np.linspace(-0.8, 0.8, 65):
        first_angle = off - spin  # in the robot's frame, which has rotated for one second
        scan = take_turn(Scene([turret(place)], ROOM), drive, mounting, first_angle, start=1.0)
        found = find(scan, path=drive.path(1.3))
        assert len(found.positions) <= 1, f"first angle {first_angle}"
        if spin < 0.0:  # with the beam: no bearing is left out
            assert len(found.positions) == 1, f"first angle {first_angle}"
        expected = drive.to_robot(place[None], scan.time)
        assert np.hypot(*(found.positions - expected).T) == pytest.approx(0.0, abs=0.02)


def test_the_mounting_is_applied() -> None:
    place = polar(1.2, 0.7)
    for mounting in ((0.1, 0.0, 0.0), (0.0, -0.06, 0.0), (0.0, 0.0, -1.1), (-0.08, 0.05, 3.0)):
        lidar = Lidar(x_m=mounting[0], y_m=mounting[1], heading_rad=mounting[2])
        scan = take_turn(Scene([turret(place)], ROOM), STANDING, mounting)
        assert np.hypot(*(only_one(find(scan, lidar)) - place)) < 0.003


def box(x: float, y: float, side: float) -> Walls:
    h = side / 2.0
    corners = [(x - h, y - h), (x + h, y - h), (x + h, y + h), (x - h, y + h)]
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


@pytest.mark.parametrize(
    "scene",
    [
        Scene([], ROOM),
        Scene([], box(0.0, 0.1, 1.8)),  # an unbroken wall all around
        Scene([], [*ROOM, ((0.8, -0.3), (0.8, 0.4))]),  # a board
        Scene([(1.0, 0.4, 0.1)], ROOM),  # a pipe of 20 cm
        Scene([], ROOM + box(1.0, 0.5, 0.2)),
        Scene([], [((1.0, -1.0), (1.0, 1.0)), ((1.0, 1.0), (-1.0, 1.0))]),  # a corner, seen inside
        Scene([], [((1.0, 0.0), (2.0, 1.2)), ((1.0, 0.0), (2.0, -1.2))]),  # one that points here
        Scene([(0.5, 0.2, 0.001)], ROOM),  # a wire: single returns
    ],
    ids=["room", "small room", "board", "pipe", "box", "corner inside", "corner outside", "wire"],
)
def test_what_is_not_a_turret(scene: Scene) -> None:
    for first_angle in np.linspace(0.0, math.tau, 7):
        assert len(find(take_turn(scene, first_angle=first_angle)).positions) == 0


@pytest.mark.parametrize("width", [0.03, 0.05, 0.08])
@pytest.mark.parametrize("bearing", [0.0, 0.6, -2.0])
def test_a_piece_of_wall_between_dark_stretches_is_none(width: float, bearing: float) -> None:
    scan = take_turn(Scene([], ROOM))
    x, y = scan.ranges * np.cos(scan.angles), scan.ranges * np.sin(scan.angles)
    at = np.argmin(np.abs(scan.angles - bearing))
    off = np.hypot(x - x[at], y - y[at])
    dark = (off > width / 2.0) & (off < width / 2.0 + 0.1)
    scan = with_ranges(scan, np.where(dark, 0.0, scan.ranges))
    assert len(find(scan, Lidar(max_range_m=6.0)).positions) == 0


def test_a_turret_close_to_a_wall_or_to_another_is_found() -> None:
    by_the_wall, pair = [np.array([2.0, 0.3])], [np.array([1.0, 0.1]), np.array([1.0, -0.1])]
    wall = [((2.0 + RADIUS + 0.1, -2.0), (2.0 + RADIUS + 0.1, 2.0))]
    assert np.hypot(
        *(only_one(find(take_turn(Scene([turret(by_the_wall[0])], wall)))) - [2, 0.3])
    ) < (0.005)
    found = find(take_turn(Scene([turret(p) for p in pair], ROOM))).positions
    assert found[np.argsort(-found[:, 1])] == pytest.approx(np.array(pair), abs=0.004)


def test_one_half_hidden_is_less_sure() -> None:
    behind, before = np.array([1.5, 0.0]), np.array([0.8, RADIUS])  # its edge hides one half
    found = find(take_turn(Scene([turret(behind), turret(before)], ROOM)))
    plain = find(take_turn(Scene([turret(behind)], ROOM)))
    k = int(np.argmax(found.positions[:, 0]))
    error = found.positions[k] - behind
    assert found.covariances[k, 1, 1] > plain.covariances[0, 1, 1]
    assert error @ np.linalg.solve(found.covariances[k], error) < 9.0


@pytest.mark.parametrize("diameter", [0.03, 0.065, 0.19, 0.4])
def test_the_diameter_is_a_parameter(diameter: float) -> None:
    lidar = Lidar(target_diameter_m=diameter)
    place = np.array([-1.0, 0.7])
    for seen in (0.03, 0.065, 0.19, 0.4):
        found = find(take_turn(Scene([(*place, seen / 2.0)], ROOM)), lidar)
        if seen == diameter:
            assert np.hypot(*(only_one(found) - place)) < 0.004
        elif seen > diameter:
            assert len(found.positions) == 0


def test_beyond_the_greatest_range_is_not_reported() -> None:
    scan = take_turn(Scene([turret(polar(2.0, 1.0))], ROOM))
    assert len(find(scan, Lidar(max_range_m=1.9)).positions) == 0
    assert len(find(scan, Lidar(max_range_m=2.1)).positions) == 1


@pytest.mark.parametrize("walls", [[], ROOM], ids=["open", "room"])
def test_where_a_turn_begins_does_not_matter(
    walls: Walls,
) -> None:
    scene = Scene([turret(polar(0.7, math.pi)), turret(polar(1.1, 0.5))], walls)
    whole = take_turn(scene)
    expected = find(whole).positions
    expected = expected[np.argsort(expected[:, 0])]
    assert expected == pytest.approx(np.array([[-0.7, 0.0], polar(1.1, 0.5)]), abs=0.004)
    n = len(whole.angles)
    for begin in range(0, n, 7):
        order = (np.arange(n) + begin) % n
        scan = Scan(whole.time, whole.times, whole.angles[order], whole.ranges[order])
        found = find(scan).positions
        assert found[np.argsort(found[:, 0])] == pytest.approx(expected, abs=1e-9)


def short_scan(ranges: list[float]) -> Scan:
    n = len(ranges)
    times = np.arange(n) / SAMPLE_RATE_HZ
    angles = -0.009 * np.arange(n)
    return Scan(n / SAMPLE_RATE_HZ, times, angles, np.array(ranges, dtype=float))


@pytest.mark.parametrize(
    "ranges", [[], [0.0], [0.0] * 600, [1.0], [1.0, 1.0], [0.0, 1.0, 0.0, 1.0], [1.0] * 3]
)
def test_next_to_nothing_seen(ranges: list[float]) -> None:
    found = find(short_scan(ranges), path=Drive(0.3, 1.0).path(0.2))
    assert found.positions.shape == (0, 2) or len(ranges) == 3
    assert found.covariances.shape == (len(found.positions), 2, 2)
    assert found.lags is not None
    assert found.lags.shape == (len(found.positions),)
    assert found.clearance is not None
    assert found.clearance.shape == (SECTORS,)


@given(
    ranges=arrays(
        float, 120, elements=st.one_of(st.just(0.0), st.floats(0.001, 16.38), st.floats(0.9, 1.0))
    ),
    turned=st.floats(-math.pi, math.pi),
)
def test_whatever_is_seen_the_result_is_sound(ranges: Array, turned: float) -> None:
    angles = np.mod(turned - np.arange(120) * math.tau / 120, math.tau) - math.pi
    scan = Scan(1.1, 1.0 + np.arange(120) / 1200, angles, ranges)
    found = find(scan, Lidar(max_range_m=12.0), Drive(0.3, 2.0).path(1.2))
    assert np.isfinite(found.positions).all()
    assert np.isfinite(found.covariances).all()
    assert (np.linalg.eigvalsh(found.covariances) > 0.0).all()
    assert found.lags is not None
    assert ((found.lags >= 0.0) & (found.lags <= 0.11)).all()
    assert found.clearance is not None
    assert not np.isnan(found.clearance).any()
    assert (found.clearance >= 0.0).all()


def test_clearance_is_range_infinity_or_zero() -> None:
    scene = Scene([], [((2.0, -1.0), (2.0, 1.0)), ((0.5, -0.05), (0.5, 0.05))])
    scan = take_turn(scene)
    seen = np.abs(scan.angles) < 2.0
    scan = Scan(scan.time, scan.times[seen], scan.angles[seen], scan.ranges[seen])
    clearance = find(scan).clearance
    assert clearance is not None
    middles = (np.arange(SECTORS) + 0.5) * math.tau / SECTORS - math.pi
    sector = math.tau / SECTORS
    for bearing, clear in zip(middles, clearance, strict=True):
        if abs(bearing) > 2.0 + 2.0 * sector:
            assert clear == 0.0
        elif math.atan(0.5) + 2.0 * sector < abs(bearing) < 2.0 - 2.0 * sector:
            assert clear == math.inf
        elif math.atan(0.1) + 2.0 * sector < abs(bearing) < math.atan(0.5) - 2.0 * sector:
            # The nearest in the sector and in those beside it.
            edge = max(abs(bearing) - 1.5 * sector, 0.0)
            assert 2.0 / math.cos(edge) - 1e-3 < clear <= 2.0 / math.cos(bearing)
        elif abs(bearing) < math.atan(0.1) - 2.0 * sector:
            assert clear == pytest.approx(0.5, abs=0.003)


def test_a_return_alone_before_a_wall_is_a_stray_and_two_are_none() -> None:
    wall = np.full(40, 2.0)
    for alone, others, stray in (
        ((10,), (), True),
        ((10, 13), (), True),
        ((10, 11), (), False),  # as a turret far away gives them
        ((0,), (), True),  # the scan goes round
        ((10,), range(11, 40), False),  # the wall ends there: nothing goes on behind
    ):
        ranges = wall.copy()
        ranges[list(others)] = 0.0
        ranges[list(alone)] = 1.0
        found = turret_segments.strays(ranges, ranges > 0.0, 0.065)
        assert np.flatnonzero(found).tolist() == (list(alone) if stray else [])


def test_strays_are_those_of_a_plain_loop() -> None:
    random, step = np.random.default_rng(5), turret_segments.STEP * 0.065
    for _ in range(20):
        ranges = random.choice([0.0, 1.0, 1.02, 2.0, 2.03, 3.0], 60)
        expected = []
        for k, reach in enumerate(ranges):
            near = {side: [ranges[(k + side * n) % 60] for n in (1, 2)] for side in (-1, 1)}
            near = {side: [r for r in both if r > 0.0] for side, both in near.items()}
            like = any(abs(r - reach) <= step for both in near.values() for r in both)
            goes_on = any(abs(a - b) <= step for a in near[-1] for b in near[1])
            expected.append(reach > 0.0 and not like and goes_on)
        assert turret_segments.strays(ranges, ranges > 0.0, 0.065).tolist() == expected
