"""`swarmloc init` as its user sees it."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from host.cli.main import main
from host.config import RobotConfig, load_config

EXAMPLE = Path(__file__).resolve().parents[2] / "robots/cherokey.toml"


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def init(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["init", *arguments])


def test_the_commented_example_is_written_with_the_next_steps(here: Path) -> None:
    done = init()
    assert (done.exit_code, done.stderr) == (0, "")
    assert (here / "robot.toml").read_bytes() == EXAMPLE.read_bytes()
    assert load_config(here / "robot.toml") == RobotConfig()
    assert "swarmloc run --simulate arena4 --robot robot.toml\n" in done.output
    assert "swarmloc flash\n" in done.output


def test_a_file_that_exists_is_left_as_it_is(here: Path) -> None:
    (here / "mine.toml").write_text("name = 'mine'\n")
    done = init("mine.toml")
    assert (done.exit_code, done.stdout) == (1, "")
    assert "mine.toml was not written\nit exists already\n" in done.stderr
    assert (here / "mine.toml").read_text() == "name = 'mine'\n"


def test_a_folder_that_is_not_there_is_reported() -> None:
    done = init("nowhere/robot.toml")
    assert done.exit_code == 1
    assert "cannot write nowhere/robot.toml\nNo such file or directory\n" in done.stderr
