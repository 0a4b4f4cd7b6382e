"""From the board's sources to its firmware: with PlatformIO or with Debian's avr-gcc."""

import hashlib
import os
import shlex
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from host.errors import UserError
from host.flashing.arduino_core import DEBIAN, ArduinoCore
from host.flashing.firmware import PROJECT, Firmware, files_in, measured, run_tool, written
from host.flashing.platformio import build_with_platformio, platformio_obstacle
from host.folders import build_folder

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


def build_with_avr_gcc(
    defines: Mapping[str, str] | None = None, project: Path = PROJECT
) -> Firmware:
    """Build with Debian's avr-gcc and Arduino core, once for each state of the sources.

    defines: preprocessor macros for the project's own files. project: a folder with src/ and
    perhaps include/. Raises UserError if packages are missing (it names them) or the sources
    do not compile.
    """
    require_avr_gcc()
    core = ArduinoCore()
    compiler = run_tool([str(_PACKAGES["gcc-avr"]), "-dumpfullversion", "-dumpversion"]).strip()
    archive = _core_archive(core, compiler)
    flags = [f"-D{name}={value}" for name, value in sorted((defines or {}).items())]
    folder = _project_build(core, archive, flags, project)
    return measured(folder / f"{_NAME}.elf", f"avr-gcc {compiler}")


def build(project: Path = PROJECT) -> Firmware:
    """Build with PlatformIO if it can, else with Debian's avr-gcc; `built_with` says why."""
    obstacle = platformio_obstacle()
    if not obstacle:
        return build_with_platformio(project)
    built = build_with_avr_gcc(project=project)
    return replace(built, built_with=f"{built.built_with}, because {obstacle}")


def require_avr_gcc() -> None:
    """Raise UserError if Debian's packages for a build are missing."""
    missing = [package for package, file in _PACKAGES.items() if not file.exists()]
    if missing:
        raise UserError(
            "cannot build the firmware",
            f"not installed: {', '.join(missing)}",
            f"run: sudo apt-get install -y {' '.join(missing)}",
        )


def _core_archive(core: ArduinoCore, compiler: str) -> Path:
    """The Arduino core as an archive, from which the linker takes what is used and no more."""
    files = [*core.descriptions, *files_in(core.core), *files_in(core.variant)]

    def make(folder: Path) -> None:
        for made in _compile(core, _sources(core.core), [], folder, {}):
            names = {"archive_file_path": str(folder / "core.a"), "object_file": str(made)}
            run_tool(core.command("ar", names))

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
        run_tool(core.command("c.combine", names))
        run_tool(core.command("objcopy.hex", names))

    key = _digest([*files_in(include), *files_in(src)], [archive.parent.name, *flags])
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
        list(pool.map(run_tool, commands))
    return objects


def _sources(folder: Path) -> list[Path]:
    return [path for path in files_in(folder) if path.suffix in _RECIPES]


def _digest(files: Iterable[Path], settings: Iterable[str]) -> str:
    """A name for this state of the files, of the settings and of the way they are built."""
    whole = hashlib.sha256()
    for path in (*files, Path(__file__), Path(__file__).with_name("arduino_core.py")):
        whole.update(f"{path}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    for text in settings:
        whole.update(f"{text}\0".encode())
    return whole.hexdigest()[:16]


def _once(name: str, make: Callable[[Path], None]) -> Path:
    """A folder that `make` fills if it is absent: it is complete, even if several build at once."""
    folder = build_folder() / name
    if folder.is_dir():
        return folder
    with (
        written(folder.parent),
        tempfile.TemporaryDirectory(prefix=f"{name}.", dir=folder.parent) as made,
    ):
        make(Path(made))
        try:
            os.rename(made, folder)
        except OSError:
            if not folder.is_dir():  # else another process was first with the same
                raise
    return folder
