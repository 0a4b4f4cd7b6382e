"""Where the lidar sees nothing, against robot.toml's blind sectors."""

import math
from collections.abc import Sequence

import numpy as np

from host.calibration.detection.blind_sectors import FoundSector, find_sectors, same_sector
from host.config import Lidar
from host.doctor.findings import Finding, Level
from host.drivers.x4.device import LIDAR
from host.geometry import wrap
from host.messages import Scan

_FEWEST_SCANS = 40
_SEEN = 0.5  # of the usual returns, for a sector not to be blind
_ROBOT_M = 0.25  # a return from nearer is on the robot itself


def missing_returns(scans: Sequence[Scan], lidar: Lidar) -> list[Finding]:
    """The share of samples without a return, and blind sectors that are not what robot.toml says.

    A robot that stands sees only where its room lets it: an empty sector is a pillar of its own
    only where returns come from all sides of it.
    """
    if len(scans) < _FEWEST_SCANS:
        return []
    ranges = np.concatenate([scan.ranges for scan in scans])
    missing = float(np.mean(ranges <= 0.0))
    found = [Finding(LIDAR, Level.OK, f"{100 * missing:.0f} % of its samples have no return")]
    return found + [_transparent(sector) for sector in _seen_through(scans, lidar)]


def _seen_through(scans: Sequence[Scan], lidar: Lidar) -> list[tuple[float, float]]:
    """Configured blind sectors (centre, width; rad) through which the lidar sees the room."""
    angles = np.concatenate([scan.angles for scan in scans])
    ranges = np.concatenate([scan.ranges for scan in scans])
    far = ranges > max(lidar.min_range_m, _ROBOT_M)
    bearing = wrap(angles + lidar.heading_rad)
    seen = []
    for blind in lidar.blind_sectors:
        inside = np.abs(wrap(bearing - blind.centre_rad)) < 0.4 * blind.width_rad
        usual = np.count_nonzero(far) / math.tau * 0.8 * blind.width_rad
        if np.count_nonzero(inside & far) > _SEEN * usual:
            seen.append((blind.centre_rad, blind.width_rad))
    return seen


def _transparent(sector: tuple[float, float]) -> Finding:
    centre, width = (round(math.degrees(angle)) for angle in sector)
    return Finding(
        LIDAR,
        Level.WARN,
        f"it sees through the blind sector at {centre} deg ({width} deg wide) of robot.toml",
        "remove that block [[lidar.blind_sectors]], or measure them: swarmloc calibrate detection",
    )


def hidden(scans: Sequence[Scan], lidar: Lidar) -> list[Finding]:
    """Sectors that stay empty while the robot rotates, and that robot.toml does not name.

    scans: of at least half a rotation, so that nothing in the room stays in one direction.
    """
    known = [FoundSector(blind.centre_rad, blind.width_rad) for blind in lidar.blind_sectors]
    return [
        Finding(
            LIDAR,
            Level.WARN,
            f"something on the robot hides {math.degrees(sector.width):.0f} deg of its view at "
            f"{math.degrees(sector.centre):.0f} deg, which robot.toml does not know",
            "clean the window there; a part of the robot belongs into blind_sectors: "
            "swarmloc calibrate detection",
        )
        for sector in find_sectors(scans, lidar)
        if same_sector(sector, known) is None
    ]
