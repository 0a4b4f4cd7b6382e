"""How the sensors lie to each other, from all that was seen while the doctor watched."""

from host.config import RobotConfig
from host.cross_checks.cameras import LidarAgainstCameras
from host.cross_checks.checks import DEVICE
from host.doctor.findings import Finding, failed
from host.doctor.watching import Watched
from host.geometry import Path
from host.messages import Bearings, Scan


def cameras_against_lidar(watched: Watched, config: RobotConfig) -> list[Finding]:
    """Cameras that are exchanged or rotated, by strips and turrets of the teammates in view.

    The cross-checks of a run need a minute for it, of a robot that drives. This one takes every
    picture.
    """
    checks, path = LidarAgainstCameras(config, thinned=False), Path(keep_seconds=1e6)
    for step in watched.steps:
        path.append(step)
    if not watched.steps or not watched.bearings:
        return []
    messages: list[Scan | Bearings] = [*watched.scans, *watched.bearings]
    begin = watched.steps[0].time
    for message in sorted(messages, key=lambda message: message.time):
        if not begin <= message.time <= path.end:
            continue
        if isinstance(message, Scan):
            checks.take_scan(message, path)
        else:
            checks.take_bearings(message, path)
    fault = checks.rotated()
    return [] if fault is None else [failed(DEVICE, fault)]
