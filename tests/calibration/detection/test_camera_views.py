"""What the cameras detect, against the curve, clutter and noise that the simulation draws from."""

import math

import numpy as np
import pytest

from host.calibration.detection import calibrate as detection
from host.calibration.detection.camera_views import (
    bearing_noise,
    bearing_noise_sigma,
    survey_cameras,
)
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration, Fitted
from host.config import Cameras, RobotConfig
from host.geometry import to_frame, wrap
from host.messages import Bearings
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario
from tests.calibration.detection.detection_drive import bodies, camera_drive

ROOM = "arena4:seconds=150,seed=10,side_m=6,false_blobs=1,posts=0"
PER_RAD = 1.0 / math.tau  # one false blob a picture, all around


@pytest.fixture(scope="module")
def fit() -> Calibration:
    return detection.calibrate(camera_drive(ROOM))


def row(fit: Calibration, name: str) -> Fitted:
    (found,) = [row for row in fit.fitted if row.name.startswith(name)]
    return found


def test_half_range_and_clutter_are_the_simulations(fit: Calibration) -> None:
    half, clutter = row(fit, "camera half-range"), row(fit, "camera clutter")
    assert half.key == "camera.half_range_m"
    assert half.value == pytest.approx(3.0, abs=0.05)
    assert clutter.value == pytest.approx(PER_RAD, rel=0.1)
    assert row(fit, "camera detection probability").value == pytest.approx(0.9, abs=0.04)
    assert row(fit, "camera steepness").value == pytest.approx(5.0, abs=1.5)
    assert fit.failures == []


def test_halves_of_the_drive_tell_the_same(fit: Calibration) -> None:
    for found in fit.fitted:
        if found.key:
            assert found.failure == ""
    assert row(fit, "camera clutter").halves is not None


def test_robot_toml_takes_what_was_found(fit: Calibration) -> None:
    values = {key.removeprefix("camera."): value for key, value in fit.new_settings().items()}
    Cameras.model_validate({**Cameras().model_dump(), **values})


def test_pictures_can_be_drawn(fit: Calibration) -> None:
    assert len(fit.pictures) == 4
    for picture in fit.pictures:
        for series in picture.series:
            assert series.role
            assert len(series.x) == len(series.y)
            assert np.isfinite(np.concatenate((series.x, series.y))).all()


def eyes(noise_deg: float, pixels_deg: float, off_deg: float = 0.0) -> Gathered:
    """Two cameras that see half each, every teammate in view, and tell their pixels' variances."""
    scenario = parse_scenario("arena4:seconds=40,seed=5,posts=0")
    arena = Arena(scenario)
    config = RobotConfig()
    random = np.random.default_rng(8)
    gathered = Gathered(config)
    gathered.bodies = bodies(arena, scenario.seconds)
    known = config.camera.bearing_noise_rad**2 + math.radians(pixels_deg) ** 2
    noise = math.radians(math.hypot(noise_deg, pixels_deg))
    for k in range(1, 399):
        (poses,) = arena.poses(np.array([k / 10.0]))
        for eye, centre in (("front", 0.0), ("rear", math.pi)):
            origin = (0.05 * math.cos(centre), 0.0)
            seen = to_frame(poses[1:, :2], poses[0]) - origin
            bearing = np.arctan2(*seen.T[::-1]) + noise * random.standard_normal(3)
            shown = np.abs(wrap(bearing - centre)) < math.radians(100.0)
            shown &= random.random(3) < 0.8
            bearing = wrap(bearing + math.radians(off_deg))[shown]
            gathered.take(
                Bearings(
                    k / 10.0,
                    bearing,
                    np.full(len(bearing), known),
                    origin=origin,
                    view=(centre, math.radians(100.0)),
                    camera=eye,
                )
            )
    return gathered


def test_bearing_noise_is_what_the_pixels_do_not_tell() -> None:
    gathered = eyes(noise_deg=1.0, pixels_deg=0.6)
    survey = survey_cameras(gathered, gathered.tracks(), None)
    noise, mean = bearing_noise(survey, np.ones(len(survey.views), dtype=bool))
    sigma = bearing_noise_sigma(survey)
    assert math.degrees(sigma) < 0.1
    assert abs(noise - math.radians(1.0)) < 4.0 * sigma
    assert abs(math.degrees(mean)) < 0.1


def test_each_of_two_cameras_answers_for_its_own_view() -> None:
    fit = detection.calibrate(eyes(noise_deg=1.0, pixels_deg=0.6))
    assert row(fit, "camera detection probability").value == pytest.approx(0.8, abs=0.03)
    assert row(fit, "camera clutter").value < 0.005


def test_a_mounting_that_is_off_is_named_as_the_cause() -> None:
    fit = detection.calibrate(eyes(noise_deg=1.0, pixels_deg=0.5, off_deg=4.0))
    (failure,) = [f for f in fit.failures if "bearings" in f]
    assert "swarmloc calibrate camera" in failure


def test_in_a_small_room_the_half_range_is_kept() -> None:
    fit = detection.calibrate(camera_drive("arena4:seconds=30,seed=2"))
    assert "camera.half_range_m" not in fit.new_settings()
    assert "kept" in row(fit, "camera half-range").name


@pytest.mark.slow
def test_over_seeds_the_floors_hold_and_sigmas_are_honest() -> None:
    z = []
    for seed in range(10, 14):
        text = f"arena4:seconds=200,seed={seed},side_m=6,false_blobs=1,posts=0"
        fit = detection.calibrate(camera_drive(text))
        half, clutter = row(fit, "camera half-range"), row(fit, "camera clutter")
        assert half.value == pytest.approx(3.0, abs=0.05), seed
        assert clutter.value == pytest.approx(PER_RAD, rel=0.1), seed
        z.append(((half.value - 3.0) / half.sigma, (clutter.value - PER_RAD) / clutter.sigma))
    spread = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all((spread > 0.4) & (spread < 2.0)), spread
