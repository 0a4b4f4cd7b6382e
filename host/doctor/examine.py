"""Every part of a robot at work for some seconds, judged, with the next step of each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from host.config import RobotConfig
from host.cross_checks.checks import DEVICE
from host.doctor import disk
from host.doctor.findings import Finding, Level, failed, of_health
from host.doctor.mountings import cameras_against_lidar
from host.doctor.spin import Spin
from host.doctor.tracked import own_body
from host.doctor.views import missing_returns
from host.doctor.watching import SECONDS, Watched, watch
from host.drivers.computer import COMPUTER, Computer
from host.drivers.natnet.client import MOCAP
from host.pipeline import LOCALIZER
from host.sources.rig import Rig

_FIRST = ("lidar", "board")


@dataclass(frozen=True, slots=True)
class Examined:
    """settings: what to change in robot.toml, by dotted key."""

    findings: list[Finding]
    settings: Mapping[str, bool]


def examine(
    rig: Rig,
    folder: Path,
    computer: Computer,
    seconds: float = SECONDS,
    progress: Callable[[float, float], None] = lambda at, whole: None,
    spin: Spin | None = None,
) -> Examined:
    """Findings of each part of the rig, and of the computer. folder: where recordings go.

    spin: drives the wheels once the rest is watched; None: they stand.
    """
    of_disk = disk.findings(folder)  # alone: nothing else is to wait for it
    watched = watch(rig, {COMPUTER: computer}, seconds, spin.run if spin else None, progress)
    found, settings = spin.findings(watched) if spin else ([], {})
    found = _sorted([*findings_of(watched, rig.config), *found])
    return Examined([*found, *_absent(rig), *of_disk], settings)


def findings_of(watched: Watched, config: RobotConfig) -> list[Finding]:
    """What was seen of devices that were watched, part by part."""
    found = [finding for health in watched.health.values() for finding in of_health(health)]
    found += [failed(part, error) for part, error in watched.failures.items()]
    found += own_body(watched, config.mocap.body)
    if watched.health.get("lidar") is not None and watched.health["lidar"].ok:
        found += missing_returns(watched.scans, config.lidar)
    if all(finding.part != DEVICE or finding.level == Level.OK for finding in found):
        found += cameras_against_lidar(watched, config)
    return found


def _sorted(found: list[Finding]) -> list[Finding]:
    """Parts in the order of the signal, of each the worst finding first.

    A computer that has no time for its devices comes first of all: it makes each of them look ill.
    """
    late = (COMPUTER, LOCALIZER)
    busy = any(finding.part in late and finding.level != Level.OK for finding in found)
    order = (*(late if busy else ()), *_FIRST, "front camera", "rear camera", "camera", MOCAP)

    def place(finding: Finding) -> tuple[int, str, int]:
        part = finding.part
        behind = len(order) + (part in late)
        return order.index(part) if part in order else behind, part, _worst(finding)

    return sorted(found, key=place)


def _worst(finding: Finding) -> int:
    return [Level.FAIL, Level.WARN, Level.OK].index(finding.level)


def _absent(rig: Rig) -> Sequence[Finding]:
    """Findings for devices that are not in robot.toml: not checked."""
    absent = []
    if not any("camera" in name for name in rig.sources):
        absent.append("cameras")
    if MOCAP not in rig.sources:
        absent.append(MOCAP)
    return [Finding(part, Level.OK, "not in robot.toml: not checked") for part in absent]
