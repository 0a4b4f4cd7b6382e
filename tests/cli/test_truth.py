"""`--truth`: recorded ticks, and the Motive export of the same drive, each by its own clock."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from host.calibration.chain import BODY, load
from host.calibration.wheels.calibrate import calibrate as calibrate_drives
from host.calibration.wheels.drives import drive_of_run
from host.cli.main import main
from host.config import Mocap, RobotConfig, load_config
from host.drivers.romeo.differential_drive import displacement
from host.messages import Bodies
from host.recording.elsewhere import optiodom
from host.recording.log import Recorder, Recording, RecordingHeader

RUN = "optiodom/free/030120210001/030120210001_run-01"


def run(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)])


@pytest.fixture(scope="module")
def ticks(recorded, tmp_path_factory):
    """The ticks as a recording of ours, stamped by the robot that counted them."""
    path = tmp_path_factory.mktemp("ticks") / "ticks.mcap"
    (nominal,) = optiodom.read_runs(recorded(f"{RUN}.csv"))
    rows = np.loadtxt(recorded(f"{RUN}_odo.csv"), delimiter=",", encoding="utf-8-sig")
    config = RobotConfig(wheels=nominal.wheels)
    with Recorder(path, RecordingHeader(config, "lidar")) as recorder:
        for before, (time, left, right) in zip(rows[:, 0], rows[1:], strict=False):
            step = displacement(config.wheels, time, time - before, int(left), int(right))
            recorder.write(step)
    return path


def test_the_export_gives_the_geometry_that_its_authors_synchronised_gives(
    ticks, recorded, tmp_path
):
    (nominal,) = optiodom.read_runs(recorded(f"{RUN}.csv"))
    robot, figures = tmp_path / "robot.toml", tmp_path / "figures.json"
    wheels = nominal.wheels.model_dump()
    robot.write_text("[wheels]\n" + "".join(f"{k} = {v!r}\n" for k, v in wheels.items()))
    where = ("--robot", robot, "--json", figures, "--report", tmp_path / "report.html")
    truth = f"{recorded(f'{RUN}_opti.csv')}:robot-diff"
    result = run("calibrate", "all", ticks, "--truth", truth, *where)
    assert result.exit_code == 0, result.output
    assert re.search(r"its 0 s is at 308\.\d+ s .* ± \d\.\d ms", result.output)
    assert "lidar: left out" in result.output
    assert "camera: left out, " in result.output
    (mine,) = json.loads(figures.read_text())["rows"]
    (theirs,) = calibrate_drives([drive_of_run(nominal)], nominal.wheels, Mocap()).fitted[:1]
    written = load_config(robot)
    assert written.wheels.left_radius_m == pytest.approx(mine["fitted"][0]["value"], rel=1e-5)
    assert written.wheels.left_radius_m == pytest.approx(theirs.value, abs=3.0 * theirs.sigma)
    assert load(robot).covariance(written, BODY)[2, 2] > 0.0


def test_another_take_and_a_scenario_are_refused(ticks, recorded, tmp_path):
    other = recorded(f"{RUN.replace('run-01', 'run-02')}_opti.csv")
    for source, truth, words in (
        (ticks, other, "cannot be aligned in time"),
        (ticks, f"{other}:somebody", "its bodies: robot-diff"),
        ("arena4:seconds=2", other, "needs no --truth"),
        (ticks, tmp_path / "none.csv", "there is no file"),
    ):
        result = run("calibrate", "wheels", source, "--truth", truth)
        assert result.exit_code == 1
        assert words in result.output, result.output
    assert run("calibrate", "wheels", "--truth", other).exit_code == 2
    assert run("calibrate", "all", ticks).exit_code == 2
    assert run("evaluate", "a", "b", "--truth", other).exit_code == 2


def test_evaluate_scores_by_a_file_as_by_the_motion_capture_that_it_was_written_from(tmp_path):
    drive, bare, truth = (tmp_path / name for name in ("d.mcap", "b.mcap", "t.csv"))
    scenario = "arena4:seconds=20,seed=2,mocap_hz=50"
    assert run("simulate", scenario, "--output", drive).exit_code == 0
    recording, lines = Recording(drive), ["time,x,y,heading,body"]
    with Recorder(bare, recording.header) as recorder:
        for message in recording.messages():
            if isinstance(message, Bodies):
                for number, pose in zip(message.identities, message.poses.tolist(), strict=True):
                    x, y, heading = (repr(value) for value in pose)
                    lines.append(f"{message.time + 1234.5!r},{x},{y},{heading},n{number}")
            elif type(message).__name__ != "Truth":
                recorder.write(message)
    truth.write_text("\n".join(sorted(lines[1:], key=lambda line: line[-2:])))
    truth.write_text(f"{lines[0]}\n{truth.read_text()}\n")
    figures = tmp_path / "figures.json"
    scored = []
    for arguments in ((drive,), (bare, "--truth", f"{truth}:n1")):
        result = run(
            "evaluate", *arguments, "--filters", "pmb", "--sensors", "lidar", "--json", figures
        )
        assert result.exit_code == 0, result.output
        scored.append(json.loads(figures.read_text())["rows"][0]["gospa_m"])
    assert scored[1] == pytest.approx(scored[0], abs=0.005)
    assert run("evaluate", bare).exit_code == 1
