"""A PlatformIO core folder out of Debian's and PyPI's packages, for builds without its registry.

`python tools/seed_platformio/seed.py FOLDER` fills it; then, with PLATFORMIO_CORE_DIR=FOLDER,
`pio run` finds in it all that `platform = atmelavr`, `framework = arduino` asks for and downloads
nothing. It builds only: no upload, no other board.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Iterable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from host.errors import UserError
from host.flashing.arduino_core import BOARD, DEBIAN, ArduinoCore
from host.flashing.build import require_avr_gcc

PLATFORM = Path(__file__).with_name("atmelavr")
BINARIES = Path("/usr/bin")
MARK = "seeded-by-swarmloc"
# They need only fit each other: the platform seeded here asks for the packages seeded here.
PLATFORM_VERSION, TOOLCHAIN_VERSION, FRAMEWORK_VERSION = "5.1.0", "1.70300.0", "5.3.0"
OWNER = "platformio"
_INSTALL = "run: pip install -e '.[firmware]'"


def seed(folder: Path) -> None:
    """Fill `folder`, which is new, empty or seeded before.

    Raises UserError where it holds anything else, or where a package is missing or unfit.
    """
    if folder.exists() and any(folder.iterdir()) and not (folder / MARK).exists():
        raise UserError(
            f"will not seed {folder}", "it holds other files", "name a folder that is not there"
        )
    require_avr_gcc()
    core = ArduinoCore()
    for part in ("packages", "platforms"):
        shutil.rmtree(folder / part, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    packages = folder / "packages"
    _scons(_package(packages, "tool-scons", _scons_version(), "tool"))
    _links(
        _package(packages, "toolchain-atmelavr", TOOLCHAIN_VERSION, "tool") / "bin",
        BINARIES.glob("avr-*"),
    )
    _links(_package(packages, "framework-arduino-avr", FRAMEWORK_VERSION, "tool"), DEBIAN.iterdir())
    platform = _package(folder / "platforms", "atmelavr", PLATFORM_VERSION, "platform")
    shutil.copytree(PLATFORM, platform, dirs_exist_ok=True)
    _write(platform / "platform.json", _platform())
    _write(platform / "boards" / f"{BOARD}.json", _board(core))
    _write(platform / "recipes.json", _recipes(core))


def _package(parent: Path, name: str, version: str, kind: str) -> Path:
    """A new folder that PlatformIO takes for a package from its registry."""
    folder = parent / name
    folder.mkdir(parents=True)
    if kind == "tool":
        _write(folder / "package.json", {"name": name, "version": version})
    spec = {"owner": OWNER, "id": None, "name": name, "requirements": None, "uri": None}
    _write(folder / ".piopm", {"type": kind, "name": name, "version": version, "spec": spec})
    return folder


def _links(folder: Path, targets: Iterable[Path]) -> None:
    folder.mkdir(exist_ok=True)
    for target in targets:
        (folder / target.name).symlink_to(target)


def _scons(folder: Path) -> None:
    """SCons from PyPI, as PlatformIO starts it."""
    source = Path(str(metadata.distribution("scons").locate_file("SCons")))
    _links(folder, [source])
    (folder / "scons.py").write_text("from SCons.Script import main\n\nmain()\n", "utf-8")


def _scons_version() -> str:
    """The installed SCons as the registry would number it: 4.11.1 is 4.41101.0.

    Raises UserError where it or PlatformIO is not there, or where it is not the one needed.
    """
    try:
        from platformio.dependencies import get_core_dependencies
        from semantic_version import SimpleSpec, Version

        version = metadata.version("scons")
    except ImportError as error:  # of which a missing distribution is one
        raise UserError(
            "cannot seed PlatformIO", f"not installed: {error.name}", _INSTALL
        ) from error
    major, minor, patch = (int(part) for part in version.split("."))
    numbered = f"{major}.{major}{minor:02}{patch:02}.0"
    needed = get_core_dependencies()["tool-scons"]
    if Version(numbered) not in SimpleSpec(needed):
        raise UserError(
            "cannot seed PlatformIO",
            f"it needs tool-scons {needed}, and SCons {version} is {numbered}",
            _INSTALL,
        )
    return numbered


def _platform() -> dict[str, Any]:
    def package(kind: str, version: str) -> dict[str, str]:
        return {"type": kind, "owner": OWNER, "version": version}

    return {
        "name": "atmelavr",
        "title": "Atmel AVR with Debian's tools",
        "version": PLATFORM_VERSION,
        "frameworks": {
            "arduino": {
                "package": "framework-arduino-avr",
                "script": "builder/frameworks/arduino.py",
            }
        },
        "packages": {
            "toolchain-atmelavr": package("toolchain", TOOLCHAIN_VERSION),
            "framework-arduino-avr": package("framework", FRAMEWORK_VERSION),
        },
    }


def _board(core: ArduinoCore) -> dict[str, Any]:
    return {
        "name": core.property("name"),
        "vendor": "Arduino",
        "url": "https://docs.arduino.cc/hardware/leonardo/",
        "frameworks": ["arduino"],
        "build": {
            key: core.property(f"build.{key}") for key in ("mcu", "f_cpu", "core", "variant")
        },
        "upload": {
            "maximum_size": int(core.property("upload.maximum_size")),
            "maximum_ram_size": int(core.property("upload.maximum_data_size")),
        },
    }


def _recipes(core: ArduinoCore) -> dict[str, Any]:
    """The core's own commands, cut into what SCons puts together again."""
    # C++ as the platform has it by itself: what else is needed, platformio.ini says.
    plain = {
        "includes": "",
        "source_file": "",
        "object_file": "",
        "compiler.path": "",
        "compiler.cpp.extra_flags": "-DDECIMAL_DIG=__DECIMAL_DIG__",
    }
    words = {name: core.command(f"{name}.o", plain) for name in ("c", "cpp", "S")}
    linking = {
        "compiler.path": "",
        "build.path": "",
        "build.project_name": "",
        "archive_file": "",
        "object_files": "",
    }
    link = core.command("c.combine", linking)
    defines = [word[2:].partition("=") for word in words["cpp"] if word.startswith("-D")]
    return {
        "tools": {
            "CC": words["c"][0],
            "CXX": words["cpp"][0],
            "LINK": link[0],
            "AR": core.property("compiler.ar.cmd"),
            "ARFLAGS": core.property("compiler.ar.flags"),
            "RANLIB": core.property("compiler.ar.cmd").replace("-ar", "-ranlib"),
            "OBJCOPY": core.property("compiler.elf2hex.cmd"),
            "SIZETOOL": core.property("compiler.size.cmd"),
        },
        **{name: _flags(found) for name, found in words.items()},
        "link": _flags(link),
        "hex": core.property("compiler.elf2hex.flags").split(),
        "size": {
            "flash": core.property("recipe.size.regex"),
            "ram": core.property("recipe.size.regex.data"),
        },
        "defines": [[name, value] for name, _, value in defines],
    }


def _flags(words: Sequence[str]) -> list[str]:
    """The flags of a command, but for those that SCons writes by itself."""
    ours = ("-c", "-o", "-MMD", "-lm")
    return [
        word
        for word in words[1:]
        if word and word not in ours and not word.startswith(("-D", "-L", "/"))
    ]


def _write(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1) + "\n", "utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Seed the folder that the command line names; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    try:
        seed(folder)
    except UserError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"build with: PLATFORMIO_CORE_DIR={folder.absolute()} pio run")
    return 0


if __name__ == "__main__":
    sys.exit(main())
