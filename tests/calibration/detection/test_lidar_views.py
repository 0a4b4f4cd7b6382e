"""What the lidar detects, against counts made with the simulation's own knowledge."""

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from host.calibration.detection import calibrate as detection
from host.calibration.detection.clutter import interference
from host.calibration.detection.lidar_views import LidarSurvey, behind_something, survey_lidar
from host.calibration.detection.range_curve import RangeCurve, Views
from host.calibration.result import Calibration, Fitted
from host.config import BlindSector, Lidar, RobotConfig
from host.geometry import wrap
from host.messages import FloatArray
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario
from host.simulation.world.sensors import NOISE_RANGES_M, NOISE_STDS_M
from tests.calibration.detection.detection_drive import Count, lidar_drive, scans_only

ROOM = "arena4:seconds=50,seed=3,side_m=5"


@pytest.fixture(scope="module")
def fit() -> Calibration:
    return detection.calibrate(lidar_drive(ROOM))


@pytest.fixture(scope="module")
def count() -> Count:
    return Count(ROOM)


def row(fit: Calibration, name: str) -> Fitted:
    (found,) = [row for row in fit.fitted if row.name.startswith(name)]
    return found


def curve_by_shares(distances: FloatArray, seen: FloatArray) -> FloatArray:
    """Most, half-range, steepness: least squares through the shares seen in bins of distance."""
    edges = np.arange(0.25, 6.0, 0.25)
    total, hits = (np.histogram(d, edges)[0] for d in (distances, distances[seen]))
    some = total >= 8
    middles = (0.5 * (edges[1:] + edges[:-1]))[some]

    def logistic(r: FloatArray, most: float, half: float, steepness: float) -> FloatArray:
        return np.asarray(most / (1.0 + np.exp(steepness * (r - half))))

    shares, spread = hits[some] / total[some], 1.0 / np.sqrt(total[some])
    found = curve_fit(logistic, middles, shares, (0.9, 3.0, 3.0), sigma=spread)
    return np.asarray(found[0])


def test_the_pillars_are_found_to_a_degree(fit: Calibration) -> None:
    found = sorted((s["centre_rad"], s["width_rad"]) for s in fit.settings["lidar.blind_sectors"])
    degrees = np.degrees(np.array(found))
    assert degrees == pytest.approx(
        np.array([(-135.0, 6.0), (-45.0, 6.0), (45.0, 6.0), (135.0, 6.0)]), abs=0.5
    )


def test_clutter_is_what_is_neither_teammate_nor_post(fit: Calibration, count: Count) -> None:
    assert count.false >= 20  # enough to compare shares
    found = row(fit, "lidar clutter")
    assert found.value == pytest.approx(count.false / count.area_m2, rel=0.1)
    assert 0.0 < found.sigma < found.value


def test_the_curve_is_that_of_a_plain_count(fit: Calibration, count: Count) -> None:
    most, half, _ = curve_by_shares(count.distances, count.seen)
    found = row(fit, "lidar half-range")
    assert found.key == "lidar.half_range_m"
    assert found.value == pytest.approx(half, abs=0.1)
    assert row(fit, "lidar detection probability").value == pytest.approx(most, abs=0.03)


def test_posts_are_told_as_things_that_stand_there(fit: Calibration) -> None:
    posts = Arena(parse_scenario(ROOM)).posts
    found = np.array(fit.figures["lidar"]["standing_things"])
    assert found[np.argsort(found[:, 0])] == pytest.approx(posts[np.argsort(posts[:, 0])], abs=0.02)


def test_range_noise_is_the_simulations(fit: Calibration) -> None:
    """The simulation's noise, in units of the range, where turrets were seen."""
    ranges = np.linspace(0.75, 3.0, 50)
    share = np.interp(ranges, NOISE_RANGES_M, NOISE_STDS_M) / ranges
    found = row(fit, "lidar range noise").value
    assert share.min() < found < share.max()


def test_the_fit_passes_and_is_written(fit: Calibration) -> None:
    assert fit.failures == []
    keys = set(fit.new_settings())
    assert {
        "lidar.detection_probability",
        "lidar.half_range_m",
        "lidar.range_steepness_per_m",
        "lidar.clutter_per_m2",
        "lidar.range_noise_m",
        "lidar.blind_sectors",
    } == keys
    values = {key.removeprefix("lidar."): value for key, value in fit.new_settings().items()}
    Lidar.model_validate({**Lidar().model_dump(mode="json"), **values})  # robot.toml takes it


def test_pictures_can_be_drawn(fit: Calibration) -> None:
    assert len(fit.pictures) == 4
    for picture in fit.pictures:
        for series in picture.series:
            assert series.role
            assert len(series.x) == len(series.y)
            assert np.isfinite(series.x).all()
            assert np.isfinite(series.y).all()


def test_in_a_small_room_the_half_range_is_kept() -> None:
    fit = detection.calibrate(lidar_drive("arena4:seconds=20,seed=1"))
    assert "lidar.half_range_m" not in fit.new_settings()
    assert "lidar.range_steepness_per_m" not in fit.new_settings()
    assert "kept" in row(fit, "lidar half-range").name
    assert "lidar.detection_probability" in fit.new_settings()


def test_a_mounting_that_is_off_is_named_as_the_cause() -> None:
    gathered = lidar_drive("arena4:seconds=20,seed=1")
    lidar = gathered.config.lidar.model_copy(update={"heading_rad": math.radians(5.0)})
    off = scans_only(gathered, gathered.config.model_copy(update={"lidar": lidar}))
    (failure,) = [f for f in detection.calibrate(off).failures if "offset of candidates" in f]
    assert "swarmloc calibrate lidar" in failure


def test_a_teammate_behind_a_nearer_one_or_a_post_is_no_miss() -> None:
    """Every view that counts is clear of all nearer cylinders, by the true places of them."""
    gathered = lidar_drive("arena4:seconds=20,seed=1")
    arena = Arena(parse_scenario("arena4:seconds=20,seed=1"))
    views = survey_lidar(gathered, gathered.tracks()).views
    poses = arena.poses(views.times)
    covered = 0
    for k, pose in enumerate(poses):
        things = np.concatenate((pose[1:, :2], arena.posts)) - pose[0, :2]
        distance = np.hypot(*things.T)
        bearing = np.arctan2(*things.T[::-1])
        j = views.teammates[k] - 2
        nearer = distance < distance[j] - 0.2
        off = np.abs(wrap(bearing - bearing[j]))
        covered += bool((nearer & (off < np.arcsin(0.0325 / distance))).any())
    assert len(views) > 250
    assert covered <= 0.01 * len(views)


def test_hidden_by_the_scan_does_not_look_at_the_turret_itself() -> None:
    place = np.array([[2.0, 0.0]])
    clearance = np.full((1, 360), np.inf)
    assert not behind_something(place, clearance, Lidar())[0]
    clearance[0, 178:183] = 1.97  # the turret's own returns
    assert not behind_something(place, clearance, Lidar())[0]
    clearance[0, 180] = 1.5
    assert behind_something(place, clearance, Lidar())[0]
    clearance[0, 180] = 0.0  # not looked at
    assert not behind_something(place, clearance, Lidar())[0]


def seen_or_not(seen: list[int], nulls: list[float], distance: float = 0.8) -> LidarSurvey:
    """Turns of 0.1 s with one teammate in each."""
    n = len(seen)
    times = 0.1 * np.arange(n)
    views = Views(
        times=times,
        teammates=np.full(n, 2),
        distances=np.full(n, distance),
        bearings=np.zeros(n),
        seen=np.array(seen, dtype=bool),
        caught=np.ones(n),
        mistaken=np.zeros(n),
    )
    none = np.zeros((n, 2))
    return LidarSurvey(
        times,
        views,
        none,
        np.array(nulls),
        none,
        np.zeros((0, 3)),
        np.ones(n),
        np.zeros((n, 360)),
        np.zeros((n, 3)),
    )


def test_interference_is_counted_in_turns_and_in_a_row() -> None:
    """Three in a row and one are lost to nulls; one is missed though its samples came back."""
    curve = RangeCurve(np.array([0.9, 3.0, 5.0]), np.eye(3), True, 3.0)
    seen = [1, 0, 0, 0, 1, 1, 0, 1, 0, 1]
    nulls = [0.0, 1.0, 0.9, 1.0, 0.8, 0.0, 1.0, 0.0, 0.2, 0.0]
    every = np.ones(10, dtype=bool)
    found = interference(seen_or_not(seen, nulls), every, curve)
    assert found.share == pytest.approx(0.4)
    assert (found.mean_s, found.longest_s) == (pytest.approx(0.2), pytest.approx(0.3))
    far = interference(seen_or_not(seen, nulls, distance=2.0), every, curve)
    assert math.isnan(far.share)


def test_lidars_that_aim_at_each_other_show_as_interference() -> None:
    fit = detection.calibrate(lidar_drive("arena4:seconds=20,seed=1"))
    assert fit.figures["lidar"]["interference_share"] > 0.02


@pytest.mark.slow
def test_clutter_and_curve_are_those_of_a_plain_count() -> None:
    text = "arena4:seconds=100,seed=11,side_m=5"
    fit, count = detection.calibrate(lidar_drive(text)), Count(text)
    most, half, _ = curve_by_shares(count.distances, count.seen)
    assert row(fit, "lidar half-range").value == pytest.approx(half, abs=0.1)
    assert row(fit, "lidar detection probability").value == pytest.approx(most, abs=0.03)
    clutter = row(fit, "lidar clutter")
    assert clutter.value == pytest.approx(count.false / count.area_m2, rel=0.1)


@pytest.mark.slow
def test_odd_pillars_of_a_turned_lidar_are_found() -> None:
    odd = ((178.0, 9.0), (-20.0, 3.0), (60.3, 14.7), (100.0, 2.0))
    pillars = tuple(
        BlindSector(centre_rad=math.radians(c), width_rad=math.radians(w)) for c, w in odd
    )
    true = RobotConfig(lidar=Lidar(blind_sectors=pillars, heading_rad=0.5, x_m=0.02))
    gathered = lidar_drive("arena4:seconds=60,seed=21", true)
    # What is configured does not matter to what is found.
    lidar = true.lidar.model_copy(update={"blind_sectors": ()})
    fit = detection.calibrate(scans_only(gathered, true.model_copy(update={"lidar": lidar})))
    found = sorted((s["centre_rad"], s["width_rad"]) for s in fit.settings["lidar.blind_sectors"])
    assert np.degrees(np.array(found)) == pytest.approx(np.array(sorted(odd)), abs=1.0)
