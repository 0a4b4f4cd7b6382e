"""docs/extending.md: its files, loaded by its commands, do what it says."""

import ast
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from host.cli.main import main

ROOT = Path(__file__).parent.parent
DOCUMENT = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", DOCUMENT, re.DOTALL)
FILES = {
    re.match(r"# (\S+)\n", text)[1]: text for kind, text in BLOCKS if kind in ("python", "toml")
}
COMMANDS = [line for kind, text in BLOCKS if kind == "sh" for line in text.splitlines()]
PROGRAM = "from host.cli.main import main; main()"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("extending")
    for name, text in FILES.items():
        (path / name).write_text(text, encoding="utf-8")
    return path


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )


def swarmloc(folder: Path, line: str) -> subprocess.CompletedProcess[str]:
    program, *arguments = shlex.split(line)
    assert program == "swarmloc"
    return python(folder, "-c", PROGRAM, *arguments)


def test_the_document_shows_each_kind_with_commands() -> None:
    assert set(FILES) == {
        "newest.py",
        "robot.toml",
        "compare.py",
        "hall.py",
        "lines.py",
        "lines.toml",
    }
    for command in ("run", "replay", "evaluate", "simulate"):
        assert any(f".py {command} " in line for line in COMMANDS), command


def reported(output: str) -> bool:
    """Was any teammate reported?"""
    found = re.search(r"teammates +(\d+\.\d) reported", output)
    return found is not None and float(found[1]) > 0.0


@pytest.mark.parametrize("plugin", ["newest.py", "hall.py", "lines.py"])
def test_its_commands_work(plugin: str, folder: Path) -> None:
    """One after another: some read what others wrote."""
    lines = [line for line in COMMANDS if f"--plugin {plugin} " in line]
    assert len(lines) >= 3
    for line in lines:
        done = swarmloc(folder, line)
        if " run " in line and not reported(done.stdout):  # too short on a busy computer
            (folder / "newest.mcap").unlink(missing_ok=True)
            (folder / "lines.mcap").unlink(missing_ok=True)
            done = swarmloc(folder, re.sub(r"--seconds \d", "--seconds 20", line))
        assert done.returncode == 0, done.stderr
        assert " run " not in line or reported(done.stdout), done.stdout
        if " replay " in line:
            assert re.search(r"[1-9]\d* bit-identical, 0 different", done.stdout), done.stdout
        if "newest,phd" in line:
            assert re.search(r" newest +lidar ", done.stdout), done.stdout


def test_the_python_program_prints_figures(folder: Path) -> None:
    done = python(folder, "compare.py")
    assert re.fullmatch(r"newest: GOSPA 0\.\d+ m\nphd: GOSPA 0\.\d+ m\n", done.stdout), done.stderr


def test_without_the_plugin_what_is_known_is_told(folder: Path) -> None:
    robot = str(folder / "robot.toml")
    done = CliRunner().invoke(main, ["run", "--robot", robot, "--simulate", "--seconds", "1"])
    assert done.exit_code == 1
    assert "line 3: filter.profile = 'newest': no filter is called so; known: phd" in done.stderr
    recording = folder / "plugin.mcap"
    made = "swarmloc --plugin newest.py simulate arena4:seconds=1 --robot robot.toml"
    assert swarmloc(folder, f"{made} --output {recording}").returncode == 0
    done = CliRunner().invoke(main, ["replay", str(recording)])
    assert done.exit_code == 1
    assert "filter.profile = 'newest': no filter is called so" in done.stderr
    assert "load the plugin" in done.stderr


def test_every_file_is_python_with_types() -> None:
    for name, text in FILES.items():
        if name.endswith(".py"):
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.FunctionDef):
                    assert node.returns is not None, f"{name}: {node.name}"
