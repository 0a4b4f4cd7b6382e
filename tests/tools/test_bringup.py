"""tools/bringup with this system's large commands stood in for: what it runs, writes and undoes."""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tools.bring_up import command, layout, remote, simulated, steps
from tools.bring_up.answers import Answers
from tools.bring_up.machine import Machine, StepError

ROOT = Path(__file__).resolve().parents[2]
BRINGUP = ROOT / "tools/bringup"
ANSWERS = """\
name = "robot7"
lidar = "x4pro"
mocap = "natnet"
mocap_server = "10.0.0.5"
body = 3
firmware = false

[settings]
"wheels.track_m" = 0.15
"""
# Each notes how it was called. The environment's pip "installs" a program that runs this checkout.
STAND_INS = {
    "dpkg-query": 'case "$*" in *avrdude*) printf "not-installed";; *) printf " installed";; esac',
    "apt-get": "",
    "usermod": "",
    "gpasswd": "",
    "udevadm": "",
    "python3": """
case "$*" in
"-m venv"*) mkdir -p "$3/bin"; cp HERE/environment-python "$3/bin/python" ;;
*) exec PYTHON "$@" ;;
esac""",
    "environment-python": 'cp HERE/environment-swarmloc "${0%python}swarmloc"',
    "environment-swarmloc": """
cd CHECKOUT
case "$*" in
*--udev-rules) exec PYTHON -c 'from host.drivers.udev import RULES; print(RULES, end="")' ;;
esac
exec PYTHON -c "from host.cli.main import main; main()" "$@\"""",
}


class Computer:
    """A folder for /, and a folder of stand-ins ahead on PATH."""

    def __init__(self, folder: Path) -> None:
        self.root, self.answers = folder / "root", folder / "answers.toml"
        self.calls, programs = folder / "calls", folder / "programs"
        programs.mkdir()
        self.root.mkdir()
        self.answers.write_text(ANSWERS)
        for name, body in STAND_INS.items():
            text = body.replace("PYTHON", sys.executable).replace("HERE", str(programs))
            text = text.replace("CHECKOUT", str(ROOT))
            program = programs / name
            program.write_text(f'#!/bin/sh\necho "{name} $*" >> {self.calls}\n{text}\n')
            program.chmod(0o755)
        self._environment = {
            **os.environ,
            "DESTDIR": str(self.root),
            "PATH": f"{programs}:{os.environ['PATH']}",
            "PYTHON": str(programs / "python3"),
            "PYTHONPATH": str(ROOT),
            "SUDO_USER": "robot-user",
        }

    def bring_up(self, *arguments: str) -> tuple[int, dict[str, str], str]:
        """Exit code, results and all that was written."""
        self.calls.write_text("")
        done = subprocess.run(
            [BRINGUP, *arguments],
            env=self._environment, capture_output=True, text=True, check=False, timeout=100,
        )  # fmt: skip
        last = done.stdout.rstrip().rpartition("\n")[2]
        found = json.loads(last.removeprefix("RESULT ")) if last.startswith("RESULT") else {}
        return done.returncode, found, done.stdout + done.stderr

    def files(self) -> dict[str, str]:
        """What is under /, by path."""
        paths = sorted(path for path in self.root.rglob("*") if not path.is_dir())
        return {
            str(path.relative_to(self.root)): os.readlink(path)
            if path.is_symlink()
            else path.read_text("utf-8")
            for path in paths
        }


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


STEPS = ("packages", "environment", "rules", "robot", "firmware", "service")


def test_it_writes_what_it_says_does_nothing_twice_and_undoes_it(computer: Computer) -> None:
    code, results, said = computer.bring_up(*STEPS, "--answers", str(computer.answers))
    assert code == 0, said
    assert results == {**dict.fromkeys(STEPS, "done"), "firmware": "left out"}
    files = computer.files()
    assert set(files) == {
        "etc/swarmloc/robot.toml",
        "etc/systemd/system/multi-user.target.wants/swarmloc.service",
        "etc/systemd/system/swarmloc.service",
        "etc/udev/rules.d/60-swarmloc.rules",
        "opt/swarmloc/bin/python",
        "opt/swarmloc/bin/swarmloc",
        "opt/swarmloc/bringup.json",
        "usr/local/bin/swarmloc",
    }
    assert 'GROUP="dialout", MODE="0660"' in files["etc/udev/rules.d/60-swarmloc.rules"]
    robot = files["etc/swarmloc/robot.toml"]
    for line in ('name = "robot7"', 'model = "x4pro"', 'source = "natnet"', "body = 3"):
        assert line in robot
    assert 'server = "10.0.0.5"' in robot
    assert "track_m = 0.15 " in robot
    calls = computer.calls.read_text()
    assert "apt-get install -y --no-install-recommends avrdude" in calls
    assert "usermod -aG dialout robot-user" in calls

    _, again, said = computer.bring_up(*STEPS, "--answers", str(computer.answers))
    unchanged = {**dict.fromkeys(STEPS, "as it was"), "firmware": "left out"}
    # The stand-ins do not remember who joined a group, and what was installed.
    assert {**again, "packages": "as it was", "rules": "as it was"} == unchanged, said
    assert computer.files() == files

    code, results, said = computer.bring_up("--remove")
    assert (code, results) == (0, {"remove": "done"})
    assert set(computer.files()) == {"etc/swarmloc/robot.toml"}
    assert "robot.toml stays" in said
    assert "apt-get purge --autoremove avrdude" in said
    assert "gpasswd -d robot-user dialout" in computer.calls.read_text()
    assert computer.bring_up("--remove")[1] == {"remove": "as it was"}


def test_a_dry_run_prints_every_step_and_does_nothing(computer: Computer) -> None:
    code, results, said = computer.bring_up("--dry-run")
    assert code == 0
    assert len(results) == 7
    for words in (
        "apt-get install -y",
        "-m venv",
        "-m pip install",
        "60-swarmloc.rules",
        "swarmloc init",
        "swarmloc flash",
        "swarmloc doctor",
        "swarmloc.service",
    ):
        assert words in said
    assert computer.files() == {}
    assert "apt-get" not in computer.calls.read_text()


def test_a_step_that_fails_is_named_and_the_exit_code_says_so(computer: Computer) -> None:
    code, results, said = computer.bring_up("rules", "--yes")
    assert code == 1
    assert results["rules"].startswith("FAILED")
    assert "run tools/bringup environment" in said
    assert computer.bring_up("lunch")[0] == 2
    computer.answers.write_text("nmae = 'x'\n")
    code, _, said = computer.bring_up("robot", "--answers", str(computer.answers))
    assert code == 1
    assert "unknown answers: nmae" in said


def test_a_program_that_fails_is_a_failed_step_and_says_why(tmp_path: Path) -> None:
    machine = Machine(destination=tmp_path)
    program = machine.at(layout.PROGRAM)
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\necho Traceback >&2\necho no module numpy >&2\nexit 1\n")
    program.chmod(0o755)
    with pytest.raises(StepError, match=r"--udev-rules failed: no module numpy; run tools/bringup"):
        steps.rules(machine, Answers({"rules": True}, silent=True))


def test_without_ssh_other_robots_cannot_be_brought_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(StepError, match="ssh is not installed"):
        remote.bring_up_others(["robot1"], argparse.Namespace())


def test_several_robots_over_ssh(
    computer: Computer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ssh stands for a shell here, in a home of its own for each robot; one cannot be reached."""
    ssh = tmp_path / "programs/ssh"
    ssh.write_text(
        "#!/bin/sh\n"
        'while [ "$1" = -o ]; do shift 2; done\n'
        '[ "$1" = robot3 ] && { echo "ssh: no route to robot3" >&2; exit 255; }\n'
        f'home={tmp_path}/homes/$1; mkdir -p "$home"; cd "$home"; shift; exec sh -c "$*"\n'
    )
    ssh.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    code, _, said = computer.bring_up(
        "robot", "service", "--dry-run", "--answers", str(computer.answers),
        "--on", "robot1,robot2,robot3",
    )  # fmt: skip
    assert code == 1
    for name in ("robot1", "robot2"):
        assert f"{name}  robot: done; service: done" in said
        assert (tmp_path / f"homes/{name}/swarmloc-bringup/tools/bringup").exists()
    assert "robot3  copy: FAILED: see bringup-logs/robot3.log" in said
    assert "no route to robot3" in (tmp_path / "bringup-logs/robot3.log").read_text()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_systemd_takes_the_unit(computer: Computer) -> None:
    code, _, said = computer.bring_up("environment", "service", "--yes")
    assert code == 0, said
    # A root of its own: the program has to be there under the path that the unit names.
    with tempfile.TemporaryDirectory() as root:
        for name in ("opt/swarmloc/bin/swarmloc", "etc/systemd/system/swarmloc.service"):
            place = Path(root) / name
            place.parent.mkdir(parents=True)
            shutil.copy(computer.root / name, place)
        for unit in ("sysinit", "basic", "shutdown", "multi-user", "network-online"):
            target = Path(root) / f"etc/systemd/system/{unit}.target"
            target.write_text(f"[Unit]\nDescription={unit}\n")
        done = subprocess.run(
            ["systemd-analyze", "verify", f"--root={root}", "swarmloc.service"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


SERVICE = """\
import os, socket, sys, time
manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
manager.connect(os.environ["NOTIFY_SOCKET"])
manager.send(b"WATCHDOG=1\\nSTATUS=lidar: starting")
if sys.argv[3] == "dies":
    sys.exit(3)
manager.send(b"WATCHDOG=1\\nSTATUS=healthy: 7 updates/s\\nREADY=1")
time.sleep(60.0)
"""


@pytest.mark.parametrize(
    ("scenario", "code", "says"),
    [("arena4", 0, "the service is healthy: 7 updates/s"), ("dies", 1, "the service ended with 3")],
)
def test_a_simulated_service_is_waited_for(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    scenario: str,
    code: int,
    says: str,
) -> None:
    program = tmp_path / ".venv/bin/swarmloc"
    program.parent.mkdir(parents=True)
    program.write_text(f"#!{sys.executable}\n{SERVICE}")
    program.chmod(0o755)
    setup = tmp_path / "tools/setup"
    setup.parent.mkdir()
    setup.write_text("#!/bin/sh\n")
    setup.chmod(0o755)
    monkeypatch.setattr(simulated, "SOURCE", tmp_path)
    assert command.main(["--simulate", scenario, "--seconds", "0.2"]) == code
    out, err = capfd.readouterr()
    assert says in out + err
