"""PlatformIO: whether it can build here, and a build with it."""

import os
import shutil
import sys
import urllib.error
import urllib.request
from pathlib import Path

from host.errors import UserError
from host.flashing.firmware import PROJECT, Firmware, files_in, measured, run_tool, written
from host.folders import build_folder

REGISTRY = "https://api.registry.platformio.org/v3/packages/platformio/platform/atmelavr"
REGISTRY_PATIENCE_S = 3.0
_ENVIRONMENT = "leonardo"  # of platformio.ini
_NAME = "firmware"  # as PlatformIO calls what it builds
_PLATFORM_PARTS = (
    "platforms/atmelavr",
    "packages/toolchain-atmelavr",
    "packages/framework-arduino-avr",
    "packages/tool-scons",
)


def build_with_platformio(project: Path = PROJECT, workspace: Path | None = None) -> Firmware:
    """Build with PlatformIO, which downloads what its folder (PLATFORMIO_CORE_DIR) lacks.

    project: a folder with a platformio.ini. workspace: for what is built; None: one in
    build_folder(). Raises UserError if PlatformIO is not installed or the build fails.
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
    # PlatformIO refuses a project folder that cannot be written, as an installed one.
    copy = workspace / "project"
    with written(workspace):
        _copy(project, copy)
    run_tool([pio, "run", "--project-dir", str(copy), "--environment", _ENVIRONMENT], environment)
    version = run_tool([pio, "--version"]).split()[-1]
    return measured(workspace / "build" / _ENVIRONMENT / f"{_NAME}.elf", f"PlatformIO {version}")


def find_platformio() -> str | None:
    """The command `pio`: that of this Python's environment, else the one on PATH."""
    beside = Path(sys.executable).with_name("pio")
    return str(beside) if beside.exists() else shutil.which("pio")


def platformio_folder() -> Path:
    """Where PlatformIO keeps what it has downloaded."""
    return Path(os.environ.get("PLATFORMIO_CORE_DIR") or os.path.expanduser("~/.platformio"))


def platformio_obstacle() -> str:
    """Why PlatformIO cannot build on this computer now; "" if it can."""
    if find_platformio() is None:
        return "PlatformIO is not installed"
    folder = platformio_folder().absolute()
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not os.access(there, os.W_OK | os.X_OK):
        return f"PlatformIO cannot write its folder {folder}"
    if not (_has_platform() or _registry_answers()):
        return "PlatformIO's registry does not answer"
    return ""


def _copy(project: Path, copy: Path) -> None:
    """Copy the files of a project again, without what was built in it."""
    shutil.rmtree(copy, ignore_errors=True)
    for file in files_in(project):
        part = file.relative_to(project)
        if not any(name.startswith(".") for name in part.parts):
            (copy / part).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy / part)


def _has_platform() -> bool:
    """Whether PlatformIO has all it needs in its folder."""
    return all((platformio_folder() / part).is_dir() for part in _PLATFORM_PARTS)


def _registry_answers() -> bool:
    try:
        with urllib.request.urlopen(REGISTRY, timeout=REGISTRY_PATIENCE_S):
            return True
    except urllib.error.HTTPError:
        return True  # whatever it says, it is there
    except OSError:
        return False
