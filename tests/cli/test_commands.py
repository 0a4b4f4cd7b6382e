"""simulate, replay and evaluate, and how every command speaks to its user."""

import json
import math
import re

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from host.cli.main import main
from host.cli.terminal.layout import columns, listing, parts
from host.cli.terminal.table import table
from host.config import RobotConfig
from host.evaluation.metrics import Accumulator
from host.messages import DeviceBytes, Estimate, Health, Truth
from host.recording.log import Recorder, Recording, RecordingHeader
from host.sessions.recordings import runs

COMMANDS = ("run", "flash", "simulate", "record", "replay", "export", "evaluate", "sweep")
KEYS = [
    *("source", "observer", "filter", "sensors", "seconds", "gospa_m", "localisation_m", "missed"),
    *("false", "stray", "time_over_30cm", "rmse_m", "p67_m", "cardinality_error"),
    *("label_changes", "anees", "update_ms_median", "update_ms_p99"),
]
SCENARIO = "arena4:seconds=7,seed=2"


def invoke(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "arena.mcap"
    done = invoke("simulate", SCENARIO, "--output", path)
    assert done.exit_code == 0, done.output
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example_and_figures_as_json(command):
    done = invoke(command, "--help")
    assert done.exit_code == 0
    assert re.search(rf"Examples?:\n +swarmloc {command}\b", done.output)
    assert "--json FILE" in done.output
    assert max(map(len, done.output.splitlines())) <= 80
    if command in ("flash", "record"):  # whatever robot.toml says
        return
    default = (
        "the recording's, else built-in settings"
        if command in ("replay", "export", "evaluate", "sweep")
        else "built-in settings"
    )
    assert f"[default: {default}]" in " ".join(done.output.split())


def test_help_lists_the_commands_and_version_tells_one():
    listed = invoke("--help").output
    assert all(re.search(rf"^  {command} ", listed, re.MULTILINE) for command in COMMANDS)
    assert "..." not in listed.split("Commands:")[1]
    assert re.fullmatch(r"swarmloc, version \d+\.\d+\.\d+\S*\n", invoke("--version").output)


def test_a_failure_is_words_and_with_debug_a_traceback(tmp_path):
    path = tmp_path / "none.mcap"
    told = invoke("replay", path)
    assert (told.exit_code, told.stdout) == (1, "")
    assert told.stderr == (
        f"swarmloc: cannot read the recording {path}\n"
        "No such file or directory\n"
        "give the path of a recording, as `swarmloc run --record` writes it\n"
    )
    assert type(invoke("--debug", "replay", path).exception).__name__ == "UserError"


def test_a_fault_of_the_program_is_words_too(monkeypatch, recording):
    def fail(*arguments):
        raise ZeroDivisionError("boom")

    monkeypatch.setattr(runs, "load_run", fail)
    told = invoke("evaluate", SCENARIO)
    assert told.exit_code == 1
    assert "a fault of the program: ZeroDivisionError: boom" in told.stderr
    assert "--debug" in told.stderr
    assert isinstance(invoke("--debug", "evaluate", SCENARIO).exception, ZeroDivisionError)


def test_a_simulated_recording_holds_truth_at_every_scan(recording, tmp_path):
    messages = list(Recording(recording).messages())
    truths = {m.time for m in messages if isinstance(m, Truth)}
    scans = [m.time for m in messages if type(m).__name__ == "Scan"]
    assert len(scans) > 40
    assert truths.issuperset(scans)
    assert Recording(recording).header.scenario == SCENARIO
    again = tmp_path / "again.mcap"
    assert invoke("simulate", SCENARIO, "--output", again).exit_code == 0
    assert again.read_bytes() == recording.read_bytes()
    assert "exists already" in invoke("simulate", SCENARIO, "--output", again).stderr


def test_a_scenario_without_room_leaves_no_recording(tmp_path):
    path = tmp_path / "full.mcap"
    done = invoke("simulate", "arena4:robots=60", "--output", path)
    assert done.exit_code == 1
    assert "no room for 60 robots" in done.stderr
    assert not path.exists()


def test_replaying_twice_gives_the_same_bits_and_figures(recording, tmp_path):
    figures = []
    for name in ("a", "b"):
        done = invoke("replay", recording, "--json", tmp_path / name)
        assert done.exit_code == 0, done.output
        assert "none in the recording" in done.output
        figures.append(json.loads((tmp_path / name).read_text())["result"])
    for key in ("updates", "teammates_reported", "gospa_m", "missed", "false", "rmse_m"):
        assert figures[0][key] == figures[1][key]
    assert figures[0]["updates"] > 100


def test_a_replay_tells_whether_the_recorded_estimates_come_out_again(recording, tmp_path):
    """Adds estimates to a recording by hand, right ones and then one wrong in its last bit."""
    run = runs.load_run(str(recording), None)
    header = Recording(recording).header
    made = made_by(run)
    assert sum(map(len, made)) > 100
    right, wrong = tmp_path / "right.mcap", tmp_path / "wrong.mcap"
    record(right, header, run.messages, made)
    done = invoke("replay", right)
    assert done.exit_code == 0, done.output
    assert f"{sum(map(len, made))} bit-identical, 0 different" in done.output

    place = next(k for k, estimates in enumerate(made) if estimates and estimates[0].weights.size)
    estimate = made[place][0]
    estimate.weights[0] = np.nextafter(estimate.weights[0], 2.0)
    record(wrong, header, run.messages, made)
    done = invoke("replay", wrong)
    assert done.exit_code == 1
    assert "1 estimates differ from the recorded ones" in done.stderr
    assert f"the first at {estimate.time:.3f} s" in done.stderr
    for other in (("--filter", "perera2021"), ("--sensors", "lidar")):
        done = invoke("replay", wrong, *other)
        assert done.exit_code == 0, done.output
        assert "not compared" in done.output


def made_by(run):
    """The estimates of each message, and last those of the end."""
    from host.estimator import profiles
    from host.localizer import Localizer

    localizer = Localizer(run.config, profiles.make(run.config.filter.profile, run.config))
    return [localizer.handle(message) for message in run.messages] + [localizer.finish()]


def record(path, header, messages, made):
    with Recorder(path, header) as recorder:
        for message, estimates in zip([*messages, None], made, strict=True):
            if message is not None:
                recorder.write(message)
            for estimate in estimates:
                recorder.write(estimate)


def test_a_torn_recording_replays_and_says_so(recording, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(recording.read_bytes()[:-5000])
    done = invoke("replay", torn)
    assert done.exit_code == 0
    assert "unfinished" in done.output


def test_a_replay_at_speed_shows_the_screen(recording):
    done = invoke("replay", recording, "--speed", "4")
    assert done.exit_code == 0, done.output
    assert re.search(
        r"1\.\d s +\d teammates?(, \d obstacles?)?; within 2.0 m: \d estimated",
        done.output,
    )


def test_a_replay_at_speed_that_is_interrupted_gives_the_cursor_back(recording, on_screen):
    screen = on_screen("replay", str(recording), "--speed", "0.5")
    screen.wait_for(lambda text: "teammate" in text)
    screen.type(b"\x03")
    assert screen.end() == 1
    assert screen.written.rindex("\x1b[?25h") > screen.written.rindex("\x1b[?25l")


def test_evaluate_gives_a_row_of_each_and_pools_the_seeds(tmp_path, recording):
    path = tmp_path / "rows.json"
    sources = ("arena4:seconds=7,seed=1", SCENARIO, str(recording))
    done = invoke("evaluate", *sources, "--filters", "perera2021,phd,clairvoyant", "--json", path)
    assert done.exit_code == 0, done.output
    rows = json.loads(path.read_text())["rows"]
    assert all(list(row) == KEYS for row in rows)
    assert [row["source"] for row in rows] == [
        source for source in (*sources, "arena4 x2") for _ in range(6)
    ]
    assert [(row["filter"], row["sensors"]) for row in rows[:6]] == [
        ("perera2021", "lidar+camera"),
        ("perera2021", "lidar"),
        ("phd", "lidar+camera"),
        ("phd", "lidar"),
        ("clairvoyant", "lidar+camera"),
        ("clairvoyant", "lidar"),
    ]
    assert [row["observer"] for row in rows] == [*12 * "0", *6 * ["cherokey"], *6 * "0"]
    # The recording is of the second scenario.
    for simulated, recorded in zip(rows[6:12], rows[12:18], strict=True):
        names = ("source", "observer", "update_ms_median", "update_ms_p99")
        assert {k: v for k, v in simulated.items() if k not in names} == {
            k: v for k, v in recorded.items() if k not in names
        }
    for one, other, pooled in zip(rows[:6], rows[6:12], rows[18:], strict=True):
        low, high = sorted((one["gospa_m"], other["gospa_m"]))
        assert low <= pooled["gospa_m"] <= high
        assert pooled["seconds"] == pytest.approx(one["seconds"] + other["seconds"])
    perera2021, phd, best = (row["gospa_m"] for row in rows[:6:2])
    assert 0.0 < best < 1.5 * phd < 1.5 * perera2021
    ratio = phd / best
    assert re.search(rf"phd +lidar\+camera .* {ratio:.2f}\n", done.output)


def test_cameras_alone_are_scored_simulated_and_replayed(tmp_path, recording):
    rows_path, figures_path = tmp_path / "rows.json", tmp_path / "figures.json"
    asked = ("--filters", "pmb", "--sensors", "camera,lidar", "--json", rows_path)
    assert invoke("evaluate", recording, *asked).exit_code == 0
    by_sensors = {row["sensors"]: row for row in json.loads(rows_path.read_text())["rows"]}
    assert by_sensors["lidar"]["rmse_m"] < by_sensors["camera"]["rmse_m"] < 0.25
    path = tmp_path / "seen.swarmloc"
    assert invoke("simulate", SCENARIO, "--sensors", "camera", "--output", path).exit_code == 0
    messages = list(Recording(path).messages())
    assert {message.device for message in messages if isinstance(message, DeviceBytes)} == {"board"}
    kinds = {type(message).__name__ for message in messages}
    assert kinds == {"Bearings", "DeviceBytes", "Displacement", "Truth"}
    done = invoke("replay", path, "--json", figures_path)
    assert done.exit_code == 0, done.output
    of_both = invoke("replay", recording, "--sensors", "camera", "--json", tmp_path / "both.json")
    assert of_both.exit_code == 0
    replayed = json.loads(figures_path.read_text())["result"]
    assert (
        replayed["updates"]
        == json.loads((tmp_path / "both.json").read_text())["result"]["updates"]
        > 60
    )


def test_what_cannot_be_scored_is_told_in_words(tmp_path, recording):
    blind, camera_less = tmp_path / "blind.mcap", tmp_path / "lidar.mcap"
    with Recorder(blind, RecordingHeader(RobotConfig(), "lidar")) as recorder:
        recorder.write(Health(0.0, "lidar", True, "", {}))
    short = tmp_path / "short.mcap"
    assert invoke("simulate", "arena4:seconds=2", "--output", short).exit_code == 0
    with Recorder(camera_less, RecordingHeader(RobotConfig(), "lidar")) as recorder:
        for message in Recording(recording).messages():
            if type(message).__name__ != "Bearings":
                recorder.write(message)
    for arguments, words in (
        ((blind,), "it holds no truth"),
        ((camera_less, "--sensors", "lidar+camera"), "no readings of lidar+camera"),
        (("arena4:seconds=7", "atlantis"), "no scenario is called 'atlantis'"),
        (("arena4:seconds=4",), "shorter than the 5 s of warm-up"),
        ((short,), "shorter than the 5 s of warm-up"),
        (("mrclam:/no/folder",), "there is no MR.CLAM dataset at /no/folder"),
        (("mrclam:/no/a,b,landmarks=drop",), "there is no MR.CLAM dataset at /no/a,b"),
        (("mrclam:/no/folder,landmarks=eat",), "has no setting 'landmarks=eat'"),
    ):
        done = invoke("evaluate", *arguments)
        assert done.exit_code == 1, done.output
        assert words in done.stderr
    for arguments in (("--filters", "phd,magic"), ("--sensors", "sonar"), ()):
        assert invoke("evaluate", *([SCENARIO] if arguments else []), *arguments).exit_code == 2
    # Of what was asked for, what there is.
    done = invoke("evaluate", camera_less, "--filters", "clairvoyant")
    assert done.exit_code == 0, done.output
    assert "lidar+camera" not in done.stdout


def test_nothing_is_computed_before_every_source_is_known_to_be_there(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "load_run", lambda *arguments: pytest.fail("it was computed"))
    for source in ("mrclam:/no/folder", "arena4:seconds=5"):
        assert invoke("evaluate", SCENARIO, source).exit_code == 1
    folder = tmp_path / "a,b"  # a dataset, but an empty one
    folder.mkdir()
    for text in (f"mrclam:{folder}", f"mrclam:{folder}, landmarks = clutter"):
        done = invoke("evaluate", text)
        assert done.exit_code == 1
        assert "has no setting" not in done.stderr
        assert str(folder / "Barcodes.dat") in done.stderr


def test_spaces_in_lists_are_no_part_of_the_names(recording):
    done = invoke("evaluate", recording, "--filters", "last_reading, phd", "--sensors", " lidar")
    assert done.exit_code == 0, done.output


def test_where_nobody_is_to_be_found_a_perfect_limit_divides_nothing():
    alone = Accumulator()
    none = np.zeros((0, 2))
    empty = Estimate(1.0, none, np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0), np.zeros(0, int))
    alone.add(none, none, empty)
    rows = [alone.row("empty room", "0", name, "lidar") for name in ("phd", "clairvoyant")]
    first, second = (line for line in table(rows).splitlines() if " lidar " in line)
    assert first.split()[3] == second.split()[3] == "0.000"
    assert first.split()[-1] == second.split()[-1] == "-"


def test_a_table_without_a_limit_or_figures_has_dashes():
    text = table([Accumulator().row("nothing", "0", "phd", "lidar")])
    (row,) = (line for line in text.splitlines() if "phd" in line)
    assert row.split()[3:] == ["-"] * 12
    assert max(map(len, text.splitlines())) < 120
    assert max(map(len, table([Accumulator().row("a", "0", "phd", "lidar")], 80).splitlines())) < 80
    assert math.isnan(Accumulator().row("", "", "", "").gospa_m)


@given(
    st.integers(0, 40),
    st.lists(st.integers(1, 12), min_size=1, max_size=12),
    st.integers(55, 200),
)
def test_a_narrow_table_has_every_cell_once_in_lines_that_fit(left, widths, columns):
    cells = [[f"{k}".rjust(width, ".") for k, width in enumerate(widths)] for _ in range(2)]
    lines = parts(["x" * left, "y" * left], cells, columns)
    assert max(map(len, lines)) < columns
    assert "".join(line[left:] for line in lines[0::2]) == "".join(cells[0])
    assert "".join(line[left:] for line in lines[1::2]) == "".join(cells[1])


def test_a_row_of_which_no_column_fits_is_a_paragraph():
    lines = parts(
        ["name     sensors", "robot    lidar"], [[" GOSPA m", " ms"], ["   0.12", "  3"]], 20
    )
    assert lines == ["  robot lidar", "    GOSPA m 0.12,", "    ms 3"]


def test_columns_are_those_of_the_environment_where_there_is_no_terminal(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert columns() == math.inf
    monkeypatch.setenv("COLUMNS", "60")
    assert columns() == 60
    figures = listing({"a name": "word " * 30, "other": 1})
    assert max(map(len, figures.splitlines())) < 60
