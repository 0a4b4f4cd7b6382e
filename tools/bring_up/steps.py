"""The steps of a bring-up, each of which can be repeated alone and does nothing the second time."""

import getpass
import grp
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from typing import Any

from tools.bring_up import layout
from tools.bring_up.answers import Answers
from tools.bring_up.machine import Machine, StepError

UNCHANGED, DONE, SKIPPED = "as it was", "done", "left out"


def packages(machine: Machine, answers: Answers) -> str:
    """This system's packages that are missing."""
    wanted = list(layout.PACKAGES)
    if _is_arm32():
        wanted += [*layout.ARM32.values(), *layout.ARM32_BUILD]
    missing = [name for name in wanted if not _installed(name)]
    just = os.environ.get("BRINGUP_INSTALLED", "").split()  # by tools/bringup, before this began
    if just and not machine.dry:
        _note(machine, packages=sorted({*_noted(machine).get("packages", []), *just}))
    if not missing:
        return UNCHANGED
    if not answers.get("packages"):
        return SKIPPED
    quiet = {"DEBIAN_FRONTEND": "noninteractive"}
    machine.run(["apt-get", "update"], root=True)
    machine.run(
        ["apt-get", "install", "-y", "--no-install-recommends", *missing],
        root=True,
        environment=quiet,
    )
    _note(machine, packages=sorted({*_noted(machine).get("packages", []), *missing}))
    return DONE


def environment(machine: Machine, answers: Answers) -> str:
    """The program in an environment of its own, from this folder."""
    digest = layout.digest()
    prefix = machine.at(layout.PREFIX)
    if _noted(machine).get("installed") == digest and machine.at(layout.PROGRAM).exists():
        return UNCHANGED
    root = machine.guarded(prefix)
    if not (prefix / "bin/python").exists():
        site = ["--system-site-packages"] if _is_arm32() else []
        python = os.environ.get("BRINGUP_PYTHON", sys.executable)
        machine.run([python, "-m", "venv", *site, str(prefix)], root=root)
    pip = [str(prefix / "bin/python"), "-m", "pip", "install", "--disable-pip-version-check"]
    if _is_arm32():
        # Debian's numpy, scipy and OpenCV serve; pip does not know of them all.
        machine.run([*pip, *_other_requirements()], root=root)
        pip.append("--no-deps")
    machine.run([*pip, str(layout.SOURCE)], root=root)
    _link(machine, layout.COMMAND, layout.PROGRAM)
    _note(machine, installed=digest)
    return DONE


def rules(machine: Machine, answers: Answers) -> str:
    """Who may use the devices: udev rules, and the groups of this user."""
    machine.changed = False
    if not answers.get("rules"):
        return SKIPPED
    written = machine.write(layout.RULES, _swarmloc(machine, ["doctor", "--udev-rules"]))
    if written and machine.has("udevadm"):
        machine.run(["udevadm", "control", "--reload"], root=True)
        machine.run(["udevadm", "trigger"], root=True)
    user = os.environ.get("SUDO_USER") or getpass.getuser()
    joined = [group for group in layout.GROUPS if user != "root" and not _is_member(user, group)]
    for group in joined:
        machine.run(["usermod", "-aG", group, user], root=True)
    if joined:
        before = _noted(machine).get("joined", {})
        _note(machine, joined={**before, user: sorted({*before.get(user, []), *joined})})
        print(f"    log in again, so that {user} is in {' and '.join(joined)}")
    return DONE if machine.changed else UNCHANGED


def robot(machine: Machine, answers: Answers) -> str:
    """robot.toml: what was answered, and the devices that are plugged in, by their sockets."""
    place = machine.at(layout.ROBOT)
    before = place.read_text("utf-8") if place.exists() else None
    settings: dict[str, Any] = {**answers.settings}
    if before is None:
        settings |= {"name": answers.get("name"), "lidar.model": answers.get("lidar")}
        settings["mocap.source"] = answers.get("mocap")
        if settings["mocap.source"] != "none":
            settings["mocap.body"] = answers.get("body")
        if settings["mocap.source"] == "natnet":
            settings["mocap.natnet.server"] = answers.get("mocap_server")
        machine.run(["install", "-d", str(place.parent)], root=machine.guarded(place.parent))
    given = [word for key, value in settings.items() for word in ("--set", f"{key}={_toml(value)}")]
    command = [str(machine.at(layout.PROGRAM)), "init", str(place), "--find", *given]
    machine.run(command, root=machine.guarded(place))
    after = place.read_text("utf-8") if place.exists() else None
    return UNCHANGED if before == after and not machine.dry else DONE


def firmware(machine: Machine, answers: Answers) -> str:
    """The board's firmware: built, uploaded, read back."""
    if not answers.get("firmware"):
        return SKIPPED
    machine.run([str(machine.at(layout.PROGRAM)), "flash"], quiet=False)
    return DONE


def doctor(machine: Machine, answers: Answers) -> str:
    """Is every part alive?"""
    spin = ["--spin", "--yes"] if answers.get("spin") else []
    command = [str(machine.at(layout.PROGRAM)), "doctor", "--robot", str(machine.at(layout.ROBOT))]
    if machine.has("systemctl") and machine.at(layout.UNIT_FILE).exists():
        # The service holds the devices; the step `service` starts it again.
        machine.run(["systemctl", "stop", layout.UNIT], root=True)
    try:
        machine.run([*command, *spin], quiet=False, root=machine.guarded(machine.at(layout.ROBOT)))
    except StepError as error:
        raise StepError(
            "some parts do not work: do what the table says, then tools/bringup doctor"
        ) from error
    return DONE


def service(machine: Machine, answers: Answers) -> str:
    """The localizer at boot, restarted when it dies."""
    if not answers.get("service"):
        return SKIPPED
    machine.changed = False
    written = machine.write(layout.UNIT_FILE, layout.UNIT_TEXT)
    _link(machine, layout.UNIT_LINK, layout.UNIT_FILE)
    if not _systemd_runs(machine):
        print("    systemd does not run here: the service starts with the next boot")
        return DONE if machine.changed else UNCHANGED
    if written:
        machine.run(["systemctl", "daemon-reload"], root=True)
    machine.run(["systemctl", "start", "--no-block", layout.UNIT], root=True)
    return DONE if written else UNCHANGED


Step = Callable[[Machine, Answers], str]
STEPS: dict[str, Step] = {
    step.__name__: step for step in (packages, environment, rules, robot, firmware, doctor, service)
}


def remove(machine: Machine) -> str:
    """Undo what the steps did. robot.toml is kept beside, for it may hold a calibration."""
    machine.changed = False
    noted = _noted(machine)
    if _systemd_runs(machine) and machine.at(layout.UNIT_FILE).exists():
        machine.run(["systemctl", "stop", layout.UNIT], root=True)
    for path in (layout.UNIT_LINK, layout.UNIT_FILE, layout.RULES, layout.COMMAND):
        machine.remove(path)
    if _systemd_runs(machine) and machine.changed:
        machine.run(["systemctl", "daemon-reload"], root=True)
    for user, groups in noted.get("joined", {}).items():
        for group in groups:
            machine.run(["gpasswd", "-d", user, group], root=True)
    robot_file = machine.at(layout.ROBOT)
    if robot_file.exists():
        print(f"    {robot_file} stays: it holds your robot's settings; remove it by hand")
    machine.remove(layout.PREFIX)
    if noted.get("packages"):
        print("    packages stay; remove them by hand where nothing else needs them:")
        print(f"      sudo apt-get purge --autoremove {' '.join(noted['packages'])}")
    return DONE if machine.changed else UNCHANGED


def _link(machine: Machine, path: str, target: str) -> None:
    place = machine.at(path)
    if place.is_symlink() and os.readlink(place) == str(machine.at(target)):
        return
    root = machine.guarded(place.parent)
    machine.run(["install", "-d", str(place.parent)], root=root)
    machine.run(["ln", "-sfn", str(machine.at(target)), str(place)], root=root)


def _swarmloc(machine: Machine, arguments: list[str]) -> str:
    """What the installed program prints."""
    program = str(machine.at(layout.PROGRAM))
    if not os.path.exists(program):
        if machine.dry:
            return f"(what {program} {' '.join(arguments)} prints)\n"
        raise StepError(f"{program} is not there: run tools/bringup environment")
    done = subprocess.run([program, *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().rpartition("\n")[2] or "it did not say why"
        raise StepError(
            f"{program} {' '.join(arguments)} failed: {said}; run tools/bringup environment again"
        )
    return done.stdout


def _noted(machine: Machine) -> dict[str, Any]:
    """What earlier calls did."""
    try:
        found: dict[str, Any] = json.loads(machine.at(layout.STATE).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return found


def _note(machine: Machine, **news: Any) -> None:
    text = json.dumps({**_noted(machine), **news}, indent=1, sort_keys=True) + "\n"
    machine.write(layout.STATE, text)


def _is_arm32() -> bool:
    return os.uname().machine in ("armv7l", "armv6l")


def _installed(package: str) -> bool:
    try:
        done = subprocess.run(
            ["dpkg-query", "-W", "-f", "${Status}", package],
            check=False, capture_output=True, text=True,
        )  # fmt: skip
    except FileNotFoundError as error:
        raise StepError("this is no Debian: install what docs/bringup.md lists by hand") from error
    return done.stdout.endswith(" installed")


def _other_requirements() -> list[str]:
    """What Debian's packages do not bring on 32-bit ARM."""
    project = tomllib.loads((layout.SOURCE / "pyproject.toml").read_text("utf-8"))["project"]
    return [each for each in project["dependencies"] if each.partition(">")[0] not in layout.ARM32]


def _is_member(user: str, group: str) -> bool:
    try:
        return user in grp.getgrnam(group).gr_mem
    except KeyError:
        return True  # this system has no such group, and its devices no need of it


def _systemd_runs(machine: Machine) -> bool:
    return machine.destination is None and os.path.isdir("/run/systemd/system")


def _toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
