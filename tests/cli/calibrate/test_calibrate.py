"""`swarmloc calibrate wheels|lidar|camera|detection`, as a person uses them."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from host import config
from host.cli.main import main
from host.config import RobotConfig
from host.messages import Bodies, Displacement
from host.recording.log import Recording
from host.sessions.calibrating.gathering import with_mocap
from host.simulation.world.built import built
from host.simulation.world.scenarios import parse_scenario

EXAMPLE = Path(__file__).parents[3] / "robots" / "cherokey.toml"
DRIVE = "arena4:seed=1,seconds=60,misbuilt=1,lidar_delay_s=0.08,camera_delay_s=0.15,mocap_hz=100"
TRUE = built(RobotConfig(), parse_scenario(DRIVE))


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, [*map(str, arguments)])


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of a robot that is not as its configuration says."""
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    result = run("simulate", DRIVE, "--sensors", "lidar", "--output", path)
    assert result.exit_code == 0, result.output
    return path


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    return Path(shutil.copyfile(EXAMPLE, tmp_path / "robot.toml"))


def calibrate(kind: str, *arguments: str | Path, folder: Path) -> Result:
    report = folder / f"{kind}.html"
    return run("calibrate", kind, *arguments, "--report", report)


def test_one_drive_calibrates_wheels_then_all_that_was_recorded(
    drive: Path, robot: Path, tmp_path: Path
) -> None:
    figures = tmp_path / "wheels.json"
    result = calibrate("wheels", drive, "--robot", robot, "--json", figures, folder=tmp_path)
    assert result.exit_code == 0, result.output
    assert f"written to {robot}" in result.output
    wheels = config.load_config(robot).wheels
    assert wheels.left_radius_m == pytest.approx(TRUE.wheels.left_radius_m, rel=0.005)
    assert wheels.right_radius_m == pytest.approx(TRUE.wheels.right_radius_m, rel=0.005)
    assert wheels.track_m == pytest.approx(TRUE.wheels.track_m, rel=0.01)
    assert json.loads(figures.read_text())["result"]["passed"] is True
    assert "<svg" in (tmp_path / "wheels.html").read_text()

    result = calibrate("all", drive, "--robot", robot, folder=tmp_path)
    assert "camera: left out" in result.output
    assert "together: wheels, lidar, without camera" in result.output
    written = config.load_config(robot)
    lidar = written.lidar
    assert lidar.heading_rad == pytest.approx(TRUE.lidar.heading_rad, abs=0.0035)
    assert lidar.x_m == pytest.approx(TRUE.lidar.x_m, abs=0.003)
    assert lidar.delay_s == pytest.approx(0.08, abs=0.005)
    notes = re.findall(
        r"^# (?:wheels|lidar) calibrated \d{4}-\d\d-\d\d from (\S+): .*rms", robot.read_text(), re.M
    )
    assert set(notes) == {str(drive)}

    # Pivots are above the turrets here.
    turrets = np.array([(turret.x_m, turret.y_m) for turret in written.mocap.turrets])
    assert np.abs(turrets).max() < 1e-3
    assert [turret.body for turret in written.mocap.turrets] == [2, 3, 4]
    fits = json.loads((tmp_path / "robot.covariance.json").read_text())["fits"]
    assert {"wheels.track_m", "mocap.x_m", "lidar.delay_s"} <= set(fits["joint"]["keys"])


def test_a_recording_is_scored_by_its_motion_capture(drive: Path, tmp_path: Path) -> None:
    """Truth from bodies, and readings as the given robot.toml would have had them."""
    true = tmp_path / "true.json"
    robot = tmp_path / "robot.toml"
    robot.write_text(
        f"[lidar]\nx_m = {TRUE.lidar.x_m}\nheading_rad = {TRUE.lidar.heading_rad}\n"
        f"delay_s = 0.08\n[wheels]\nleft_radius_m = {TRUE.wheels.left_radius_m}\n"
        f"right_radius_m = {TRUE.wheels.right_radius_m}\ntrack_m = {TRUE.wheels.track_m}\n"
    )
    result = run("evaluate", drive, "--robot", robot, "--filters", "phd", "--json", true)
    assert result.exit_code == 0, result.output
    before = tmp_path / "before.json"
    assert run("evaluate", drive, "--filters", "phd", "--json", before).exit_code == 0
    good, bad = (
        min(row["gospa_m"] for row in json.loads(path.read_text())["rows"])
        for path in (true, before)
    )
    assert good < 0.6 * bad


def test_a_fit_that_fails_is_not_written_unless_accepted(robot: Path, tmp_path: Path) -> None:
    source = with_mocap("arena4:seed=1,seconds=4")
    figures = tmp_path / "wheels.json"
    result = calibrate("wheels", source, "--robot", robot, "--json", figures, folder=tmp_path)
    assert result.exit_code == 1
    assert "the wheels calibration is refused; nothing is written" in result.output
    assert robot.read_text() == EXAMPLE.read_text()
    told = json.loads(figures.read_text())["result"]
    assert told["passed"] is False
    assert told["failures"]
    assert (tmp_path / "wheels.html").exists()

    result = calibrate("wheels", source, "--robot", robot, "--accept", folder=tmp_path)
    assert result.exit_code == 0, result.output
    assert robot.read_text() != EXAMPLE.read_text()


def test_without_a_configuration_nothing_is_written(tmp_path: Path) -> None:
    result = calibrate("wheels", "arena4:seed=1,seconds=4", "--accept", folder=tmp_path)
    assert result.exit_code == 0, result.output
    assert "name your robot.toml with --robot" in result.output


def test_what_a_drive_lacks_is_told_while_it_drives(tmp_path: Path) -> None:
    recording = tmp_path / "live.mcap"
    result = calibrate(
        "wheels",
        "--simulate",
        "arena4:seed=1",
        "--seconds",
        "4",
        "--record",
        recording,
        folder=tmp_path,
    )
    assert result.exit_code == 1
    assert "drive further than 3 m" in result.output
    kinds = {type(message) for message in Recording(recording).messages()}
    assert {Bodies, Displacement} <= kinds


def test_a_robot_without_motion_capture_is_told_so(tmp_path: Path) -> None:
    result = calibrate("lidar", "--seconds", "2", folder=tmp_path)
    assert result.exit_code == 1
    assert "no motion capture" in result.output
    assert "[mocap]" in result.output
    plain = tmp_path / "plain.mcap"
    assert run("simulate", "arena4:seconds=2", "--output", plain).exit_code == 0
    result = calibrate("lidar", plain, folder=tmp_path)
    assert result.exit_code == 1
    assert "no motion capture" in result.output


def test_where_nothing_can_be_written_is_told_before_the_robot_drives(
    robot: Path, tmp_path: Path
) -> None:
    nowhere = tmp_path / "nowhere" / "figures.json"
    options = ("--simulate", "arena4", "--robot", robot)
    result = calibrate("wheels", *options, "--json", nowhere, folder=tmp_path)
    assert result.exit_code == 1
    assert f"cannot write {nowhere}\nthere is no folder" in result.output
    result = calibrate("wheels", *options, folder=nowhere.parent)
    assert "there is no folder" in result.output
    robot.chmod(0o444)
    result = calibrate("wheels", *options, folder=tmp_path)
    assert f"cannot write the configuration {robot}\nit is read-only" in result.output
    assert "drive the robot" not in result.output


def test_what_stands_on_the_wheels_says_so_before_they_are_fitted(
    robot: Path, tmp_path: Path
) -> None:
    source = "arena4:seed=1,seconds=4"
    assert "calibrate wheels first" in calibrate("lidar", source, folder=tmp_path).output
    robot.write_text("[mocap]\nx_m = 0.01\n")
    result = calibrate("lidar", source, "--robot", robot, folder=tmp_path)
    assert "lidar calibration" in result.output
    assert "calibrate wheels first" not in result.output


def test_cameras_can_do_with_the_lidar_instead_of_motion_capture(tmp_path: Path) -> None:
    drive = tmp_path / "drive.mcap"
    result = calibrate("camera", "--seconds", "2", "--record", drive, folder=tmp_path)
    assert result.exit_code == 1
    assert "waiting for motion capture" not in result.output
    assert "0 revolutions of the lidar" in result.output  # there is no device at all here
    assert drive.exists()


def test_options_of_a_drive_are_refused_with_a_source(tmp_path: Path) -> None:
    for option in (("--seconds", "5"), ("--simulate", "arena4"), ("--record", "x.mcap")):
        result = calibrate("lidar", "arena4:seconds=2", *option, folder=tmp_path)
        assert result.exit_code == 2
        assert "for a drive, not SOURCE" in result.output
    for option in (("--boards", "left=x"), ("--board", "9by6"), ("--board", "1x6:0.1")):
        assert calibrate("camera", "arena4:seconds=2", *option, folder=tmp_path).exit_code == 2


def test_boards_without_pictures_are_told_so(tmp_path: Path) -> None:
    plain = tmp_path / "plain.mcap"
    assert run("simulate", "arena4:seconds=1", "--output", plain).exit_code == 0
    for folder, why in ((tmp_path / "nowhere", "no such folder"), (tmp_path, "*.jpg, *.jpeg")):
        result = calibrate("camera", plain, "--boards", f"rear={folder}", folder=tmp_path)
        assert result.exit_code == 1
        assert f"there are no pictures in {folder}" in result.output
        assert why in result.output


def test_recorded_runs_fit_and_are_scored_on_others(
    recorded: Callable[[str], Path], tmp_path: Path
) -> None:
    runs, figures = recorded("optiodom"), tmp_path / "wheels.json"
    tests = [f"optiodom:{runs / name}" for name in ("circular", "square")]
    options = [part for test in tests for part in ("--test", test)]
    result = calibrate(
        "wheels", f"optiodom:{runs / 'free'}", *options, "--json", figures, folder=tmp_path
    )
    assert result.exit_code == 0, result.output
    told = json.loads(figures.read_text())["result"]["tests"]
    assert [test["source"] for test in told] == tests
    for test in told:
        assert test["fitted_end_error_m"] <= 0.55 * test["nominal_end_error_m"]
        assert len(test["runs"]) == 2


def test_runs_that_turn_one_way_only_are_refused(
    recorded: Callable[[str], Path], robot: Path, tmp_path: Path
) -> None:
    (one,) = recorded("optiodom").glob("circular/*/*_run-01.csv")
    result = calibrate("wheels", f"optiodom:{one}", "--robot", robot, folder=tmp_path)
    assert result.exit_code == 1
    said = " ".join(result.output.split())
    assert "rotating one way, or going straight on, does not separate the track" in said
    assert robot.read_text() == EXAMPLE.read_text()
