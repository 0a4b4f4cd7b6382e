"""From the board's sources to its firmware: with PlatformIO or with Debian's avr-gcc."""

import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from host.errors import UserError
from host.flashing import elf
from host.flashing.arduino_core import DEBIAN, ArduinoCore
from host.folders import build_folder, data_folder

PROJECT = data_folder() / "firmware/romeo_odometry"
FLASH_BYTES = 28672  # what the bootloader leaves of the ATmega32U4's 32 KiB
RAM_BYTES = 2560

# Debian's package: a file that it brings.
_PACKAGES = {
    "gcc-avr": Path("/usr/bin/avr-gcc"),
    "binutils-avr": Path("/usr/bin/avr-objcopy"),
    "avr-libc": Path("/usr/lib/avr/include/avr/io.h"),
    "arduino-core-avr": DEBIAN / "platform.txt",
}
_RECIPES = {".c": "c.o", ".cpp": "cpp.o", ".S": "S.o"}
_OUR_WARNINGS = {"compiler.warning_flags": "-Wall -Wextra -Werror"}
_NAME = "firmware"
# What the compiler and the linker put into a line that says what is wrong.
_ERROR = re.compile(r"error: (?!ld returned)|undefined reference|multiple definition|within region")
REGISTRY = "https://api.registry.platformio.org/v3/packages/platformio/platform/atmelavr"
REGISTRY_PATIENCE_S = 3.0
_ENVIRONMENT = "leonardo"  # of platformio.ini
_PLATFORM_PARTS = (
    "platforms/atmelavr",
    "packages/toolchain-atmelavr",
    "packages/framework-arduino-avr",
    "packages/tool-scons",
)


@dataclass(frozen=True, slots=True)
class Firmware:
    """Built firmware. flash_bytes, ram_bytes: what it takes (of RAM: without the stack).

    built_with: the tool and its version, in words.
    """

    elf: Path
    hex: Path
    flash_bytes: int
    ram_bytes: int
    built_with: str


def build_with_avr_gcc(
    defines: Mapping[str, str] | None = None, project: Path = PROJECT
) -> Firmware:
    """Build with Debian's avr-gcc and Arduino core, once for each state of the sources.

    defines: preprocessor macros for the project's own files. project: a folder with src/ and
    perhaps include/. Raises UserError where packages are missing (it names them) or where the
    sources do not compile.
    """
    require_avr_gcc()
    core = ArduinoCore()
    compiler = _run([str(_PACKAGES["gcc-avr"]), "-dumpfullversion", "-dumpversion"]).strip()
    archive = _core_archive(core, compiler)
    flags = [f"-D{name}={value}" for name, value in sorted((defines or {}).items())]
    folder = _project_build(core, archive, flags, project)
    return measured(folder / f"{_NAME}.elf", f"avr-gcc {compiler}")


def build_with_platformio(project: Path = PROJECT, workspace: Path | None = None) -> Firmware:
    """Build with PlatformIO, which downloads what its folder (PLATFORMIO_CORE_DIR) lacks.

    project: a folder with a platformio.ini. workspace: for what is built; None: one in
    build_folder(). Raises UserError where PlatformIO is not installed or the build fails.
    """
    pio = find_platformio()
    if pio is None:
        raise UserError(
            "cannot build the firmware with PlatformIO",
            "it is not installed",
            "run: pip install platformio    or build with Debian's avr-gcc",
        )
    workspace = workspace or build_folder() / "platformio"
    environment = {
        "PLATFORMIO_WORKSPACE_DIR": str(workspace),
        # To build is not to agree to be counted.
        "PLATFORMIO_SETTING_ENABLE_TELEMETRY": "false",
        "PLATFORMIO_DISABLE_UPGRADE_CHECK": "true",
    }
    _run([pio, "run", "--project-dir", str(project), "--environment", _ENVIRONMENT], environment)
    version = _run([pio, "--version"]).split()[-1]
    return measured(workspace / "build" / _ENVIRONMENT / f"{_NAME}.elf", f"PlatformIO {version}")


def build(project: Path = PROJECT) -> Firmware:
    """Build with PlatformIO where it can, else with Debian's avr-gcc; `built_with` tells why."""
    if find_platformio() is None:
        obstacle = "PlatformIO is not installed"
    elif _has_platform() or _registry_answers():
        return build_with_platformio(project)
    else:
        obstacle = "PlatformIO's registry does not answer"
    built = build_with_avr_gcc(project=project)
    return replace(built, built_with=f"{built.built_with}, for {obstacle}")


def find_platformio() -> str | None:
    """The command `pio`: that of this Python's environment, else the one on PATH."""
    beside = Path(sys.executable).with_name("pio")
    return str(beside) if beside.exists() else shutil.which("pio")


def platformio_folder() -> Path:
    """Where PlatformIO keeps what it has downloaded."""
    return Path(os.environ.get("PLATFORMIO_CORE_DIR") or Path.home() / ".platformio")


def _has_platform() -> bool:
    """Has PlatformIO all it needs in its folder?"""
    return all((platformio_folder() / part).is_dir() for part in _PLATFORM_PARTS)


def _registry_answers() -> bool:
    try:
        with urllib.request.urlopen(REGISTRY, timeout=REGISTRY_PATIENCE_S):
            return True
    except urllib.error.HTTPError:
        return True  # whatever it says, it is there
    except OSError:
        return False


def require_avr_gcc() -> None:
    """Raise UserError where Debian's packages for a build are missing."""
    missing = [package for package, file in _PACKAGES.items() if not file.exists()]
    if missing:
        raise UserError(
            "cannot build the firmware",
            f"not installed: {', '.join(missing)}",
            f"run: sudo apt-get install -y {' '.join(missing)}",
        )


def measured(built: Path, built_with: str) -> Firmware:
    """The firmware in an ELF that has its .hex beside it. Raises UserError where it is too large.

    The linker does not know that the bootloader takes a part of the flash.
    """
    sizes = elf.section_sizes(built)
    flash = sum(sizes.get(name, 0) for name in (".text", ".data"))
    ram = sum(sizes.get(name, 0) for name in (".data", ".bss", ".noinit"))
    if flash > FLASH_BYTES:
        raise UserError(
            "the firmware does not fit the board",
            f"it takes {flash} bytes of flash, and the board has {FLASH_BYTES}",
            "make it smaller",
        )
    return Firmware(built, built.with_suffix(".hex"), flash, ram, built_with)


def _core_archive(core: ArduinoCore, compiler: str) -> Path:
    """The Arduino core as an archive, from which the linker takes what is used and no more."""
    files = [*core.descriptions, *_files(core.core), *_files(core.variant)]

    def make(folder: Path) -> None:
        for made in _compile(core, _sources(core.core), [], folder, {}):
            names = {"archive_file_path": str(folder / "core.a"), "object_file": str(made)}
            _run(core.command("ar", names))

    return _once(f"core-{_digest(files, [compiler])}", make) / "core.a"


def _project_build(core: ArduinoCore, archive: Path, flags: Sequence[str], project: Path) -> Path:
    """The folder with the project's .elf and .hex."""
    include, src = project / "include", project / "src"
    sources = _sources(src)
    if not sources:
        raise UserError(
            "cannot build the firmware",
            f"there are no sources in {src}",
            "restore its src/ folder, or install swarmloc again",
        )

    def make(folder: Path) -> None:
        ours = [*flags, f"-I{include}", f"-I{src}"]
        objects = _compile(core, sources, ours, folder, _OUR_WARNINGS)
        names = {
            "build.path": str(folder),
            "build.project_name": _NAME,
            "object_files": shlex.join(map(str, objects)),
            "archive_file": os.path.relpath(archive, folder),
        }
        _run(core.command("c.combine", names))
        _run(core.command("objcopy.hex", names))

    key = _digest([*_files(include), *_files(src)], [archive.parent.name, *flags])
    return _once(f"avr-gcc-{key}", make)


def _compile(
    core: ArduinoCore,
    sources: Sequence[Path],
    flags: Sequence[str],
    folder: Path,
    values: Mapping[str, str],
) -> list[Path]:
    """Objects of the sources in `folder`, compiled on as many processors as there are."""
    includes = shlex.join([*flags, f"-I{core.core}", f"-I{core.variant}"])
    objects = [folder / f"{number:02}-{source.name}.o" for number, source in enumerate(sources)]
    commands = [
        core.command(
            _RECIPES[source.suffix],
            {
                **values,
                "includes": includes,
                "source_file": str(source),
                "object_file": str(made),
            },
        )
        for source, made in zip(sources, objects, strict=True)
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(_run, commands))
    return objects


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _sources(folder: Path) -> list[Path]:
    return [path for path in _files(folder) if path.suffix in _RECIPES]


def _digest(files: Iterable[Path], settings: Iterable[str]) -> str:
    """A name for this state of the files, of the settings and of the way they are built."""
    whole = hashlib.sha256()
    for path in (*files, Path(__file__), Path(__file__).with_name("arduino_core.py")):
        whole.update(f"{path}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    for text in settings:
        whole.update(f"{text}\0".encode())
    return whole.hexdigest()[:16]


def _once(name: str, make: Callable[[Path], None]) -> Path:
    """A folder that `make` fills where it is not there: whole or absent, whoever else builds."""
    folder = build_folder() / name
    if folder.is_dir():
        return folder
    made = Path(tempfile.mkdtemp(prefix=f"{name}.", dir=folder.parent))
    try:
        make(made)
        try:
            made.rename(folder)
        except OSError:
            if not folder.is_dir():  # else another process was first with the same
                raise
    finally:
        shutil.rmtree(made, ignore_errors=True)
    return folder


def _run(command: Sequence[str], environment: Mapping[str, str] | None = None) -> str:
    """The command's standard output. Raises UserError with what it said where it failed."""
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "LC_ALL": "C", **(environment or {})},
    )
    if done.returncode == 0:
        return done.stdout
    said = (done.stderr or done.stdout).strip().splitlines()
    errors = [line for line in said if _ERROR.search(line)] or said[-1:] or ["it did not say why"]
    raise UserError(
        f"cannot build the firmware: {Path(command[0]).name} failed",
        "\n".join(errors[:3]),
        "correct the sources it names and build again",
    )
