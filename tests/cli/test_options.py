"""What the commands share: one envelope, written before a screen that may be gone."""

import json
import math
import os
import pty
import re
import subprocess
import sys
import threading
from pathlib import Path

import click
import numpy as np
import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from host.cli.files import check_writable, write_json
from host.cli.main import Commands, main
from host.messages import Bearings, Health
from host.simulation.live_bearings import LiveCamera


@pytest.mark.parametrize(("content", "kind"), [([{"a": 1}], "rows"), ({"a": 1}, "result")])
def test_figures_of_every_command_stand_in_one_envelope(tmp_path: Path, content, kind) -> None:
    path = tmp_path / "figures.json"

    @click.group()
    def program() -> None: ...

    @program.command()
    def measure() -> None:
        write_json(path, content)

    assert CliRunner().invoke(program, ["measure"]).exit_code == 0
    assert json.loads(path.read_text()) == {
        "schema": "swarmloc.figures",
        "version": 1,
        "command": "measure",
        kind: content,
    }


def test_figures_are_written_where_the_terminal_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    master, terminal = pty.openpty()
    choice = ("--filters", "pmb", "--sensors", "lidar")
    work = "from host.cli.main import main; main()"
    program = subprocess.Popen(
        [sys.executable, "-c", work, "evaluate", "arena4:seconds=12", *choice, "--json", str(path)],
        stdin=subprocess.DEVNULL,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,  # it has no terminal to be hung up by, only its screen
    )
    os.close(terminal)
    os.read(master, 1)
    os.close(master)
    program.wait(timeout=120.0)
    content = json.loads(path.read_text())
    assert content["command"] == "evaluate"
    assert content["rows"][0]["filter"] == "pmb"


def test_where_figures_cannot_be_written_no_work_is_done(tmp_path: Path) -> None:
    for command in (["evaluate", "arena4"], ["simulate", "arena4", "--output", "x.mcap"]):
        done = CliRunner().invoke(main, [*command, "--json", str(tmp_path / "no" / "x.json")])
        assert done.exit_code == 1
        assert "there is no folder" in done.output


@pytest.mark.parametrize("file", ["", "/dev/full", "/proc/figures.json", "/dev"])
def test_a_file_that_can_never_be_written_is_refused_before_the_work(file: str) -> None:
    done = CliRunner().invoke(main, ["evaluate", "arena4", "--json", file])
    assert done.exit_code in (1, 2)
    assert re.search("cannot write|is a directory|names no file", done.output)


def test_what_is_in_a_file_stays_until_there_are_new_figures(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    path.write_text("old")
    check_writable(path)
    assert path.read_text() == "old"
    check_writable(tmp_path / "new.json")
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_to_a_file_that_is_not_there_yet_stays(tmp_path: Path) -> None:
    link, target = tmp_path / "latest.json", tmp_path / "today.json"
    link.symlink_to(target)
    check_writable(link)
    assert link.is_symlink()
    assert not target.exists()


def test_figures_reach_the_screen_where_their_file_has_become_unwritable(tmp_path: Path) -> None:
    @click.command()
    def late() -> None:
        write_json(tmp_path, {"x": math.nan})
        click.echo("the figures")

    group = Commands("swarmloc", params=list(main.params), commands={"late": late})
    group.callback = lambda **_: None
    done = CliRunner().invoke(group, ["late"])
    assert done.exit_code == 1
    assert done.output.startswith("the figures\nswarmloc: cannot write")


def test_the_envelope_names_the_command_and_has_null_for_what_is_not_finite(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"

    @click.command()
    def one() -> None:
        write_json(path, {"x": [1.0, math.nan], "y": {"z": math.inf}})

    group = click.Group("more", commands={"one": one})
    click.Group("any", commands={"more": group}).main(
        ["more", "one"], prog_name="python -m host.cli", standalone_mode=False
    )
    assert json.loads(path.read_text()) == {
        "schema": "swarmloc.figures",
        "version": 1,
        "command": "more one",
        "result": {"x": [1.0, None], "y": {"z": None}},
    }


class Simulation:
    """Frames every 10 ms; the camera is unplugged from 0.5 to 1.5 s."""

    def __init__(self) -> None:
        self.now = 0.0

    def clock(self) -> float:
        self.now += 0.01
        return self.now

    def arrival(self, frame: int) -> float:
        return 0.01 * frame

    def bearings(self, frame: int) -> Bearings:
        return Bearings(0.01 * frame, np.zeros(0), np.zeros(0), camera="front")

    def absent(self, name: str, time: float) -> bool:
        return name == "camera" and 0.5 <= time < 1.5


def test_an_unplugged_camera_shows_nothing_and_says_so() -> None:
    taken: list[object] = []
    stop = threading.Event()

    def emit(message) -> None:
        taken.append(message)
        if message.time >= 2.5:
            stop.set()

    LiveCamera(Simulation()).run(emit, stop)
    seen = [m.time for m in taken if isinstance(m, Bearings)]
    assert not [time for time in seen if 0.5 <= time < 1.5]
    assert len(seen) > 100
    assert [m.ok for m in taken if isinstance(m, Health)] == [True, False, True]


@pytest.mark.parametrize(
    ("command", "scenario"),
    [
        ("run", "arena4"),
        ("doctor", "arena4"),
        ("drive keys", "arena4"),
        ("drive walk", "arena4"),
        ("drive calibration", "arena4"),
        ("drive square", "arena4:robots=1,posts=0,side_m=6,seed=3"),
        ("calibrate wheels", "misbuilt4"),
    ],
)
def test_simulate_needs_no_scenario_and_takes_one(command: str, scenario: str) -> None:
    group, *words = command.split()
    found = main.get_command(click.Context(main), group)
    for word in words:
        assert isinstance(found, click.Group)
        found = found.get_command(click.Context(found), word)
    assert found is not None

    def given(*arguments: str) -> object:
        return found.make_context(command, [*arguments]).params["scenario"]

    assert given() is None
    assert given("--simulate") == given("--simulate", "--robot", "r.toml") == scenario
    assert given("--simulate", "swarm20:seed=2") == given("--simulate=swarm20:seed=2")
    assert given("--simulate", "swarm20:seed=2") == "swarm20:seed=2"


@pytest.mark.parametrize("end", ["| head -1", ">&- 2>&-"])
def test_a_run_whose_screen_is_gone_writes_its_figures(tmp_path: Path, end: str) -> None:
    path = tmp_path / "figures.json"
    run = f"{sys.executable} -m host.cli run --simulate arena4 --sensors lidar --view none"
    done = subprocess.run(
        f"{run} --seconds 1 --json {path} {end}",
        shell=True,
        stderr=subprocess.PIPE,
        check=False,
        timeout=60,
    )
    assert b"fault of the program" not in done.stderr
    assert json.loads(path.read_text())["command"] == "run"


@pytest.mark.parametrize(
    ("arguments", "text", "words"),
    [
        (["run", "--simulate"], "are", ["arena4"]),
        (["simulate"], "arena4:seco", ["arena4:seconds="]),
        (["simulate"], "arena4:seed=1,seco", ["arena4:seed=1,seconds="]),
        (["evaluate"], "swarm", ["swarm20"]),
        (["evaluate", "--filters"], "phd,las", ["phd,last_reading"]),
        (["replay", "--filter"], "las", ["last_reading"]),
        (["export"], "today.m", ["today.m"]),
    ],
)
def test_names_are_completed(arguments: list[str], text: str, words: list[str]) -> None:
    found = ShellComplete(main, {}, "swarmloc", "_X").get_completions(arguments, text)
    assert [item.value for item in found] == words
