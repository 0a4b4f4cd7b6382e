"""What every build has: the project, what came out of it, and tools that are run for it."""

import contextlib
import os
import re
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from host.errors import UserError
from host.flashing import elf
from host.folders import data_folder

PROJECT = data_folder() / "firmware/romeo_odometry"
FLASH_BYTES = 28672  # what the bootloader leaves of the ATmega32U4's 32 KiB
RAM_BYTES = 2560
# In a line of the compiler or the linker that says what is wrong with the sources, and of others.
_MISTAKE = re.compile(
    r"error: (?!ld returned)|undefined reference|multiple definition|within region"
)
_FAILURE = re.compile(r"Error: ")


@dataclass(frozen=True, slots=True)
class Firmware:
    """Built firmware. flash_bytes, ram_bytes: what it takes (of RAM: without the stack).

    built_with: the tool and its version, as text.
    """

    elf: Path
    hex: Path
    flash_bytes: int
    ram_bytes: int
    built_with: str


def measured(built: Path, built_with: str) -> Firmware:
    """The firmware in an ELF that has its .hex beside it. Raises UserError if it is too large.

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


def files_in(folder: Path) -> list[Path]:
    """All files below the folder, sorted."""
    return sorted(path for path in folder.rglob("*") if path.is_file())


@contextlib.contextmanager
def written(folder: Path, what: str = "the firmware") -> Iterator[None]:
    """What is built is written below this folder. Raises UserError where it cannot be."""
    try:
        yield
    except OSError as error:
        raise UserError(
            f"cannot build {what}",
            f"{folder}: {error.strerror or error}",
            "check that folder, and the free space on its disk",
        ) from error


def run_tool(command: Sequence[str], environment: Mapping[str, str] | None = None) -> str:
    """The command's standard output. Raises UserError with the reason it gave if it failed."""
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "LC_ALL": "C", **(environment or {})},
    )
    if done.returncode == 0:
        return done.stdout
    lines = (done.stderr or done.stdout).strip().splitlines()
    mistakes = [line for line in lines if _MISTAKE.search(line)]
    failures = [line for line in lines if _FAILURE.search(line)] or lines[-1:]
    raise UserError(
        f"cannot build the firmware: {Path(command[0]).name} failed",
        "\n".join((mistakes or failures or ["it did not say why"])[:3]),
        "correct the sources it names and build again" if mistakes else "",
    )
