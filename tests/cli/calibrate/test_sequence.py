"""`swarmloc calibrate all`: which fits come when, and what happens after one that is refused."""

import dataclasses
from pathlib import Path

import pytest

from host.calibration.gathered import Gathered
from host.calibration.result import Calibration, Check, at_most
from host.cli.calibrate import gathering, sequence
from host.cli.calibrate.sequence import Sequence
from host.config import RobotConfig, load_config
from host.errors import UserError

TURRETS = {"mocap.turrets": [{"body": 2, "x_m": 0.01, "y_m": -0.004}]}
COMMON = {"scenario": None, "seconds": None, "record": None, "accept": False}


class Fits:
    """Stand-ins of all fits. refused: kinds, as often as they are; lacks: without readings."""

    def __init__(self, refused: tuple[str, ...] = (), lacks: tuple[str, ...] = ()) -> None:
        self.refused, self.lacks = list(refused), lacks
        self.made: list[str] = []

    def fit(self, kind: str, gathered: Gathered) -> Calibration:
        self.made.append(kind)
        bad = kind in self.refused
        if bad:
            self.refused.remove(kind)
        check: Check = at_most(f"{kind} is off", 2.0 if bad else 0.0, 1.0).otherwise("look at it")
        return Calibration(kind=kind, fitted=(), checks=(check,), residuals="")

    def together(
        self, gathered: Gathered, sensors: list[str], lidar_start: dict[str, float] | None = None
    ) -> Calibration:
        made = self.fit(f"joint of {' '.join(sensors)}", gathered)
        return dataclasses.replace(made, settings=TURRETS)

    def lacking(self, kind: str, gathered: Gathered) -> str:
        return "readings" if kind in self.lacks else ""


def run(
    fits: Fits, monkeypatch: pytest.MonkeyPatch, folder: Path, robot: Path | None = None
) -> list[str]:
    monkeypatch.setattr(sequence, "calibrate_gathered", fits.fit)
    monkeypatch.setattr(sequence, "fit_jointly", fits.together)
    monkeypatch.setattr(sequence, "lacking", fits.lacking)
    monkeypatch.setattr(gathering, "from_source", lambda *_: Gathered(RobotConfig()))
    Sequence("drive.mcap", folder / "all.html", {**COMMON, "robot_path": robot}).run()
    return fits.made


def test_all_are_fitted_together_before_detection(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = run(Fits(), monkeypatch, tmp_path)
    assert made == ["wheels", "lidar", "camera", "joint of wheels lidar camera", "detection"]
    assert (tmp_path / "all-joint.html").exists()


def test_a_sensor_that_is_refused_is_tried_again_with_what_the_others_found_together(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = run(Fits(refused=("lidar",)), monkeypatch, tmp_path)
    assert made[1:4] == ["lidar", "camera", "joint of wheels camera"]
    assert made[4:] == ["lidar", "joint of wheels lidar camera", "detection"]
    assert "together: wheels, camera, without lidar" in capsys.readouterr().out


def test_where_lidar_and_cameras_are_refused_turrets_are_looked_for_and_written_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text("[mocap]\nbody = 1\n")
    made = run(Fits(refused=("lidar", "camera")), monkeypatch, tmp_path, robot)
    assert made[:4] == ["wheels", "lidar", "camera", "joint of wheels lidar"]
    assert made[4:] == ["lidar", "camera", "joint of wheels lidar camera", "detection"]
    (turret,) = load_config(robot).mocap.turrets
    assert (turret.body, turret.x_m, turret.y_m) == (2, 0.01, -0.004)


def test_one_that_is_refused_again_is_left_out_and_told_at_the_end(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fits = Fits(refused=("camera", "camera"))
    with pytest.raises(UserError, match="the camera calibration is refused"):
        run(fits, monkeypatch, tmp_path)
    assert fits.made[-2:] == ["camera", "joint of wheels lidar"]
    last = " ".join(capsys.readouterr().out.partition("calibration of ")[2].split())
    assert f"wheels passed, nothing to write; report: {tmp_path}/all-wheels.html" in last
    assert f"camera refused, nothing written; report: {tmp_path}/all-camera.html" in last
    assert "detection not tried" in last
    assert "next:" not in last
    assert "detection" not in fits.made


def test_where_no_turrets_were_found_nothing_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fits = Fits(refused=("lidar", "joint of wheels camera"))
    with pytest.raises(UserError, match="the lidar calibration is refused"):
        run(fits, monkeypatch, tmp_path)
    assert fits.made == ["wheels", "lidar", "camera", "joint of wheels camera"]


def test_without_wheels_nothing_else_is_fitted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fits = Fits(refused=("wheels",))
    with pytest.raises(UserError, match="the wheels calibration is refused"):
        run(fits, monkeypatch, tmp_path)
    assert fits.made == ["wheels"]


def test_what_a_drive_has_no_readings_of_is_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = run(Fits(lacks=("camera",)), monkeypatch, tmp_path)
    assert made == ["wheels", "lidar", "joint of wheels lidar", "detection"]
