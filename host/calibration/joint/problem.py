"""What was gathered → the joint fit's sensors, what is known beforehand, and where it starts."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.fit import CameraFit, CameraProblem
from host.calibration.camera.model import NAMES
from host.calibration.camera.pairs import Captured, strips_of
from host.calibration.chain import BODY as BODY_KEYS
from host.calibration.gathered import Gathered, Tracks
from host.calibration.joint.sensors import CameraEvidence, LidarEvidence, Sensor, WheelEvidence
from host.calibration.joint.unknowns import Unknowns
from host.calibration.lidar.search import find_turrets
from host.calibration.robust.evidence import Prior
from host.calibration.wheels.calibrate import usable
from host.calibration.wheels.drives import drives_of
from host.calibration.wheels.fit import Fit, WheelProblem, fit
from host.calibration.wheels.model import BODY, Drive, values_of
from host.errors import UserError
from host.messages import FloatArray

_TURRET_M = 0.01  # std of a turret beside its body's pivot, per axis


@dataclass(slots=True)
class Problem:
    """A joint fit.

    sensors: by name. start (p,): the single fits' values, found again from those configured.
    configured (p,). drives: of the wheels. wheels, cameras: those single fits, None where the
    sensor is left out.
    """

    unknowns: Unknowns
    prior: Prior
    configured: FloatArray
    start: FloatArray
    drives: list[Drive]
    sensors: dict[str, Sensor]
    wheels: Fit | None = None
    cameras: CameraFit | None = None


def problem_of(gathered: Gathered, names: Collection[str]) -> Problem:
    """The joint fit of the sensors `names`: of "wheels", "lidar" and "camera".

    Raises UserError where there is no motion capture of this robot and a teammate, or a sensor has
    no readings that fit what is configured.
    """
    tracks = gathered.tracks_of_teammates()
    drives = usable(drives_of(gathered))[0] if "wheels" in names else []
    unknowns = Unknowns(6 + 2 * len(drives), tracks.identities.tolist())
    problem = _without_sensors(gathered, unknowns, drives)
    if "wheels" in names:
        _add_wheels(problem, gathered)
    if "lidar" in names:
        problem.prior.free[unknowns.lidar] = True
        seen = find_turrets(gathered.scans, gathered.config.lidar)
        problem.sensors["lidar"] = LidarEvidence(unknowns, tracks, seen)
    if "camera" in names:
        _add_cameras(problem, gathered, tracks)
    return problem


def _without_sensors(gathered: Gathered, unknowns: Unknowns, drives: list[Drive]) -> Problem:
    """What is known without any: turrets lie near pivots; the body as earlier fits have it."""
    config, size = gathered.config, len(unknowns)
    configured, information, free = np.zeros(size), np.zeros((size, size)), np.zeros(size, bool)
    lidar = config.lidar
    configured[unknowns.wheels] = values_of(config.wheels, config.mocap, len(drives))
    configured[unknowns.lidar][:4] = lidar.x_m, lidar.y_m, lidar.heading_rad, lidar.delay_s
    information[unknowns.turrets, unknowns.turrets] = np.eye(2 * len(unknowns.teammates))
    information[unknowns.turrets, unknowns.turrets] *= _TURRET_M**-2.0
    free[unknowns.turrets] = True
    body = gathered.chain.covariance(config, BODY_KEYS)
    if body.any() and not drives:
        information[BODY, BODY] = np.linalg.inv(body)
        free[BODY] = True
    prior = Prior(configured.copy(), information, free)
    # Where earlier fits have found turrets; the hold on them is to their pivots.
    known = {turret.body: (turret.x_m, turret.y_m) for turret in config.mocap.turrets}
    places = [known.get(body, (0.0, 0.0)) for body in unknowns.teammates]
    configured[unknowns.turrets] = np.ravel(places)
    return Problem(unknowns, prior, configured, configured.copy(), drives, {})


def _add_wheels(problem: Problem, gathered: Gathered) -> None:
    counts, part = gathered.config.wheels.counts_per_turn, problem.unknowns.wheels
    nominal = problem.configured[part]
    found = fit(problem.drives, counts, nominal, nominal)
    if found is None:
        raise UserError(
            "the wheels cannot be fitted together with the other sensors",
            "there are hardly any windows of two seconds in which the robot moved",
            "drive it for a minute in view of motion capture",
        )
    wheels = WheelProblem(problem.drives, counts, found.windows, nominal)
    problem.prior.information[part, part] = np.diag(wheels.held)
    problem.prior.free[part] = True
    problem.start[part] = found.values
    problem.wheels = found
    problem.sensors["wheels"] = WheelEvidence(problem.unknowns, problem.drives, found, wheels)


def _add_cameras(problem: Problem, gathered: Gathered, tracks: Tracks) -> None:
    cameras = CameraProblem(strips_of(gathered), Captured(tracks), gathered.config.camera, {})
    found = cameras.near(cameras.mean)
    if not any(found.fitted):
        raise UserError(
            "the cameras cannot be fitted together with the other sensors",
            "hardly any strip is where a teammate is, by the cameras as they are configured",
            "calibrate the cameras by themselves first",
        )
    part = problem.unknowns.cameras
    problem.configured[part] = problem.prior.mean[part] = cameras.mean
    problem.prior.information[part, part] = np.diag(cameras.spread**-2.0)
    problem.prior.free[part] = np.append(np.repeat(found.fitted, len(NAMES)), True)
    problem.start[part] = found.values
    problem.cameras = found
    problem.sensors["camera"] = CameraEvidence(problem.unknowns, tracks, cameras, found)
