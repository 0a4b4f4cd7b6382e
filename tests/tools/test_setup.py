"""tools/setup on machines that lack something: what is missing, and the exact line to paste."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WITHOUT_VENV = """#!/bin/sh
case "$*" in
*ensurepip*) exit 1 ;;
*venv*) echo python3.11-venv ;;
esac
"""


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder of programs that come first on the machine of a user who is not root."""
    folder = tmp_path / "programs"
    folder.mkdir()
    program(folder / "id", "#!/bin/sh\necho 1000\n")
    program(folder / "apt-get", "#!/bin/sh\necho apt-get was called >&2\n")
    return folder


def program(path: Path, text: str) -> Path:
    path.write_text(text)
    path.chmod(0o755)
    return path


def setup(programs: Path, folder: Path, python: Path) -> str:
    done = subprocess.run(
        [ROOT / "tools/setup", folder],
        env={"PATH": f"{programs}:/usr/bin:/bin", "PYTHON": str(python)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert "apt-get was called" not in done.stderr
    return done.stderr


def test_the_package_for_virtual_environments_is_named(programs: Path, tmp_path: Path) -> None:
    python = program(programs / "python", WITHOUT_VENV)
    said = setup(programs, tmp_path / "env", python)
    assert "cannot make virtual environments: python3.11-venv is not installed" in said
    assert "    sudo apt-get update && sudo apt-get install -y python3.11-venv\n" in said
    assert not (tmp_path / "env").exists()


def test_a_python_that_is_too_old_is_named(programs: Path, tmp_path: Path) -> None:
    text = '#!/bin/sh\n[ "$1" = --version ] && echo Python 3.9.2 || exit 1\n'
    said = setup(programs, tmp_path / "env", program(programs / "old", text))
    assert "needs Python 3.11 or newer; found: Python 3.9.2." in said
    assert "make PYTHON=/path/to/python3.11" in said


def test_a_folder_that_cannot_be_written_is_reported(programs: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    said = setup(programs, tmp_path / "file/env", program(programs / "python", "#!/bin/sh\n"))
    assert "file/env cannot be written" in said
    assert "make VENV=$HOME/swarmloc-env run" in said


PYTHON = """#!/bin/sh
[ "$2" = venv ] || exit 0
mkdir -p "$4/bin" && cp "$0" "$4/bin/python"
"""
BETTER = "v4l-utils gcc libc6-dev libsimavr-dev gcc-avr avr-libc arduino-core-avr"


@pytest.mark.parametrize(
    ("user", "apt_get", "said", "called"),
    [
        (1000, "exit 9", f"sudo apt-get update && sudo apt-get install -y {BETTER}\n", False),
        (0, "exit 0", f"installing {BETTER}\n", True),
        (0, "echo E: no network; exit 100", "without them it runs", True),
    ],
)
def test_packages_that_make_it_better_are_installed_by_root_or_named(
    programs: Path, tmp_path: Path, user: int, apt_get: str, said: str, called: bool
) -> None:
    program(programs / "id", f"#!/bin/sh\necho {user}\n")
    program(programs / "dpkg-query", "#!/bin/sh\nexit 1\n")
    calls = tmp_path / "calls"
    program(programs / "apt-get", f"#!/bin/sh\necho $* >>{calls}\n{apt_get}\n")
    done = subprocess.run(
        [ROOT / "tools/setup", tmp_path / "env"],
        env={
            "PATH": f"{programs}:/usr/bin:/bin",
            "PYTHON": str(program(programs / "python", PYTHON)),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert said in done.stderr
    assert calls.exists() == called
    if called and apt_get == "exit 0":
        install = f"install -y --no-install-recommends {BETTER}"
        assert calls.read_text().splitlines() == ["update", install]
    assert (tmp_path / "env" / "ready-run").exists()
