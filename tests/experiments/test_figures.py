"""`swarmloc evaluate --figures`: the papers' figures as files."""

import csv
import json
import re
import sys
from datetime import datetime

import numpy as np
import pytest
from click.testing import CliRunner

from host.cli.main import main
from host.config import RobotConfig, load_config, parse_config
from host.errors import UserError
from host.evaluation.mrclam_scoring import MRCLAM_ROBOT
from host.experiments.published import beside_published, worst_first
from host.experiments.results_folder import ResultsFolder, robot_toml
from host.sessions.offline import evaluating

SOURCE = "arena4:seconds=9,seed=4"
FILTERS, SENSORS = ["phd", "clairvoyant"], ["lidar+camera", "lidar"]


def invoke(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)])


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def scored():
    kept = []
    rows = evaluating.score_sources([SOURCE], FILTERS, SENSORS, keep=kept.append)
    return rows, kept[0]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The folder of one evaluation with pictures."""
    pytest.importorskip("matplotlib")
    parent = tmp_path_factory.mktemp("figures") / "results"
    done = invoke("evaluate", SOURCE, "--filters", "phd,clairvoyant", "--figures", parent)
    assert done.exit_code == 0, done.output
    assert f"figures: {(parent / 'latest').resolve()}" in done.output
    return parent


def test_latest_leads_to_a_folder_with_rows_configuration_and_figures(written):
    latest = written / "latest"
    assert re.fullmatch(r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d", latest.readlink().name)
    rows = json.loads((latest / "figures.json").read_text())
    assert [(row["filter"], row["sensors"]) for row in rows] == [
        (f, s) for f in FILTERS for s in SENSORS
    ]
    assert f'sources = ["{SOURCE}"]' in (latest / "experiment.toml").read_text()
    folder = latest / SOURCE.replace(":", "_").replace(",", "_")
    assert load_config(folder / "robot.toml") == RobotConfig()
    pictured = {path.stem for path in folder.glob("*.svg")}
    assert pictured == {path.stem for path in folder.glob("*.png")}
    each = [f"{what}_{f}_{s}" for what in ("errors", "paths") for f in FILTERS for s in SENSORS]
    by_filter = [f"{what}_{f}" for what in ("time_over_30cm", "weights") for f in FILTERS]
    common = ["cumulative_error", "error_over_distance", "error_over_angle", "gospa_over_time"]
    assert pictured == {*each, *by_filter, *common}
    tables = {path.stem for path in folder.glob("*.csv")}
    assert tables == {*pictured, "rmse_and_p67", "beside_published"}


def test_a_second_evaluation_keeps_the_first(written):
    first = (written / "latest").resolve()
    done = invoke("evaluate", SOURCE, "--filters", "clairvoyant", "--figures", written)
    assert done.exit_code == 0, done.output
    assert first.is_dir()
    assert (written / "latest").resolve() != first


def test_the_tables_hold_what_the_row_sums_up(written, scored):
    rows, _ = scored
    first = sorted(path for path in written.iterdir() if path.name != "latest")[0]
    folder = next(path for path in first.iterdir() if path.is_dir())
    for row in rows:
        name = f"errors_{row.filter}_{row.sensors}.csv"
        errors = [
            float(cell)
            for line in table(folder / name)
            for key, cell in line.items()
            if key != "time s" and cell
        ]
        assert np.mean(np.array(errors) > 0.3) == pytest.approx(row.time_over_30cm)
        gospa = [
            float(line["GOSPA m"])
            for line in table(folder / "gospa_over_time.csv")
            if (line["filter"], line["sensors"]) == (row.filter, row.sensors)
        ]
        assert min(gospa) - 1e-6 <= row.gospa_m <= max(gospa) + 1e-6
    for line in table(folder / "rmse_and_p67.csv"):
        curve = [
            (float(each["error m"]), float(each["share of pairs"]))
            for each in table(folder / "cumulative_error.csv")
            if (each["filter"], each["sensors"]) == (line["filter"], line["sensors"])
        ]
        at_67 = next(error for error, share in curve if share >= 0.67)
        assert at_67 == pytest.approx(float(line["p67 m"]), abs=curve[0][0] + 1e-6)


def test_estimates_lie_on_the_paths_of_the_robots_they_are_of(written):
    first = sorted(path for path in written.iterdir() if path.name != "latest")[0]
    folder = next(path for path in first.iterdir() if path.is_dir())
    lines = table(folder / "paths_clairvoyant_lidar.csv")
    points = {
        what: [
            (float(each["time s"]), float(each["x m"]), float(each["y m"]))
            for each in lines
            if each["what"] == what
        ]
        for what in ("robot", "estimate")
    }
    distances = [
        min(np.hypot(x - rx, y - ry) for rt, rx, ry in points["robot"] if rt == time)
        for time, x, y in points["estimate"]
    ]
    assert len(distances) > 30
    assert np.median(distances) < 0.1


def test_without_matplotlib_there_are_tables_and_the_line_to_paste(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    done = invoke("evaluate", SOURCE, "--filters", "clairvoyant", "--figures", tmp_path)
    assert done.exit_code == 0, done.output
    assert "pip install 'swarmloc[figures]'" in done.stderr
    names = [path.name for path in (tmp_path / "latest").rglob("*") if path.suffix]
    assert "cumulative_error.csv" in names
    assert not [name for name in names if name.endswith((".svg", ".png"))]


def test_a_folder_that_cannot_be_is_refused_before_anything_is_computed(tmp_path, monkeypatch):
    monkeypatch.setattr(evaluating, "score_sources", lambda *_: pytest.fail("it was computed"))
    (tmp_path / "file").write_text("")
    assert invoke("evaluate", SOURCE, "--figures", tmp_path / "file").exit_code == 2
    with pytest.raises(UserError, match="cannot write"):
        ResultsFolder(tmp_path / "file" / "below", datetime(2026, 1, 2), {})


def test_two_sources_of_one_name_have_folders_of_their_own(tmp_path, scored):
    folder = ResultsFolder(tmp_path, datetime(2026, 1, 2), {})
    folder.draw = False
    for _ in range(2):
        folder.take(scored[1])
    assert len([path for path in folder.path.iterdir() if path.is_dir()]) == 2


@pytest.mark.parametrize("config", [RobotConfig(), MRCLAM_ROBOT])
def test_the_configuration_that_is_written_is_the_one_that_was_used(config):
    assert parse_config(robot_toml(config)) == config


def test_the_published_numbers_stand_beside_robots_in_order(scored):
    _, kept = scored
    instants = kept.scores["phd", "lidar"].instants
    lines = list(beside_published(instants, "lidar"))
    assert [line.published for line in lines] == [0.207, 0.109, 0.010]
    ours = [line.ours for line in lines]
    assert ours == sorted(ours, reverse=True)
    assert worst_first(np.array([0.1, np.nan, 0.3])).tolist()[:2] == [0.3, 0.1]


@pytest.mark.slow
def test_a_swarm_of_twenty_stands_beside_the_simulated_experiment():
    kept = []
    evaluating.score_sources(
        ["swarm20:seconds=8,seed=1"], ["clairvoyant"], SENSORS, keep=kept.append
    )
    published = {
        sensors: {
            line.measure: (line.ours, line.published)
            for line in beside_published(found.instants, sensors)
        }
        for (_, sensors), found in kept[0].scores.items()
    }
    often, weight = published["lidar+camera"]
    assert published["lidar+camera"][often][1] == 4
    assert published["lidar"][often][1] == 9
    assert published["lidar+camera"][weight][1] == 15.0
    assert 1.0 < published["lidar+camera"][weight][0] < 19.0
