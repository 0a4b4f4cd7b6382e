"""Installed from its wheel, or run from a checkout that cannot be written, by an ordinary user."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from host.flashing.build import require_avr_gcc
from host.simulation.devices import romeo_library
from tests.toolchain import needed

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = Path(sysconfig.get_path("purelib"))
NOBODY = 65534
LONG_S = 300.0  # a bound on waiting, not on speed
pytestmark = pytest.mark.slow


@dataclass
class User:
    """One who is not root: another user where the tests run as root.

    folder: where everything of this user is. packages: where the interpreter finds dependencies.
    """

    folder: Path
    python: Path
    path: list[Path] = field(default_factory=list)

    def run(self, *command: object, folder: Path) -> subprocess.CompletedProcess[str]:
        as_nobody = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
        return subprocess.run(
            [str(word) for word in command],
            cwd=folder,
            env={
                "PATH": "/usr/bin:/bin",
                "HOME": str(self.folder / "home"),
                "PYTHONPATH": os.pathsep.join(map(str, self.path)),
            },
            **(as_nobody if os.getuid() == 0 else {}),
            capture_output=True,
            text=True,
            timeout=LONG_S,
            check=False,
        )

    def own_folder(self, name: str) -> Path:
        folder = self.folder / name
        folder.mkdir()
        if os.getuid() == 0:
            os.chown(folder, NOBODY, NOBODY)
        return folder


@pytest.fixture
def user() -> Iterator[User]:
    """With a fresh environment, which has this one's dependencies and no swarmloc."""
    with tempfile.TemporaryDirectory(prefix="swarmloc-user-") as name:
        folder = Path(name)  # not tmp_path, whose parents are closed to other users
        folder.chmod(0o755)
        made = User(folder, folder / "env/bin/python")
        made.own_folder("home")
        interpreter = usable_python(made)
        run("-m", "venv", "--without-pip", folder / "env", python=interpreter)
        (site,) = (folder / "env").glob("lib/python*/site-packages")
        (site / "dependencies.pth").write_text(f"{PACKAGES}\n")
        done = made.run(made.python, "-c", "import numpy, cv2", folder=folder / "home")
        if done.returncode:
            pytest.skip(f"another user cannot use this environment's packages: {done.stderr}")
        yield made
        for path in folder.rglob("*"):
            if path.is_dir() and not path.is_symlink():
                path.chmod(0o755)


def usable_python(user: User) -> Path:
    """An interpreter of this version that another user may start, too."""
    name = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    for candidate in (Path(sys.executable).resolve(), Path("/usr/bin") / name):
        try:
            user.run(candidate, "-c", "import venv", folder=Path("/")).check_returncode()
        except (OSError, subprocess.CalledProcessError):
            continue
        return candidate
    pytest.skip(f"no {name} that a user who is not root may start")


def run(*arguments: object, python: Path = Path(sys.executable)) -> None:
    subprocess.run([str(python), *map(str, arguments)], check=True, capture_output=True)


def board() -> str:
    """What a simulated run should say of its board on this machine."""
    needed(require_avr_gcc)
    needed(romeo_library.load)
    return "board: the firmware, built with avr-gcc"


def use(user: User, command: list[object]) -> None:
    """From an empty folder: configure, build, simulate."""
    folder = user.own_folder("empty")

    def swarmloc(*arguments: str) -> str:
        done = user.run(*command, *arguments, folder=folder)
        assert (done.returncode, done.stderr) == (0, ""), done.stdout
        return done.stdout

    swarmloc("init")
    built = swarmloc("flash", "--build-only")
    assert f"ELF    {user.folder}/home/.cache/swarmloc/avr-gcc-" in built
    shown = swarmloc("run", "--simulate", "arena4", "--robot", "robot.toml", "--seconds", "3")
    assert board() in shown
    assert sorted(path.name for path in folder.iterdir()) == ["robot.toml"]


def test_the_wheel_works_in_an_empty_folder(user: User) -> None:
    board()
    build = ("-m", "pip", "--disable-pip-version-check", "wheel", "--no-deps")
    run(*build, "--no-build-isolation", "--wheel-dir", user.folder / "wheel", ROOT)
    (wheel,) = (user.folder / "wheel").iterdir()
    run("-m", "pip", "--python", user.python, "install", "--no-deps", wheel)
    code = (
        "import swarmloc; print(swarmloc.__file__);"
        "print(len(swarmloc.simulate('arena4:seconds=1').truths))"
    )
    where, truths = user.run(user.python, "-c", code, folder=user.folder).stdout.split()
    assert where.startswith(f"{user.folder}/env/lib/")
    assert int(truths) > 10
    use(user, [user.folder / "env/bin/swarmloc"])


def test_a_checkout_that_cannot_be_written_works(user: User) -> None:
    board()
    checkout = user.folder / "checkout"
    for room in ("host", "swarmloc", "firmware", "robots"):
        shutil.copytree(ROOT / room, checkout / room, ignore=shutil.ignore_patterns("__pycache__"))
    for path in (checkout, *checkout.rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    user.path.append(checkout)
    use(user, [user.python, "-c", "from host.cli.main import main; main()"])
