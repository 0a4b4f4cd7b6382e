"""A recording or a scenario through a calibration: without screen, report or robot.toml."""

from collections.abc import Callable
from typing import Literal

from host.calibration.camera import calibrate as camera
from host.calibration.detection import calibrate as detection
from host.calibration.gathered import Gathered
from host.calibration.joint import calibrate as joint
from host.calibration.lidar import calibrate as lidar
from host.calibration.result import Calibration
from host.calibration.wheels import calibrate as wheels
from host.calibration.wheels.drives import drives_of, wheels_advice
from host.config import RobotConfig
from host.errors import UserError
from host.sessions.calibrating.gathering import gather_source
from host.sessions.recordings.truth_files import TruthFile

CalibrationKind = Literal["wheels", "lidar", "camera", "joint", "detection"]


def calibrate_from(
    kind: CalibrationKind,
    source: str,
    robot: RobotConfig | None = None,
    truth: TruthFile | None = None,
) -> Calibration:
    """Fit a part of the robot's configuration to what a recording, or a scenario, holds.

    robot: what is known so far; a recording is read as if taken with it. None: the recording's
    own, or the default. truth: in place of the recording's own. Raises UserError where the source
    cannot be read or has nothing to fit; a fit that should not be used is returned, with its
    `failures`.
    """
    if kind not in _FITS:
        raise UserError(f"there is no calibration of {kind!r}", f"known: {', '.join(_FITS)}")
    return calibrate_gathered(kind, gather_source(source, robot, truth=truth))


def calibrate_gathered(kind: CalibrationKind, gathered: Gathered) -> Calibration:
    """The same fit of what was gathered already."""
    return _FITS[kind](gathered)


def lacking(kind: CalibrationKind, gathered: Gathered) -> str:
    """Which readings a kind of fit needs and there are none of, as text; "" where it has them."""
    if kind == "wheels":
        return "" if any(step.ticks for step in gathered.displacements) else "wheel ticks"
    if kind == "joint":
        return "" if _sensors(gathered) else "readings of wheels, lidar or cameras"
    if kind == "camera":
        return "" if any(b.pixels is not None for b in gathered.bearings) else "strips in pictures"
    return "" if gathered.scans else "revolutions of a lidar"


def drive_advice(gathered: Gathered) -> list[str]:
    """What a drive still lacks for the fits of wheels, lidar and cameras, where there are any."""
    missing = [*wheels_advice(gathered), *lidar.lidar_advice(gathered)]
    return missing if lacking("camera", gathered) else missing + camera.camera_advice(gathered)


def _wheels(gathered: Gathered) -> Calibration:
    config = gathered.config
    return wheels.calibrate(drives_of(gathered), config.wheels, config.mocap)


def _sensors(gathered: Gathered) -> list[joint.SensorName]:
    return [name for name in joint.SENSORS if not lacking(name, gathered)]


def _joint(gathered: Gathered) -> Calibration:
    return joint.calibrate(gathered, _sensors(gathered))


_FITS: dict[CalibrationKind, Callable[[Gathered], Calibration]] = {
    "wheels": _wheels,
    "lidar": lidar.calibrate,
    "camera": camera.calibrate,
    "joint": _joint,
    "detection": detection.calibrate,
}
