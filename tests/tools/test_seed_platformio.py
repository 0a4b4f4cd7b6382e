"""PlatformIO without its registry: the unchanged platformio.ini builds the very same firmware."""

import importlib.util
import subprocess
from pathlib import Path

import pytest

from host.errors import UserError
from host.flashing.build import build_with_avr_gcc, require_avr_gcc
from host.flashing.firmware import PROJECT
from host.flashing.platformio import build_with_platformio, find_platformio
from tests.toolchain import missing, needed

SPEC = importlib.util.spec_from_file_location(
    "seed_platformio", PROJECT.parents[1] / "tools/seed_platformio/seed.py"
)
assert SPEC is not None
assert SPEC.loader is not None
seeding = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(seeding)


@pytest.fixture(scope="module")
def core_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    needed(require_avr_gcc)
    if find_platformio() is None:
        missing("PlatformIO is not installed: pip install -e '.[firmware]'")
    folder = tmp_path_factory.mktemp("platformio") / "core"
    needed(lambda: seeding.seed(folder))
    return folder


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch, core_folder: Path) -> None:
    """No request leaves this machine: what the seeding has forgotten is missed."""
    monkeypatch.setenv("PLATFORMIO_CORE_DIR", str(core_folder))
    for name in ("HTTP_PROXY", "HTTPS_PROXY", "http_proxy", "https_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")


@pytest.mark.slow
def test_the_project_is_free_of_lint() -> None:
    pio = find_platformio()
    assert pio is not None
    command = [pio, "project", "config", "--lint", "--project-dir", PROJECT]
    told = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "free from linting errors" in told.stdout


@pytest.mark.slow
def test_it_builds_byte_for_byte_what_avr_gcc_alone_builds(tmp_path: Path) -> None:
    """So what was shown of the one holds for the other."""
    settings = (PROJECT / "platformio.ini").read_bytes()
    by_platformio = build_with_platformio(workspace=tmp_path)
    by_avr_gcc = build_with_avr_gcc()
    assert by_platformio.built_with.startswith("PlatformIO 6.")
    assert by_platformio.elf.is_relative_to(tmp_path)
    assert by_platformio.hex.read_bytes() == by_avr_gcc.hex.read_bytes()
    assert by_platformio.flash_bytes == by_avr_gcc.flash_bytes
    assert by_platformio.ram_bytes == by_avr_gcc.ram_bytes
    assert (PROJECT / "platformio.ini").read_bytes() == settings
    # PlatformIO is given a copy: it refuses a project that cannot be written, as an installed one.
    copied = {path.name for path in (tmp_path / "project").iterdir()}
    assert copied >= {"include", "src", "platformio.ini"}


def test_nothing_of_the_users_is_overwritten(tmp_path: Path, core_folder: Path) -> None:
    (tmp_path / "letters").mkdir()
    with pytest.raises(UserError, match="it holds other files"):
        seeding.seed(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["letters"]
    seeding.seed(core_folder)  # its own work it does again


def test_a_scons_that_platformio_would_not_take_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(seeding.metadata, "version", lambda name: "4.9.1")
    with pytest.raises(UserError, match=r"tool-scons .*, and SCons 4\.9\.1 is 4\.40901\.0"):
        seeding.seed(tmp_path)
