"""Cameras calibrated from strips of teammates, against true cameras of another making."""

import functools
import math

import numpy as np
import pytest

from host.calibration.camera.calibrate import calibrate, camera_advice
from host.calibration.camera.checkerboard import LensFit
from host.calibration.camera.fit import CameraProblem
from host.calibration.camera.pairs import CAMERAS, reference_of, strips_of
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration
from host.config import Camera, Cameras, RobotConfig
from host.errors import UserError
from host.messages import Bearings, Bodies
from host.perception.lens import Lens, View
from host.simulation.offline import Simulation
from host.simulation.world.built import built
from host.simulation.world.scenarios import parse_scenario
from tests.calibration.camera.camera_drive import FRONT, REAR, Drive, bearing_errors_deg, gather


def camera_of(gathered: Gathered, calibration: Calibration) -> Cameras:
    """The configuration with what was fitted, checked as a robot.toml is."""
    settings = gathered.config.camera.model_dump()
    for key, value in calibration.new_settings().items():
        _, *tables, name = key.split(".")
        place = settings
        for table in tables:
            place = place[table]
        place[name] = value
    return Cameras.model_validate(settings)


def p95_deg(camera: Cameras) -> float:
    return float(np.percentile(bearing_errors_deg(camera), 95))


@functools.cache
def of_500() -> tuple[Gathered, Calibration]:
    gathered = gather(Drive(), pairs=500, wrong=0.2, delay_s=0.15)
    return gathered, calibrate(gathered)


def test_500_strips_a_fifth_of_them_wrong_give_bearings_to_a_fifth_of_a_degree() -> None:
    gathered, calibration = of_500()
    camera = camera_of(gathered, calibration)
    assert p95_deg(gathered.config.camera) > 3.0
    assert p95_deg(camera) < 0.2
    assert camera.delay_s == pytest.approx(0.15, abs=0.002)
    assert calibration.fitted[-1].value == pytest.approx(math.radians(0.08), rel=0.4)
    assert calibration.failures == []
    assert 0.7 < calibration.figures["strips_used"] / calibration.figures["strips"] < 0.85


def test_every_value_comes_with_its_halves_and_what_was_configured() -> None:
    gathered, calibration = of_500()
    rows = {row.key: row for row in calibration.fitted}
    assert len(rows) == 28
    for name in CAMERAS:
        assert math.radians(60.0) < rows[f"camera.{name}.reach_rad"].value < math.radians(110.0)
    row = rows["camera.front.z_m"]
    assert (row.before, row.unit) == (gathered.config.camera.front.z_m, "mm")
    assert row.value == pytest.approx(FRONT.place[2], abs=0.002)
    assert row.halves is not None
    assert all(half == pytest.approx(row.value, abs=10 * row.sigma) for half in row.halves)


def test_pictures_show_errors_that_shrink() -> None:
    _, calibration = of_500()
    pictures = {picture.title: picture for picture in calibration.pictures}
    before, after = pictures["Errors of bearings by bearing"].series
    assert np.median(np.abs(before.y)) > 10 * np.median(np.abs(after.y))
    assert "Strips in the picture of the rear camera" in pictures
    assert all(series.role for picture in pictures.values() for series in picture.series)


def test_bearings_beyond_the_reach_of_a_lens_carry_what_they_are_off() -> None:
    """Strips within 55 deg ahead alone: the errors of those farther aside are as is written."""
    squares, within = [], []
    for seed in range(4):
        gathered = gather(Drive(ahead=True), seed=seed, wrong=0.0)
        camera = camera_of(gathered, calibrate(gathered)).front
        assert math.radians(60.0) < camera.reach_rad < math.radians(80.0)
        around = np.radians(np.arange(-88.0, 88.0, 4.0))
        points = np.stack((np.cos(around), np.sin(around), np.full(len(around), 0.2)), axis=1)
        pixels = FRONT.pixels(points)
        rays = View(camera).directions_of(pixels)
        offset = points - [camera.x_m, camera.y_m, 0.0]
        off = np.arctan2(rays[:, 1], rays[:, 0]) - np.arctan2(offset[:, 1], offset[:, 0])
        farther = Lens(camera).extrapolation_variances(pixels)
        beyond = farther > math.radians(0.05) ** 2
        squares += (off[beyond] ** 2 / farther[beyond]).tolist()
        within += np.abs(off[farther == 0.0]).tolist()
    assert max(within) < math.radians(0.3)
    assert len(squares) > 20
    assert 0.2 < np.mean(squares) < 3.0, np.mean(squares)


def test_strips_that_the_border_of_the_picture_cuts_are_left_out() -> None:
    """What is seen of them has its middle elsewhere: here 4 px nearer to that of the picture."""
    gathered = gather(Drive(), pairs=400, wrong=0.0, noise_px=0.5)
    problem = CameraProblem(strips_of(gathered), reference_of(gathered), gathered.config.camera, {})
    fit = problem.fit()
    strips, points = fit.pairs.strips, fit.pairs.points
    away = np.array([FRONT.place, REAR.place])[strips.cameras] - points
    half = 600.0 * 0.05 / np.linalg.norm(away, axis=1)
    x = np.minimum(strips.pixels[:, 0], 1919.0 - strips.pixels[:, 0])
    assert np.count_nonzero(x < half) > 3
    assert not fit.used[x < half].any()
    assert np.mean(fit.used[x > 2.0 * half + 10.0]) > 0.9


def test_60_strips_give_bearings_to_half_a_degree_and_name_what_is_missing() -> None:
    gathered = gather(Drive(), pairs=60, wrong=0.2, seed=1)
    calibration = calibrate(gathered)
    assert p95_deg(camera_of(gathered, calibration)) < 0.5
    assert any("has no views" in failure for failure in calibration.failures)


def test_views_only_ahead_are_refused_for_all_that_lies_behind_by_name() -> None:
    gathered = gather(Drive(ahead=True))
    calibration = calibrate(gathered)
    failures = "\n".join(calibration.failures)
    assert "front camera has no views beyond 60 deg left, beyond 60 deg right" in failures
    assert "rear camera has no views beyond 90 deg left, beyond 90 deg right" in failures
    assert not any(key.startswith("camera.rear") for key in calibration.new_settings())
    front = [s for s in calibration.figures["sectors"] if s["camera"] == "front" and s["pairs"] > 1]
    assert max(sector["sigma_deg"] for sector in front) < 0.3


def test_a_robot_that_spins_steadily_among_still_teammates_is_refused() -> None:
    """There a delay and a camera mounted askew are the same thing."""
    failures = "\n".join(calibrate(gather(Drive(turning=False), pairs=300)).failures)
    assert "sigma of the delay: rotate the robot to the left and to the right" in failures
    assert "neither is where the camera looks" in failures


@pytest.mark.slow
def test_sigma_is_honest_about_bearings_and_the_delay() -> None:
    """Values scatter over drives as their sigmas say.

    About their mean: the true lens is in no family of the model's, which moves them a little.
    """
    normalised = []
    first = None
    for seed in range(16):
        gathered = gather(Drive(), pairs=150, noise_px=1.5, seed=seed)
        problem = CameraProblem(
            strips_of(gathered), reference_of(gathered), gathered.config.camera, {}
        )
        first = first or problem.fit()
        fit = problem.again(first, np.full(150, True))
        assert fit is not None
        sigma = np.sqrt(np.diag(fit.covariance))
        places = [start + k for start in (8, 19) for k in range(3)]  # x, y, z of each camera
        off = fit.values - first.values
        normalised.append(off[[*places, -1]] / sigma[[*places, -1]])
    squares = np.var(normalised, axis=0, ddof=1)
    assert 0.8 < math.sqrt(np.mean(squares)) < 1.25, squares


def test_the_lidar_serves_where_there_is_no_motion_capture() -> None:
    gathered = gather(Drive(seconds=60.0), pairs=400, mocap=False, lidar_noise_m=0.02)
    calibration = calibrate(gathered)
    camera = camera_of(gathered, calibration)
    assert p95_deg(camera) < 0.8
    assert camera.delay_s == pytest.approx(0.15, abs=0.005)
    assert calibration.figures["reference"] == "lidar"
    # The noise is told, not written: the fit of detection does that.
    assert "camera.bearing_noise_rad" not in calibration.new_settings()


def test_the_lens_of_a_checkerboard_is_kept() -> None:
    camera = Camera(focal_px=615.0, centre_x_px=967.0, centre_y_px=530.0, k1=-0.02, k2=-0.003)
    none = np.zeros(0)
    corner = np.array([math.radians(110.0)])
    known = {"front": LensFit(camera, none, none, corner > 0.0, corner)}
    calibration = calibrate(gather(Drive(), pairs=300), known)
    rows = {row.key: row for row in calibration.fitted}
    for name in ("focal_px", "centre_x_px", "centre_y_px", "k1", "k2"):
        assert rows[f"camera.front.{name}"].value == getattr(camera, name)
        assert rows[f"camera.rear.{name}"].value != getattr(Camera(), name)
    assert rows["camera.front.reach_rad"].value == pytest.approx(math.radians(110.0))
    assert rows["camera.rear.reach_rad"].value < math.radians(105.0)
    assert rows["camera.front.tilt_rad"].value == pytest.approx(math.radians(43.0), abs=0.03)


def test_the_start_may_be_far_off_and_the_lens_of_another_model() -> None:
    front = Camera(lens="orthographic", focal_px=960.0, heading_rad=math.radians(-20.0))
    rear = Camera(heading_rad=math.radians(-158.0), tilt_rad=0.65)
    configured = Cameras(delay_s=0.1, front=front, rear=rear)
    gathered = gather(Drive(), pairs=300, wrong=0.4, delay_s=0.4, camera=configured)
    camera = camera_of(gathered, calibrate(gathered))
    assert camera.front.lens == "equidistant"
    assert camera.delay_s == pytest.approx(0.5, abs=0.005)
    assert p95_deg(camera) < 0.2


def test_advice_names_what_is_missing_until_nothing_is() -> None:
    gathered = Gathered(RobotConfig())
    gathered.take(Bearings(1.0, np.zeros(0), np.zeros(0), camera="rear", pixels=np.zeros((0, 2))))
    words = "\n".join(camera_advice(gathered))
    assert "drive on: 0 strips were seen so far, 200 are needed" in words
    assert "rear camera has no views beyond" in words
    assert "front camera" not in words  # nothing says that there is one
    assert camera_advice(of_500()[0]) == []


def test_what_cannot_be_fitted_at_all_is_told() -> None:
    gathered = Gathered(RobotConfig())
    with pytest.raises(UserError, match="no reference for the teammates' positions"):
        calibrate(gathered)
    gathered.take(Bodies(0.0, np.array([1]), np.zeros((1, 3))))
    with pytest.raises(UserError, match="motion capture saw no teammate"):
        calibrate(gathered)
    gathered.take(Bodies(0.01, np.array([1, 2]), np.array([[0.0, 0, 0], [1.0, 0, 0]])))
    with pytest.raises(UserError, match="there are no strips in pictures"):
        calibrate(gathered)
    elsewhere = np.array([[30.0, 1000.0]])
    gathered.take(Bearings(0.0, np.zeros(1), np.ones(1), camera="front", pixels=elsewhere))
    with pytest.raises(UserError, match="the cameras cannot be fitted"):
        calibrate(gathered)


@pytest.mark.slow
def test_a_misbuilt_robot_is_put_right_by_its_own_rendered_pictures() -> None:
    """The simulation's body of motion capture is mounted as the true robot has it."""
    scenario = parse_scenario("misbuilt4:seconds=30,seed=3,camera_hz=2.5")
    true = built(RobotConfig(), scenario)
    config = RobotConfig(mocap=true.mocap)
    gathered = Gathered(config)
    for message in Simulation(scenario, config).messages():
        gathered.take(message)
    camera = camera_of(gathered, calibrate(gathered))
    assert camera.delay_s == pytest.approx(0.3, abs=0.003)
    for name in ("front", "rear"):
        fitted, wanted = getattr(camera, name), getattr(true.camera, name)
        # The heading trades with the lens's middle; the bearing straight ahead does not.
        aside = (fitted.centre_x_px - wanted.centre_x_px) / wanted.focal_px
        off = math.remainder(fitted.heading_rad - wanted.heading_rad, math.tau)
        assert abs(off + aside / math.cos(wanted.tilt_rad)) < math.radians(0.3)
