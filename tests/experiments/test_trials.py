"""Trials, their records and the intervals over seeds, against other ways to compute them."""

import json
import math

import numpy as np
import pytest
from scipy import stats

from host.config import RobotConfig
from host.errors import UserError
from host.evaluation.mrclam_scoring import MRCLAM_ROBOT
from host.experiments import trials
from host.experiments.intervals import mean, summaries
from host.experiments.records import Records
from host.experiments.trials import Trial
from host.sessions.offline.evaluating import score_sources

SOURCE = "arena4:seconds=7,seed=2"


@pytest.mark.parametrize("n", [2, 3, 10, 60])
def test_the_interval_is_scipy_s(n):
    values = np.random.default_rng(n).normal(3.0, 2.0, n)
    value, half = mean(list(values))
    low, high = stats.t.interval(0.95, n - 1, loc=np.mean(values), scale=stats.sem(values))
    assert (value - half, value + half) == (pytest.approx(low), pytest.approx(high))


def test_the_interval_of_two_values_is_the_one_of_the_tables():
    assert mean([1.0, 3.0]) == (2.0, pytest.approx(12.706, abs=1e-3))  # t(.975, 1), s / sqrt 2 = 1


def test_the_interval_covers_the_truth_as_often_as_it_says():
    random = np.random.default_rng(7)
    inside = 0
    for _ in range(2000):
        value, half = mean(list(random.normal(1.0, 1.0, 5)))
        inside += abs(value - 1.0) <= half
    assert inside / 2000 == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 2000))


def test_one_value_has_no_interval_and_none_no_mean():
    assert mean([2.0])[0] == 2.0
    assert math.isnan(mean([2.0])[1])
    assert math.isnan(mean([])[0])
    assert mean([2.0, None, 4.0])[0] == 3.0


def test_seeds_are_put_into_scenarios_and_taken_out_again():
    sources = ["arena4", "swarm20:seconds=9", "a/today.mcap", "mrclam:/data,landmarks=drop"]
    several = trials.seeded(sources, [3, 4])
    assert several == [
        "arena4:seed=3",
        "arena4:seed=4",
        "swarm20:seconds=9,seed=3",
        "swarm20:seconds=9,seed=4",
        *sources[2:],
    ]
    assert [trials.without_seed(source) for source in several[::2]] == sources[:2] + sources[2:3]
    assert trials.without_seed("arena4:seed=3,seconds=9") == "arena4:seconds=9"
    assert trials.seeded(sources, []) == sources


def test_the_grid_has_every_combination_once():
    settings = [trials.parse_setting("filter.gate=9.0,16.0"), trials.parse_setting('name="a","b"')]
    found = trials.grid(["x", "mrclam:y"], ["phd", "clairvoyant"], ["lidar", "z"], settings)
    assert len(set(found)) == len(found) == 2 * 4 * 2 + 2 * 4 * 1
    assert {trial.sensors for trial in found if trial.source == "mrclam:y"} == {"camera"}
    assert found[0].settings == (("filter.gate", 9.0), ("name", "a"))


@pytest.mark.parametrize("text", ["filter.gate", "filter.gate=", "filter.gate=.5", "a=1=2"])
def test_a_setting_that_cannot_be_read_is_refused(text):
    with pytest.raises(UserError, match="cannot read the setting"):
        trials.parse_setting(text)


def test_settings_are_checked_as_robot_toml_is():
    changed = trials.with_settings(RobotConfig(), (("filter.gate", 9.0), ("camera.delay_s", 0.1)))
    assert (changed.filter.gate, changed.camera.delay_s) == (9.0, 0.1)
    assert changed.lidar == RobotConfig().lidar
    with pytest.raises(UserError, match=r"filter\.gates"):
        trials.with_settings(RobotConfig(), (("filter.gates", 9.0),))
    with pytest.raises(UserError, match="gate"):
        trials.with_settings(RobotConfig(), (("filter.gate", -9.0),))


def test_a_record_is_the_row_of_evaluate_with_its_settings():
    record = trials.score(Trial(SOURCE, "phd", "lidar"))
    (row,) = score_sources([SOURCE], ["phd"], ["lidar"])
    timing = ("update_ms_median", "update_ms_p99")
    expected = {key: value for key, value in row.as_json().items() if key not in timing}
    assert {key: record[key] for key in expected} == expected
    assert record["settings"] == {}


def test_a_teammate_that_is_never_in_range_has_no_figure_and_the_record_is_kept(tmp_path):
    records = Records(tmp_path / "trials.jsonl")
    for settings in ("seed=1,robots=1", "seed=3"):  # alone; and with one that stays out of range
        trial = Trial(f"arena4:seconds=7,{settings}", "phd", "lidar+camera")
        record = trials.score(trial)
        records.add(record)
        assert Records(tmp_path / "trials.jsonl").of([trial]) == [record]
    assert [theirs for _, _, theirs in record["published"]] == [0.127, 0.026, 0.002]
    assert None in [ours for _, ours, _ in record["published"]]


def test_a_setting_of_the_filter_and_one_of_the_lidar_change_what_is_scored():
    robot = RobotConfig()
    plain = trials.score(Trial(SOURCE, "phd", "lidar"))["missed"]
    strict = Trial(SOURCE, "phd", "lidar", (("filter.pmb.report_error_m", 0.01),))
    blind = Trial(SOURCE, "phd", "lidar", (("lidar.max_range_m", 0.5),))
    assert trials.score(strict)["missed"] > plain
    assert trials.score(blind)["missed"] > plain
    changed = robot.model_copy(update={"filter": strict.config().filter})
    same = trials.score(Trial(SOURCE, "phd", "lidar", (), changed))
    assert same["gospa_m"] == trials.score(strict)["gospa_m"]


def test_a_dataset_s_record_pools_its_observers(recorded):
    source = f"mrclam:{recorded('mrclam6')},landmarks=drop"
    record = trials.score(Trial(source, "last_reading", "camera"))
    assert record["observer"] == "all"
    assert Trial(source, "phd", "camera").config() == MRCLAM_ROBOT
    assert record["gospa_m"] == pytest.approx(0.102, abs=0.002)  # docs/evaluation.md


def a_record(trial, **figures):
    common = {"source": trial.source, "filter": trial.filter, "sensors": trial.sensors}
    return {"key": trial.key(), "settings": dict(trial.settings), **common, **figures}


def test_summaries_are_over_the_seeds_of_what_is_otherwise_the_same():
    every = trials.grid(
        trials.seeded(["arena4"], [1, 2]), ["phd"], ["lidar"], [("filter.gate", [9.0, 16.0])]
    )
    records = [a_record(trial, gospa_m=float(k)) for k, trial in enumerate(every)]
    first, second = summaries(records)
    assert (first.source, first.settings, first.seeds) == ("arena4", {"filter.gate": 9.0}, 2)
    assert first.means["gospa_m"].value == (0 + 2) / 2
    assert second.means["gospa_m"].value == (1 + 3) / 2
    assert first.as_json()["gospa_m_ci95"] == pytest.approx(12.706, abs=1e-3)


def test_records_outlive_a_crash_in_the_middle_of_a_line(tmp_path):
    path = tmp_path / "trials.jsonl"
    first, second, third = (Trial(f"arena4:seed={k}", "phd", "lidar") for k in (1, 2, 3))
    records = Records(path)
    for trial in (first, second):
        records.add(a_record(trial, gospa_m=0.5))
    path.write_text(path.read_text()[:-20])
    again = Records(path)
    assert (first in again, second in again) == (True, False)
    again.add(a_record(third, gospa_m=0.7))
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [line["source"] for line in lines] == ["arena4:seed=1", "arena4:seed=3"]
    assert [record["gospa_m"] for record in Records(path).of([third, second, first])] == [0.7, 0.5]
    again.replace(again.of([third]))
    assert first not in Records(path)
    assert Records(path).everything() == again.of([third])


def test_a_file_of_something_else_is_left_as_it_is(tmp_path):
    path = tmp_path / "notes.txt"
    for text in ("my notes\n", "[1]\n", "3\n", '{"a": 1}\n'):
        path.write_text(text)
        with pytest.raises(UserError, match="holds no records"):
            Records(path)
        assert path.read_text() == text
    with pytest.raises(UserError, match="cannot use"):
        Records(tmp_path)


def test_a_record_of_another_configuration_is_another(tmp_path):
    other = RobotConfig.model_validate({"filter": {"gate": 9.0}})
    records = Records(tmp_path / "trials.jsonl")
    records.add(a_record(Trial("arena4", "phd", "lidar")))
    assert Trial("arena4", "phd", "lidar", (), other) not in records
    assert Trial("arena4", "phd", "lidar", (), RobotConfig()) in records
