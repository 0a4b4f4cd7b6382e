"""What holds for every command: options, files that are written, numbers, help."""

import errno
import io
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from host.calibration import robot_file
from host.cli.files import OutputFile, check_writable
from host.cli.main import main
from host.cli.options import Number
from host.cli.terminal.layout import listing, terminal_columns
from host.errors import UserError


def commands(
    group: click.Group = main, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


EVERY = dict(commands())


def refusal(*arguments: str) -> str:
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 2, done.output
    return done.output


@pytest.mark.parametrize("path", EVERY, ids=" ".join)
def test_each_command_has_json_help_and_an_example(path: tuple[str, ...]) -> None:
    command = EVERY[path]
    (option,) = [each for each in command.params if each.opts == ["--json"]]
    assert isinstance(option.type, OutputFile)
    assert "Example" in f"{command.help}{command.epilog}"
    assert all(each.help for each in command.params if isinstance(each, click.Option))
    for each in command.params:
        assert type(each.type) is not click.types.FloatRange, f"{each.opts}: nan passes"


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "-1", "1e400", "five", ""])
def test_no_option_takes_what_is_no_number(value: str) -> None:
    for path, command in EVERY.items():
        for option in command.params:
            if isinstance(option.type, Number):
                refusal(*path, option.opts[0], value)


@pytest.mark.parametrize("value", ["-", "", "."])
def test_no_file_is_written_that_has_no_name(value: str) -> None:
    for path, command in EVERY.items():
        for option in command.params:
            if isinstance(option, click.Option) and isinstance(option.type, OutputFile):
                said = refusal(*path, option.opts[0], value)
                assert re.search("names no file|is a directory", said), said


@pytest.mark.parametrize(
    "arguments",
    [
        "replay a.mcap --json a.mcap",
        "evaluate arena4 ./a.mcap --json a.mcap",
        "evaluate bag:a.mcap,scan=/scan --json a.mcap",
        "evaluate arena4 --truth a.mcap:robot --json a.mcap",
        "export a.mcap out --json out",
        "record --repair a.mcap --json a.mcap",
        "record --repair a.mcap --output b.mcap --json b.mcap",
        "simulate arena4 --output b.mcap --json b.mcap",
        "simulate arena4 --output a.mcap --robot a.mcap",
        "sweep a.mcap --output a.mcap",
        "map a.mcap b.png --json b.png",
        "run --simulate --record b.mcap --json b.mcap",
        "drive walk --simulate --record b.mcap --json b.mcap",
        "calibrate wheels a.mcap --report a.mcap",
        "calibrate colour a.mcap --output a.mcap",
        "print strip --output a.mcap --robot a.mcap",
    ],
)
def test_no_file_serves_for_two(
    arguments: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    recording = tmp_path / "a.mcap"
    recording.write_text("precious")
    assert "are one file" in refusal(*arguments.split())
    assert recording.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [recording]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("run --simulate --view 127.0.0.1:65536", "no address with a port up to 65535"),
        ("run --simulate --foxglove none", "no address with a port"),
        ("replay a.mcap --view 127.0.0.1:-1", "no address with a port"),
        ("sweep arena4 --seeds 1-9999999999", "more than 100000 seeds"),
        ("drive nonsense", "No such command 'nonsense'"),
        ("drive walk --seed -1", "-1 is not in the range"),
        ("calibrate all a.mcap --simulate", "No such option"),
        ("doctor --udev-rules --json x.json", "--udev-rules only prints"),
        ("init --set lidar.x_m=0.1 --set lidar.x_m=0.2", "lidar.x_m is set twice"),
        ("record --repair .", "is a directory"),
    ],
)
def test_what_cannot_be_used_is_refused_before_the_work(arguments: str, words: str) -> None:
    assert words in refusal(*arguments.split())


def test_settings_that_robot_toml_cannot_hold_leave_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["init", "--set", "lidar.x_m=7"])
    assert done.exit_code == 1
    assert "7 mm are 0.007 m\ncorrect the values of --set" in done.output
    assert not list(tmp_path.iterdir())
    key = "0123456789abcdef"
    done = CliRunner().invoke(main, ["init", "--set", f"link.key={key}", "--json", "i.json"])
    assert done.exit_code == 0, done.output
    content = json.loads((tmp_path / "i.json").read_text())
    assert content["result"] == {"file": "robot.toml", "settings": {"link.key": "(as given)"}}
    assert f'key = "{key}"' in (tmp_path / "robot.toml").read_text()


def test_a_printed_strip_has_its_figures_in_the_envelope(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(main, ["print", "strip", "--json", "s.json"]).exit_code == 0
    content = json.loads((tmp_path / "s.json").read_text())
    assert (content["command"], content["result"]["output"]) == ("print strip", "strip.svg")


class Full(io.StringIO):
    def write(self, text: str) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_streams_that_are_full_or_closed_are_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(SystemExit, match="1"):
        main.main(["drive", "keys", "--simulate"])
    sys.stdin.close()  # that stands in for it
    assert "standard input is not a terminal" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(SystemExit, match="1"):
        main.main(["--help"])
    assert "cannot write the output\nNo space left" in capsys.readouterr().err
    with pytest.raises(OSError, match="No space left"):
        main.main(["--debug", "init", "--help"])


def test_what_a_terminal_cannot_show_is_no_failure() -> None:
    runner = CliRunner(charset="latin-1")
    done = runner.invoke(main, ["replay", "Ωmega.mcap"])
    assert "cannot read the recording ?mega.mcap" in done.output


@pytest.mark.parametrize("columns", ["0", "1", "-3", "20"])
def test_terminals_of_any_width_are_served(columns: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    text = listing({"a long name of a figure": "word " * 20, "b": "1"})
    assert max(map(len, text.splitlines())) <= max(20, terminal_columns())


def test_a_pipe_is_left_to_its_reader(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    check_writable(pipe)  # does not wait
    with pytest.raises(UserError, match="it is a device or a pipe"):
        robot_file.check_writable(pipe)
