import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import BlindSector, Cameras, Lidar
from host.estimator.sensor_models import CameraModel, LidarModel, clearance_of

SECTORS = 360
OPEN = np.full(SECTORS, math.inf)
LEAST, MOST = 0.01, 0.98
PLAIN = Lidar(blind_sectors=(), detection_probability=0.9, half_range_m=2.0, max_range_m=12.0)


def lidar(bearing, distance, clearance=OPEN, measured=False, config=PLAIN):
    bearing, distance = np.atleast_1d(bearing), np.atleast_1d(np.asarray(distance, dtype=float))
    bearing = np.broadcast_to(bearing, distance.shape).astype(float)
    return LidarModel(config).detection(bearing, distance, clearance, measured)


def camera(bearing, distance, clearance=OPEN, config=Cameras()):  # noqa: B008 (it is immutable)
    distance = np.atleast_1d(np.asarray(distance, dtype=float))
    bearing = np.broadcast_to(bearing, distance.shape).astype(float)
    return CameraModel(config).detection(bearing, distance, clearance, (0.0, math.pi))


@pytest.mark.parametrize("half_range", [1.0, 2.0, 2.8])
@pytest.mark.parametrize("most", [0.5, 0.9])
def test_half_of_the_detections_are_lost_at_the_half_range(half_range, most):
    config = PLAIN.model_copy(update={"detection_probability": most, "half_range_m": half_range})
    assert lidar(0.0, half_range, config=config) == pytest.approx([most / 2])
    config = Cameras(detection_probability=most, half_range_m=half_range)
    assert camera(0.0, half_range, config=config) == pytest.approx([most / 2])


def test_the_curves_follow_the_logistic_function_and_only_fall():
    distances = np.linspace(0.2, 8.0, 200)
    for found, steepness, half_range in (
        (lidar(0.0, distances), PLAIN.range_steepness_per_m, 2.0),
        (camera(0.0, distances), Cameras().range_steepness_per_m, Cameras().half_range_m),
    ):
        curve = 0.45 * (1.0 + np.tanh(steepness * (half_range - distances) / 2.0))
        assert found == pytest.approx(np.clip(curve, LEAST, MOST), abs=1e-12)
        assert np.all(np.diff(found) <= 1e-12)


def test_detection_is_never_certain_nor_impossible():
    sure = Lidar(blind_sectors=(), detection_probability=0.9999, half_range_m=900.0)
    assert lidar(0.0, [0.5, 1e6], config=sure).tolist() == [MOST, LEAST]
    assert camera(0.0, [0.5, 1e6], config=Cameras(detection_probability=0.9999)).tolist() == [
        MOST,
        LEAST,
    ]


def test_a_blind_sector_hides_its_centre_and_lets_through_by_a_gaussian():
    """Half of its width is one sigma; the far side of the circle is as near as the near side."""
    for centre in (0.8, -3.1):
        config = PLAIN.model_copy(
            update={"blind_sectors": (BlindSector(centre_rad=centre, width_rad=0.2),)}
        )
        offsets = np.array([0.0, 0.1, 0.2, 1.0])
        for side in (-1, 1):
            bearing = np.remainder(centre + side * offsets + math.pi, math.tau) - math.pi
            plain = lidar(bearing, np.ones(4))
            expected = plain * (1.0 - np.exp(-0.5 * (offsets / 0.1) ** 2))
            assert lidar(bearing, np.ones(4), config=config) == pytest.approx(
                np.clip(expected, LEAST, MOST), rel=1e-9
            )


def test_several_blind_sectors_are_a_product():
    one = BlindSector(centre_rad=0.3, width_rad=0.2)
    two = BlindSector(centre_rad=0.45, width_rad=0.3)

    def share(*sectors):
        config = PLAIN.model_copy(update={"blind_sectors": sectors})
        return lidar(0.4, 1.0, config=config) / lidar(0.4, 1.0)

    assert share(one, two) == pytest.approx(share(one) * share(two))


def test_outside_the_field_of_view_and_under_the_least_range_nothing_is_seen():
    config = PLAIN.model_copy(update={"field_of_view_rad": math.radians(64.0), "min_range_m": 0.3})
    degrees = np.radians([0.0, 31.9, -31.9, 32.1, -32.1, 180.0])
    found = lidar(degrees, np.ones(6), config=config)
    assert found[:3] == pytest.approx(lidar(0.0, np.ones(3)))
    assert found[3:].tolist() == [LEAST] * 3
    assert lidar(0.0, [0.29], config=config).tolist() == [LEAST]
    assert lidar(0.0, [0.31], config=config)[0] > 0.8


def test_behind_something_nearer_a_target_is_seldom_seen():
    clearance = np.full(SECTORS, 1.0)
    for sensor in (lidar, camera):
        before, behind = sensor(0.0, [0.9], clearance), sensor(0.0, [1.5], clearance)
        assert before == pytest.approx(sensor(0.0, [0.9]))
        assert behind[0] < 0.25 * sensor(0.0, [1.5])[0]


def test_a_target_does_not_hide_itself():
    """Its own near side is half a turret nearer than its centre."""
    clearance = np.full(SECTORS, 1.0 - 0.0325)
    for sensor in (lidar, camera):
        assert sensor(0.0, [1.0], clearance) == pytest.approx(sensor(0.0, [1.0]))


def test_only_the_clearance_in_the_targets_own_direction_counts():
    for sector in (0, 90, 179, 180, 359):
        clearance = np.full(SECTORS, 100.0)
        clearance[sector] = 0.5
        middle = math.radians(sector - 179.5)
        beside = math.remainder(middle + math.radians(1.0), math.tau)
        assert lidar(middle, [1.0], clearance)[0] < 0.2
        assert lidar(beside, [1.0], clearance)[0] > 0.85


def test_a_scan_tells_more_than_a_guess():
    far, at_target, nothing = np.full(SECTORS, 5.0), np.full(SECTORS, 1.0), OPEN
    plain = lidar(0.0, [1.0], far, measured=True)
    assert plain == pytest.approx(lidar(0.0, [1.0], far))
    # What stands there is the target.
    assert lidar(0.0, [1.0], at_target, measured=True) == pytest.approx(plain)
    # Nothing came back: interference.
    assert lidar(0.0, [1.0], nothing, measured=True) == pytest.approx(0.05 * plain)
    assert lidar(0.0, [1.0], nothing, measured=False) == pytest.approx(plain)


@given(st.integers(0, 2**32 - 1), st.integers(0, 8))
def test_every_probability_is_one(seed, n):
    random = np.random.default_rng(seed)
    bearing = random.uniform(-math.pi, math.pi, n)
    distance = random.choice([0.0, 1e-9, 0.1, 1.0, 5.0, 1e6], n)
    clearance = random.choice([0.0, 0.5, 1.0, 5.0, math.inf], SECTORS)
    narrow = Lidar(field_of_view_rad=1.0)
    for found in (
        lidar(bearing, distance, clearance, True, narrow),
        lidar(bearing, distance, clearance, False, Lidar()),
        camera(bearing, distance, clearance),
    ):
        assert found.shape == (n,)
        assert np.all((found >= LEAST) & (found <= MOST))


def cast(angle, bearings, distances, width):
    """Which discs (`width` m across) a ray from the origin meets: their numbers."""
    met = set()
    for number, (bearing, distance) in enumerate(zip(bearings, distances, strict=True)):
        off = math.remainder(bearing - angle, math.tau)
        ahead, aside = distance * math.cos(off), distance * abs(math.sin(off))
        if ahead > 0.0 and aside < width / 2.0:
            met.add(number)
    return met


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=30)
def test_clearance_agrees_with_rays_cast_along_the_edges_of_every_sector(seed, n):
    """From 0.65 m to 3 m a turret is wider than a sector, so it meets an edge of each it is in."""
    random = np.random.default_rng(seed)
    bearings = random.uniform(-math.pi, math.pi, n)
    distances = random.uniform(0.65, 3.0, n)
    present = random.random(n) < 0.8
    clearance = clearance_of(bearings, distances, present, 0.065)
    seen = bearings[present], distances[present]
    rays = [cast(math.radians(edge - 180), *seen, 0.065) for edge in range(SECTORS + 1)]
    for sector, (before, after) in enumerate(itertools.pairwise(rays)):
        filling = [seen[1][k] for k in before & after]
        touching = [seen[1][k] for k in before | after]
        assert clearance[sector] <= min(filling, default=math.inf)
        assert clearance[sector] in [*touching, math.inf]


def test_a_nearer_target_hides_a_farther_one_across_the_seam():
    bearings = np.array([math.pi - 0.005, -math.pi + 0.005])
    clearance = clearance_of(bearings, np.array([1.0, 2.0]), np.ones(2, dtype=bool), 0.065)
    assert clearance[0] == clearance[-1] == 1.0
    assert np.isinf(clearance[180])


def test_a_target_on_the_sensor_and_no_target_at_all():
    none = np.zeros(0)
    assert np.all(np.isinf(clearance_of(none, none, np.zeros(0, dtype=bool), 0.065)))
    clearance = clearance_of(np.zeros(1), np.zeros(1), np.ones(1, dtype=bool), 0.065)
    assert set(clearance.tolist()) == {0.0, math.inf}


def test_the_clutter_is_that_of_the_configuration():
    assert LidarModel(Lidar(clutter_per_m2=0.3)).clutter == 0.3
    assert CameraModel(Cameras(clutter_per_rad=0.4)).clutter == 0.4


@pytest.mark.parametrize("centre", [0.0, 3.0, -2.0])
def test_a_picture_says_nothing_of_what_it_cannot_show(centre: float) -> None:
    bearing = np.linspace(-math.pi, math.pi, 721)
    distance = np.full(721, 1.0)
    half = math.radians(80.0)
    seen = CameraModel(Cameras()).detection(bearing, distance, OPEN, (centre, half))
    # By the angle between unit vectors, which needs no wrapping.
    inside = np.cos(bearing - centre) >= math.cos(half)
    edge = np.abs(np.cos(bearing - centre) - math.cos(half)) < 1e-9
    assert np.all((seen > 0.0) == inside, where=~edge)
    around = CameraModel(Cameras()).detection(bearing, distance, OPEN, (0.0, math.pi))
    assert np.array_equal(seen[inside & ~edge], around[inside & ~edge])


@pytest.mark.parametrize(
    ("beyond_m", "factor"), [(-0.13, 0.2), (-0.11, 1.0), (0.11, 1.0), (0.13, 1.0)]
)
def test_within_12_cm_of_the_return_a_turret_is_not_hidden(beyond_m, factor):
    model = LidarModel(Lidar(blind_sectors=()))
    place = np.zeros(1), np.ones(1)
    clear = model.detection(*place, np.full(360, 3.0), True)
    found = model.detection(*place, np.full(360, 1.0 + beyond_m), True)
    assert found == pytest.approx(factor * clear)


def test_nothing_is_detected_beyond_the_range_that_is_used():
    """Lest a teammate that drove on be missed where nobody looks for it."""
    far = Lidar(blind_sectors=(), half_range_m=5.0, max_range_m=2.5)
    assert lidar(0.0, [2.4, 2.6, 4.0], config=far).tolist() == pytest.approx([0.95, LEAST, LEAST])
