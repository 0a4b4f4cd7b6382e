"""What README.md and docs/ state is what docs/results.jsonl holds; how tables are made of it."""

import json
import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

from host.config import RobotConfig
from host.estimator.profiles import filter_entry
from tools import draw_faults, figure_tables, renew_figures
from tools.figure_tables import RESULTS, ROOT, TABLES, Table

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
STATED = {
    name: page
    for page in PAGES
    for name in re.findall(r"<!-- table: (\w+) -->\n", page.read_text(encoding="utf-8"))
}


@pytest.fixture(scope="module")
def results():
    text = RESULTS.read_text(encoding="utf-8") if RESULTS.exists() else ""
    return [json.loads(line) for line in text.splitlines()]


@pytest.mark.parametrize("name", STATED)
def test_a_table_is_what_the_results_give(name, results):
    text = STATED[name].read_text(encoding="utf-8")
    fresh = figure_tables.rewritten(text, results)
    assert fresh == text, f"run `make figures ONLY={name}` or `python -m tools.renew_figures`"


@pytest.mark.parametrize("name", STATED)
def test_no_seed_of_a_table_is_missing(name, results):
    """Whatever filters were scored, each was on every source, with every seed and all sensors."""
    table = TABLES[name]
    found = figure_tables.records_of(table, results)
    scored = {record["filter"] for record in found}
    for filter_name in scored:
        wanted = {
            (trial.source, trial.sensors) for trial in figure_tables.trials_of(table, [filter_name])
        }
        got = [(r["source"], r["sensors"]) for r in found if r["filter"] == filter_name]
        assert sorted(got) == sorted(wanted)


def test_results_name_no_folder_of_the_computer_they_were_made_on(results):
    assert [record["source"] for record in results if "/" in record["source"]] == []


def a_record(source, name="phd", sensors="lidar", settings=None, **figures):
    common = {"source": source, "filter": name, "sensors": sensors, "settings": settings or {}}
    every = dict.fromkeys(("missed", "false", "time_over_30cm", "label_changes", "rmse_m"), 0.25)
    return {"key": f"{source} {name} {sensors}", **common, **every, "gospa_m": 0.1, **figures}


def test_a_cell_is_the_mean_over_seeds_with_its_interval_and_the_best_is_bold():
    values = [0.10, 0.12, 0.17, 0.11, 0.13]
    records = [
        a_record(f"arena4:seconds=120,seed={seed}", name, gospa_m=scale * value)
        for name, scale in (("clairvoyant", 0.5), ("phd", 1.0), ("perera2021", 3.0))
        for seed, value in zip(figure_tables.SEEDS[:5], values, strict=True)
    ]
    low, high = stats.t.interval(0.95, 4, loc=np.mean(values), scale=stats.sem(values))
    cell = f"{np.mean(values):.3f} ± {(high - low) / 2:.3f}"
    lines = TABLES["evaluation"].lines(records)
    phd = next(line for line in lines if "| phd |" in line)
    assert (
        phd == f"| arena4 | lidar | phd | **{cell}** | 0.25 | 0.25 | 25.0 % | 0.2 | 0.250 | 2.00 |"
    )
    assert [line.count("**") for line in lines] == [0, 0, 0, 2, 0]


def test_the_short_tables_hold_the_long_ones_figures():
    figures = [(0.1, "phd", "lidar"), (0.2, "phd", "lidar+camera"), (0.3, "pmb", "lidar")]
    figures += [(0.4, "pmb", "lidar+camera")]
    records = [
        a_record("arena4:seconds=120,seed=11", name, sensors, gospa_m=gospa)
        for gospa, name, sensors in figures
    ]
    assert TABLES["summary"].lines(records)[2:] == [
        "| phd | 0.200 | 0.100 |",
        "| pmb | 0.400 | 0.300 |",
    ]
    of_thesis = [["time over 30 cm, robot 1 of 3", 0.1, 0.2], ["mean sum of the weights", 7.0, 15]]
    lines = TABLES["published"].lines([a_record("arena4:seed=1", published=of_thesis)])
    assert ["sum" in line for line in lines] == [False] * 3


def test_the_ablation_compares_each_seed_with_itself():
    table, (name, *_) = TABLES["ablation"], TABLES["ablation"].filters[1:]
    seeds = table.seeds[:3]
    records = [
        a_record(f"{source},seed={seed}", each, sensors, gospa_m=0.01 * seed * factor(seed))
        for source in figure_tables.LAYOUTS
        for sensors in figure_tables.SENSORS
        for seed in seeds
        for each, factor in (("pmb", lambda _: 1.0), (name, lambda seed: 1.0 + 0.1 * (seed - 10)))
    ]
    line = table.lines(records)[2]
    low, high = stats.t.interval(0.95, 2, loc=20.0, scale=stats.sem([10.0, 20.0, 30.0]))
    assert line.split(" | ")[1] == f"{20:.0f} ± {(high - low) / 2:.0f}"
    assert line.count("20 ± ") == 2 * len(figure_tables.LAYOUTS)


def test_every_model_that_is_left_out_changes_the_filter():
    """So that no row of the table is the whole filter under another name."""
    made = [filter_entry(name).make(RobotConfig()) for name in TABLES["ablation"].filters]
    kinds = {(type(each), *(type(part) for part in vars(each).values())) for each in made}
    assert len(kinds) == len(made) - 1  # but for obstacle_share, a setting


def test_only_what_stands_between_the_marks_is_rewritten():
    page = "before\n<!-- table: mrclam -->\nstale\n<!-- end of table -->\nafter <!-- table -->\n"
    records = [
        a_record(f"mrclam:mrclam6,landmarks={kind}", name, "camera", gospa_m=gospa)
        for kind, gospa in (("drop", 0.25), ("clutter", 0.5))
        for name in ("phd", "last_reading")
    ]
    fresh = figure_tables.rewritten(page, records)
    assert fresh.startswith("before\n<!-- table: mrclam -->\n| GOSPA, m (cut-off 1 m) | phd |")
    assert fresh.endswith("| 0.500 | 0.500 |\n<!-- end of table -->\nafter <!-- table -->\n")
    assert "stale" not in fresh
    assert figure_tables.rewritten(page, []) == page
    with pytest.raises(KeyError, match="unknown"):
        figure_tables.rewritten(page.replace("mrclam", "unknown"), records)


def test_the_newest_record_of_a_trial_counts_in_an_order_of_its_own():
    old, new = a_record("b", key="1"), a_record("b", key="2", gospa_m=0.5)
    other = a_record("a")
    assert renew_figures.only_newest([old, other, new]) == [other, new]
    swept = a_record("b", settings={"filter.gate": 9.0})
    assert len(renew_figures.only_newest([swept, new])) == 2


def test_a_record_with_other_settings_is_in_no_table():
    table = Table(("arena4",), ("phd",), ("lidar",), lambda records: [], (1,))
    kept = a_record("arena4:seed=1")
    others = [a_record("arena4:seed=1", settings={"a": 1}), a_record("arena4:seed=2")]
    assert figure_tables.records_of(table, [*others, kept]) == [kept]


def test_published_numbers_stand_beside_the_mean_of_ours():
    records = [
        a_record(f"arena4:seed={seed}", published=[["share of x", ours, 0.127], ["y", 3.0, None]])
        for seed, ours in ((1, 0.1), (2, 0.3))
    ]
    lines = TABLES["thesis"].lines(records)
    half = 12.706 * math.sqrt(0.02) / math.sqrt(2)
    assert lines[2] == f"| share of x | lidar | 0.127 | 0.200 ± {half:.3f} |"
    assert lines[3].startswith("| y | lidar |  | 3.0 ± 0.0 |")


def test_the_picture_of_faults_has_a_curve_of_each():
    pytest.importorskip("matplotlib")
    records = [
        a_record(f"arena4:seconds=60{fault},seed={seed}", over_time=[[6.25, 0.1], [8.75, 0.2]])
        for fault in figure_tables.FAULTS.values()
        for seed in (1, 2)
    ]
    root = ElementTree.fromstring(draw_faults.picture(records, "phd"))
    curves = [g for g in root.iter("{http://www.w3.org/2000/svg}g") if "line2d" in g.get("id", "")]
    assert len(curves) >= 2 * len(figure_tables.FAULTS)  # each and its mark in the legend
