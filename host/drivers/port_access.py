"""Why this user cannot open a port that is there: who holds it, or which group may use it."""

import grp
import os
import pwd
import stat
from pathlib import Path

from host.drivers.udev import PASTE

PROCESSES = Path("/proc")
_MODEM_MANAGER = "ModemManager"


def why_busy(path: str) -> tuple[str, str]:
    """Cause and next step of a port that another program has open."""
    name = holder(path)
    # The files of other users' programs are hidden, and ModemManager is root's.
    if name == _MODEM_MANAGER or (not name and _runs(_MODEM_MANAGER)):
        return "ModemManager takes it for a modem and holds it", PASTE
    if name:
        return f"{name} has it open", "close that program, then try again"
    return (
        "another program has it open, likely ModemManager or a second swarmloc",
        "close it (sudo fuser -v PORT names it; sudo systemctl stop ModemManager)",
    )


def why_forbidden(path: str) -> tuple[str, str]:
    """Cause and next step of a device that this user may not open."""
    why = "this user may not use it"
    try:
        found = os.stat(path)
        group = grp.getgrgid(found.st_gid).gr_name
    except (OSError, KeyError):  # it is gone meanwhile, or its group has no name
        return why, PASTE
    shared = stat.S_IRGRP | stat.S_IWGRP
    if found.st_mode & shared != shared or found.st_gid == 0:
        return f"{why}, and no group may", PASTE
    if _is_member(group):
        return f"{why}: it joined the group {group} after it logged in", "log in again"
    return (
        f"{why}: it is not in the group {group}",
        f"run: sudo usermod -aG {group} $USER    then log in again",
    )


def _is_member(group: str) -> bool:
    """Is this user in the group by the system's files, whatever it logged in with?"""
    try:
        user = pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    found = grp.getgrnam(group)
    return user.pw_name in found.gr_mem or user.pw_gid == found.gr_gid


def holder(path: str) -> str:
    """The name of the program that has the port open; "" where that cannot be seen."""
    port = os.path.realpath(path)
    for process in PROCESSES.glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        try:
            if any(os.path.realpath(link) == port for link in (process / "fd").iterdir()):
                return _name(process)
        except OSError:  # it has ended, or is another user's
            continue
    return ""


def _runs(program: str) -> bool:
    return any(_name(process) == program for process in PROCESSES.glob("[0-9]*"))


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text("utf-8", "replace").strip()
    except OSError:  # it has ended
        return ""
