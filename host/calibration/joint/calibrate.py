"""Wheels, tracked body, lidar, cameras and their delays together, with what they share.

Lidar and cameras look at the same turrets, which motion capture has at the pivots of the teammates'
bodies. A pivot that is not above its turret moves both sensors' mountings, and neither fit by
itself looks for it. Here each turret has a place of its own in the frame of its body.
"""

from collections.abc import Collection, Mapping
from typing import Any, Literal

import numpy as np

from host.calibration.camera.model import NAMES
from host.calibration.camera.pairs import CAMERAS
from host.calibration.camera.uncertainty import unseen
from host.calibration.chain import LIDAR
from host.calibration.gathered import Gathered
from host.calibration.joint.fit import Solution, solve
from host.calibration.joint.pictures import pictures
from host.calibration.joint.problem import Problem, problem_of
from host.calibration.joint.rows import rows_of
from host.calibration.joint.verdict import moved, verdict
from host.calibration.lidar.calibrate import UNSEEN
from host.calibration.result import Calibration
from host.calibration.wheels.model import LAGS
from host.calibration.wheels.verdict import KEYS, coverage, other_paths
from host.config import RobotConfig
from host.messages import FloatArray

SensorName = Literal["wheels", "lidar", "camera"]
SENSORS: tuple[SensorName, ...] = ("wheels", "lidar", "camera")
_KNOWN_M = 0.003  # sigma of a turret's place that is written


def calibrate(
    gathered: Gathered,
    sensors: Collection[SensorName] = SENSORS,
    lidar_start: Mapping[str, float] | None = None,
) -> Calibration:
    """Refine what the fits of `sensors` have written, all of it together.

    The configuration is theirs: there this fit begins. lidar_start: values of a lidar's fit that
    is not written, by key. Raises UserError where there is no motion capture of this robot and a
    teammate, or a sensor has no readings that fit what is configured.
    """
    problem = problem_of(gathered, sensors)
    places = keys_of(problem)
    for key, value in (lidar_start or {}).items():
        if key.startswith("lidar."):
            problem.start[places[key]] = value
    solution = solve(list(problem.sensors.values()), problem.prior, problem.start)
    covariance = complete(solution.covariance, solution.values, problem, gathered)
    rows = rows_of(problem, solution.values, covariance, gathered.config)
    at = list(places.values())
    return Calibration(
        kind="joint",
        fitted=rows,
        checks=verdict(problem, solution),
        residuals=f"{', '.join(problem.sensors)} together, {_turrets_in_words(problem, solution)}",
        warnings=moved(rows, gathered),
        pictures=pictures(problem, solution),
        joint=(tuple(places), covariance[np.ix_(at, at)]),
        settings=settings_of(problem, solution.values, covariance, gathered.config),
        figures={"sensors": list(problem.sensors), "last_step_sigmas": solution.last_step},
    )


def _turrets_in_words(problem: Problem, solution: Solution) -> str:
    places = solution.values[problem.unknowns.turrets].reshape(-1, 2)
    return f"turrets up to {1e3 * np.hypot(*places.T).max():.1f} mm beside their bodies' pivots"


def keys_of(problem: Problem) -> dict[str, int]:
    """Keys of robot.toml that are fitted, and where each is among the unknowns."""
    lidar, cameras = problem.unknowns.lidar.start, problem.unknowns.cameras
    # Without wheels the body's pose is free as far as earlier fits left it, but not found again.
    places = {key: k for k, key in enumerate(KEYS)} if problem.wheels is not None else {}
    places |= {key: lidar + k for k, key in enumerate((*LIDAR, "lidar.delay_s"))}
    places |= {
        f"camera.{camera}.{name}": cameras.start + len(NAMES) * number + k
        for number, camera in enumerate(CAMERAS)
        for k, name in enumerate(NAMES)
    }
    places["camera.delay_s"] = cameras.stop - 1
    return {key: place for key, place in places.items() if problem.prior.free[place]}


def settings_of(
    problem: Problem, values: FloatArray, covariance: FloatArray, config: RobotConfig
) -> dict[str, Any]:
    """What is written besides the rows: the lenses' model, and turrets that the drive shows.

    Those of other bodies stay as in `config`.
    """
    fitted = problem.cameras.fitted if problem.cameras else (False, False)
    lenses = {
        f"camera.{name}.lens": "equidistant"
        for name, enough in zip(CAMERAS, fitted, strict=True)
        if enough
    }
    part = problem.unknowns.turrets
    places = values[part].reshape(-1, 2).tolist()
    sigmas = np.sqrt(np.diag(covariance)[part]).reshape(-1, 2).max(axis=1)
    turrets = {turret.body: turret.model_dump() for turret in config.mocap.turrets} | {
        body: {"body": body, "x_m": x, "y_m": y}
        for body, (x, y), sigma in zip(problem.unknowns.teammates, places, sigmas, strict=True)
        if sigma <= _KNOWN_M
    }
    return {**lenses, "mocap.turrets": list(turrets.values())}


def complete(
    covariance: FloatArray, values: FloatArray, problem: Problem, gathered: Gathered
) -> FloatArray:
    """The covariance (p, p) with what repeating this drive does not show, as in the single fits.

    When the truth was stamped is common to all delays.
    """
    unknowns, wider = problem.unknowns, covariance.copy()
    late = np.zeros(len(unknowns))
    if problem.wheels is not None:
        driven = coverage(problem.drives, gathered.config.wheels.track_m)
        wider[:3, :3] += other_paths(values, driven)
        late[unknowns.wheels][LAGS] = 1.0
    if "lidar" in problem.sensors:
        wider[unknowns.lidar, unknowns.lidar] += UNSEEN
        late[unknowns.lidar][3] = 1.0
    if problem.cameras is not None:
        part = unknowns.cameras
        wider[part, part] += unseen(values[part], problem.prior.free[part])
        late[part][-1] = 1.0
    return np.asarray(wider + gathered.truth_time_sigma**2 * np.outer(late, late))
