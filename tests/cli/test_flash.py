"""`swarmloc flash` as its user sees it."""

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from serial.tools import list_ports

from host.cli.main import main
from host.drivers.romeo.checks import firmware_version
from host.drivers.romeo.protocol import PROTOCOL_HASH
from host.flashing import build as romeo_build
from host.flashing.build import build_with_avr_gcc
from host.flashing.flash import find_avrdude
from host.flashing.identity import identity_of, in_words
from host.simulation.devices import romeo_stand_in as romeo_device
from tests.flashing.romeo_machine import Machine
from tests.toolchain import needed


@pytest.fixture(autouse=True)
def built_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    built = needed(build_with_avr_gcc)
    monkeypatch.setattr(romeo_build, "build", lambda: built)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["flash", *map(str, arguments)])


def test_help_has_an_example_and_fits_the_screen() -> None:
    told = invoke("--help")
    assert re.search(r"Examples:\n +swarmloc flash\n", told.output)
    assert "--json FILE" in told.output
    assert max(map(len, told.output.splitlines())) <= 80
    listed = CliRunner().invoke(main, "--help").output
    assert re.search(r"^  flash +Build and upload the board's firmware", listed, re.MULTILINE)


def test_build_only_prints_where_the_elf_is_and_what_it_takes(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    done = invoke("--build-only", "--json", path)
    assert (done.exit_code, done.stderr) == (0, "")
    figures = json.loads(path.read_text("utf-8"))["result"]
    assert Path(figures["elf"]).read_bytes().startswith(b"\x7fELF")
    assert f"  ELF    {figures['elf']}\n" in done.output
    for word, name, whole in (("flash", "flash", 28672), ("RAM", "ram", 2560)):
        used, percent = figures[f"{name}_bytes"], figures[f"{name}_percent"]
        assert percent == pytest.approx(100 * used / whole, abs=0.05)
        assert re.search(rf"^  {word} +{used} bytes, {percent} % of {whole}", done.output, re.M)
    assert figures.keys() == {
        *("elf", "built_with", "flash_bytes", "flash_percent", "ram_bytes", "ram_percent")
    }


def test_a_board_is_flashed_with_a_line_for_each_step(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    needed(find_avrdude)
    built = identity_of()
    version = firmware_version(built)
    monkeypatch.setattr(romeo_device, "VERSION", tuple(map(int, version.split("."))))
    path = tmp_path / "figures.json"
    with Machine(tmp_path) as machine:
        monkeypatch.setattr(list_ports, "comports", machine.comports)
        done = invoke("--port", machine.sketch.path, "--json", path)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1] == f"done: the board runs {in_words(built)}"
    figures = json.loads(path.read_text("utf-8"))["result"]
    assert figures["port"] == str(machine.sketch.path)
    assert figures["version"] == version
    assert figures["protocol_hash"] == f"{PROTOCOL_HASH:08x}"


def test_without_a_board_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    needed(find_avrdude)
    monkeypatch.setattr(list_ports, "comports", list)
    failed = invoke()
    assert failed.exit_code == 1
    assert failed.stderr.startswith("swarmloc: the board was not found\n")
    assert "Traceback" not in failed.output
