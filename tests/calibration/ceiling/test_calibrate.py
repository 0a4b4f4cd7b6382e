"""The ceiling camera from drawn tags, and its delay from a simulated drive."""

import dataclasses
import functools
import math
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from host.calibration.ceiling.calibrate import calibrate_delay, calibrate_view
from host.calibration.ceiling.edges import at_edges
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration
from host.calibration.robust.rigid_alignment import align
from host.cli.main import main
from host.config import Ceiling, Mocap, OverheadCamera, RobotConfig, load_config
from host.errors import UserError
from host.geometry import to_parent
from host.messages import FloatArray, Image
from host.perception.aruco import TagFinder
from host.sessions.calibrating.ceiling_pictures import tags_in_file
from tests.calibration.wheels.test_calibrate import LAG_S, gathered, wandering
from tests.calibration.wheels.test_calibrate import TRUE as TRUE_WHEELS
from tests.perception.drawn_tags import draw

pytestmark = pytest.mark.skipif(not hasattr(cv2, "aruco"), reason="this OpenCV came without ArUco")
SIZE = {"width_px": 960, "height_px": 720, "z_m": 2.5, "tilt_rad": math.pi / 2}
TRUE = Ceiling(
    eye=OverheadCamera(
        **SIZE, focal_px=700.0, centre_x_px=470.0, centre_y_px=366.0, k1=0.30, k2=0.11
    )
)
TOLD = Ceiling(
    eye=OverheadCamera(
        **SIZE, focal_px=680.0, centre_x_px=479.5, centre_y_px=359.5, k1=0.33, k2=0.13
    ).model_copy(update={"tilt_rad": math.radians(88.5), "roll_rad": math.radians(0.8)})
)
POSES = np.random.default_rng(4).uniform(-1.0, 1.0, (120, 3)) * (1.0, 1.35, math.pi)


@functools.cache
def pictures() -> list[Image]:
    """Three tags each, all over the view."""
    return [
        draw(TRUE, {n: tuple(pose) for n, pose in enumerate(POSES[k : k + 3])}, k)
        for k in range(0, len(POSES), 3)
    ]


@functools.cache
def corners() -> FloatArray:
    finder = TagFinder(TOLD)
    return np.concatenate([at_edges(each, finder.corners(each)[1]) for each in pictures()])


def ceiling_of(calibration: Calibration, told: Ceiling) -> Ceiling:
    new = {key.split(".")[-1]: value for key, value in calibration.new_settings().items()}
    return told.model_copy(
        update={"eye": OverheadCamera.model_validate(told.eye.model_dump() | new)}
    )


def place_errors_mm(ceiling: Ceiling) -> FloatArray:
    """Of the tags in all pictures, but for what moves or rotates the whole floor."""
    seen, true = [], []
    finder = TagFinder(ceiling)
    for k, picture in enumerate(pictures()):
        found = finder.find(picture, 0.0)
        seen.append(found.poses[:, :2])
        true.append(POSES[3 * k + found.identities][:, :2])
    places, truth = np.concatenate(seen), np.concatenate(true)
    pose = align(places, truth, np.ones(len(places))).pose
    return 1e3 * np.hypot(*(to_parent(places, pose) - truth).T)


def test_lens_and_mounting_come_out_of_tags_moved_through_the_view() -> None:
    found = calibrate_view(corners(), TOLD)
    assert found.failures == []
    before, after = place_errors_mm(TOLD), place_errors_mm(ceiling_of(found, TOLD))
    assert np.median(before) > 5.0
    assert np.median(after) < 2.0
    assert np.max(after) < 5.0
    limit = next(check for check in found.checks if "position on the floor" in check.name)
    assert np.max(after) < 3.0 * limit.value
    assert all(series.role for picture in found.pictures for series in picture.series)


def test_a_lens_by_checkerboards_is_held() -> None:
    told = TOLD.model_copy(
        update={"eye": TRUE.eye.model_copy(update={"tilt_rad": math.radians(88.0), "z_m": 2.51})}
    )
    found = calibrate_view(corners(), told, lens_known=True)
    fitted = ceiling_of(found, told)
    assert fitted.eye.focal_px == TRUE.eye.focal_px
    assert fitted.eye.z_m == pytest.approx(2.5, abs=0.006)
    assert np.median(place_errors_mm(fitted)) < 2.0


def test_tags_in_one_part_of_the_picture_are_refused_with_what_to_do() -> None:
    left = corners()[corners().mean(axis=1)[:, 0] < 450.0]
    found = calibrate_view(left, TOLD)
    assert any("drive a tag through all of the view" in each for each in found.failures)
    with pytest.raises(UserError, match="3 tags were seen"):
        calibrate_view(corners()[:3], TOLD)


def test_tags_of_another_size_are_refused() -> None:
    wrong = TOLD.model_copy(update={"tag_m": 0.12})
    found = calibrate_view(corners(), wrong, lens_known=True)
    assert found.failures


def test_pictures_are_read_from_a_folder_and_a_film(tmp_path: Path) -> None:
    some = pictures()[:4]
    film = b""
    for k, picture in enumerate(some):
        data = bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1])
        (tmp_path / f"{k}.jpg").write_bytes(data)
        film += data
    folder = tags_in_file(tmp_path, TOLD)
    (tmp_path / "film.mjpeg").write_bytes(film)
    played = tags_in_file(tmp_path / "film.mjpeg", TOLD)
    assert len(folder) >= 10
    np.testing.assert_array_equal(folder, played)
    small = TOLD.model_copy(update={"eye": TOLD.eye.model_copy(update={"width_px": 640})})
    with pytest.raises(UserError, match="has 960 x 720 px"):
        tags_in_file(tmp_path, small)


def test_what_is_no_picture_in_a_folder_is_named(tmp_path: Path) -> None:
    empty = tmp_path / "1.jpg"
    empty.touch()
    with pytest.raises(UserError, match=r"1\.jpg is no picture"):
        tags_in_file(tmp_path, TOLD)
    empty.unlink()
    empty.symlink_to(tmp_path / "gone.jpg")
    with pytest.raises(UserError, match=r"(?s)cannot read the picture .*1\.jpg.*No such file"):
        tags_in_file(tmp_path, TOLD)


def test_the_delay_is_what_the_wheels_lag_by() -> None:
    late = 0.08
    made = wandering(3, 60.0)
    made = dataclasses.replace(made, truth_times=made.truth_times + late)
    found = calibrate_delay(gathered(made, RobotConfig(mocap=Mocap(source="ceiling"))))
    assert found.new_settings()["mocap.ceiling.delay_s"] == pytest.approx(late - LAG_S, abs=0.013)
    with pytest.raises(UserError, match='source is "none"'):
        calibrate_delay(Gathered(RobotConfig()))


@pytest.mark.parametrize(("factor", "words"), [(1.05, r"[45]\.\d % larger"), (0.96, r"4\.\d % sm")])
def test_distances_that_are_not_those_of_the_wheels_are_named(factor: float, words: str) -> None:
    made = wandering(3, 30.0)
    truth = made.truth * (factor, factor, 1.0)
    config = RobotConfig(mocap=Mocap(source="ceiling"), wheels=TRUE_WHEELS)
    found = calibrate_delay(gathered(dataclasses.replace(made, truth=truth), config))
    (failure,) = (each for each in found.failures if "ceiling camera's distances" in each)
    assert re.search(f"distances are {words}.*than the wheels' ", failure)
    assert "[mocap.ceiling] is wrong, or the radii and track_m in [wheels] are" in failure


def test_one_wheel_of_another_radius_is_not_the_ceiling_cameras_scale() -> None:
    wheels = TRUE_WHEELS.model_copy(update={"left_radius_m": 0.035})
    config = RobotConfig(mocap=Mocap(source="ceiling"), wheels=wheels)
    found = calibrate_delay(gathered(wandering(3, 30.0), config))
    assert not any("ceiling camera's distances" in each for each in found.failures)


def test_the_command_writes_the_camera_into_robot_toml(tmp_path: Path) -> None:
    film, robot = tmp_path / "tags.mjpeg", tmp_path / "robot.toml"
    quality = [cv2.IMWRITE_JPEG_QUALITY, 95]
    film.write_bytes(b"".join(bytes(cv2.imencode(".jpg", each, quality)[1]) for each in pictures()))
    eye = TOLD.eye.model_dump(include={"width_px", "height_px", "focal_px", "k1", "k2"})
    lines = "\n".join(f"{key} = {value}" for key, value in eye.items())
    robot.write_text(f"[mocap.ceiling.eye]\ncentre_x_px = 479.5\ncentre_y_px = 359.5\n{lines}\n")
    command = ["calibrate", "ceiling", "--robot", str(robot), "--report", str(tmp_path / "r.html")]
    done = CliRunner().invoke(main, [*command, "--pictures", str(film)])
    assert done.exit_code == 0, done.output
    assert load_config(robot).mocap.ceiling.eye.focal_px == pytest.approx(700.0, abs=8.0)
    missing = CliRunner().invoke(main, command)
    assert missing.exit_code == 1
    assert "there is no ceiling camera" in missing.output
