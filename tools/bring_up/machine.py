"""The computer that is brought up: commands that are printed and run, files that are written once.

Nothing but Python's own library: it runs before anything is installed.
"""

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path


class StepError(Exception):
    """A step that failed, as text: what, and what to do."""


class Machine:
    """dry: print, run nothing. destination: the folder that stands for / (DESTDIR), for tests."""

    def __init__(self, dry: bool = False, destination: Path | None = None) -> None:
        self.dry = dry
        self.destination = destination
        self.is_root = os.geteuid() == 0
        self.changed = False  # since it was last set to False

    def at(self, path: str | Path) -> Path:
        """Where a path of the system is."""
        if self.destination is None:
            return Path(path)
        return self.destination / str(path).lstrip("/")

    def run(
        self,
        command: Sequence[str],
        root: bool = False,
        environment: Mapping[str, str] | None = None,
        quiet: bool = True,
    ) -> None:
        """Run a command, by sudo where it needs root. Raises StepError where it fails."""
        sudo = root and not self.is_root
        full = [*(["sudo"] if sudo else []), *command]
        self.changed = True
        print(f"    $ {shlex.join(full)}", flush=True)
        if self.dry:
            return
        try:
            done = subprocess.run(
                full,
                check=False,
                env={**os.environ, **(environment or {})},
                stdin=subprocess.DEVNULL if quiet and not sudo else None,  # sudo may ask there
                stdout=subprocess.PIPE if quiet else None,
                stderr=subprocess.STDOUT if quiet else None,
                text=True,
            )
        except FileNotFoundError as error:
            raise StepError(f"{full[0]} is not installed: run tools/bringup packages") from error
        if done.returncode:
            said = "\n".join(f"      {line}" for line in (done.stdout or "").splitlines()[-8:])
            raise StepError(f"{shlex.join(full)} failed ({done.returncode})\n{said}".rstrip())

    def write(self, path: str, text: str, mode: str = "0644") -> bool:
        """Write a file of the system; False, and nothing done, where it says so already."""
        place = self.at(path)
        if _read(place) == text:
            return False
        with tempfile.NamedTemporaryFile("w", suffix=place.name) as file:
            file.write(text)
            file.flush()
            print(f"    {place}: {len(text.splitlines())} lines, from {file.name}")
            self.run(["install", "-D", "-m", mode, file.name, str(place)], root=self.guarded(place))
        return True

    def remove(self, path: str) -> bool:
        """Remove a file or a folder; False where there is none."""
        place = self.at(path)
        if not os.path.lexists(place):
            return False
        self.run(["rm", "-rf", str(place)], root=self.guarded(place))
        return True

    def guarded(self, place: Path) -> bool:
        """Does it take root to write there?"""
        there = next(path for path in (place, *place.parents) if path.exists())
        return not os.access(there if there.is_dir() else there.parent, os.W_OK)

    def has(self, program: str) -> bool:
        return shutil.which(program) is not None


def _read(path: Path) -> str | None:
    try:
        return path.read_text("utf-8")
    except OSError:
        return None
