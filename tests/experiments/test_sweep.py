"""`swarmloc sweep`: on two cores, interrupted and resumed on a scheduler; the table is the same."""

import os
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from host.cli.main import main
from host.cli.sweep import table
from host.errors import UserError
from host.experiments import sweeping, trials
from host.experiments.intervals import summaries

SEEDS = [1, 2]
ARGUMENTS = (
    "arena4:seconds=6",
    "--seeds",
    "1-2",
    "--filters",
    "phd",
    "--set",
    "filter.pmb.report_error_m=0.1,0.5",
)
LONG_S = 120.0  # a bound on waiting, not on speed


@pytest.fixture(scope="module")
def expected():
    """The table, from trials one after another in this process."""
    every = trials.grid(
        trials.seeded(["arena4:seconds=6"], SEEDS),
        ["phd"],
        ["lidar+camera", "lidar"],
        [("filter.pmb.report_error_m", [0.1, 0.5])],
    )
    return table(summaries([trials.score(trial) for trial in every]), 80)


def invoke(*arguments):
    return CliRunner().invoke(main, ["sweep", *map(str, arguments)])


@pytest.mark.slow
def test_interrupted_and_resumed_on_a_running_scheduler_the_table_is_the_same(tmp_path, expected):
    distributed = pytest.importorskip("distributed")
    output = tmp_path / "sweep.jsonl"
    command = [sys.executable, "-c", "from host.cli.main import main; main()", "sweep", *ARGUMENTS]
    process = subprocess.Popen(
        [*command, "--output", str(output), "--workers", "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    end = time.monotonic() + LONG_S
    while not (output.exists() and output.read_text()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=LONG_S)
    assert process.returncode == 1, errors
    assert "of 8 trials are in" in errors
    before = output.read_text().splitlines()
    assert 0 < len(before) < 8

    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as far:
        address = far.scheduler_address
        table = tmp_path / "table.json"
        more = "--scheduler", address, "--json", table
        resumed = invoke(*ARGUMENTS, "--output", output, *more)
    assert resumed.exit_code == 0, resumed.output
    assert f"{len(before)} of 8 trials are in" in resumed.stderr
    assert resumed.stdout.strip() == expected.strip()
    assert table.read_text().count('"gospa_m_ci95"') == 4
    assert output.read_text().splitlines()[: len(before)] == before

    # Once more: nothing is left to do, so no cluster is needed.
    again = invoke(*ARGUMENTS, "--output", output, "--scheduler", "tcp://127.0.0.1:1")
    assert again.stdout == resumed.stdout


def test_a_scheduler_that_does_not_answer_is_reported_in_words(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("host.experiments.sweeping._CONNECT_S", 0.2)
    done = invoke("arena4", "--output", tmp_path / "s", "--scheduler", "tcp://127.0.0.1:1")
    assert done.exit_code == 1
    assert "no scheduler answers at tcp://127.0.0.1:1" in done.stderr


def test_without_dask_the_line_to_paste_is_given(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = invoke("arena4", "--output", tmp_path / "s")
    assert done.exit_code == 1
    assert "pip install 'swarmloc[sweep]'" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("arena4", "--seeds", "1-x"), 2),
        (("arena4", "--seeds", "-3"), 2),
        (("arena4", "--seeds", "3-1"), 2),
        (("arena4", "--seeds", "1-"), 2),
        (("arena4", "--filters", "magic"), 2),
        (("arena4", "--set", "filter.magic=1"), 1),
        (("arena4:seed=1", "--seeds", "1-2"), 1),
        (("atlantis",), 1),
    ],
)
def test_what_is_mistyped_fails_before_anything_is_computed(tmp_path, monkeypatch, arguments, code):
    pytest.importorskip("distributed")
    monkeypatch.setattr("host.cli.sweep.sweep", lambda *_: pytest.fail("it was computed"))
    assert invoke(*arguments, "--output", tmp_path / "s.jsonl").exit_code == code


def test_trials_of_a_source_go_together_where_that_leaves_enough_for_every_core():
    several = trials.grid(["a", "b", "c", "d"], ["phd"] * 5, ["lidar", "lidar+camera"])
    chunks = sweeping._chunks(several, 2)
    assert [trial for chunk in chunks for trial in chunk] == several
    assert [len(chunk) for chunk in chunks] == [8, 2] * 4
    assert all(len({trial.source for trial in chunk}) == 1 for chunk in chunks)
    assert sweeping._chunks(several, 5) == [[trial] for trial in several]


def test_what_another_program_scored_is_refused():
    trial = trials.Trial("arena4", "phd", "lidar")
    sweeping._check_program(trial, {"key": trial.key()})
    with pytest.raises(UserError, match="another version"):
        sweeping._check_program(trial, {"key": "of another"})
