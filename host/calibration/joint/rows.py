"""The joint fit's values as rows of a report: those of the single fits, and the turrets'."""

import dataclasses

import numpy as np

from host.calibration.camera.calibrate import value_rows as camera_rows
from host.calibration.camera.model import camera_of
from host.calibration.joint.problem import Problem
from host.calibration.lidar.calibrate import value_rows as lidar_rows
from host.calibration.result import Fitted, Quantity
from host.calibration.wheels.verdict import value_rows as wheel_rows
from host.config import RobotConfig
from host.messages import FloatArray

_WRITTEN = "into [[mocap.turrets]], where it is known to 3 mm"


def rows_of(
    problem: Problem, values: FloatArray, covariance: FloatArray, config: RobotConfig
) -> tuple[Fitted, ...]:
    """Rows for the fitted values (p,) and their covariance (p, p), beside what is configured."""
    unknowns = problem.unknowns
    rows: list[Fitted] = []
    if problem.wheels is not None:
        part = unknowns.wheels
        wheels = dataclasses.replace(
            problem.wheels, values=values[part], covariance=covariance[part, part]
        )
        rows += wheel_rows(wheels, None, config.wheels, config.mocap)
    if "lidar" in problem.sensors:
        part = unknowns.lidar
        rows += lidar_rows(problem.configured[part], values[part], covariance[part, part], [])
    if problem.cameras is not None:
        part = unknowns.cameras
        own = values[part]
        cameras = dataclasses.replace(
            problem.cameras,
            values=own,
            covariance=covariance[part, part],
            cameras=(camera_of(own, 0, config.camera), camera_of(own, 1, config.camera)),
        )
        rows += camera_rows(config.camera, cameras, None, ())
    return (*rows, *_turret_rows(problem, values, covariance))


def _turret_rows(problem: Problem, values: FloatArray, covariance: FloatArray) -> list[Fitted]:
    sigmas = np.sqrt(np.diag(covariance))
    rows, place = [], problem.unknowns.turrets.start
    for number in problem.unknowns.teammates:
        for side in ("ahead", "to the left"):
            what = Quantity("", f"turret of body {number}, {side} of its pivot", "mm", _WRITTEN)
            rows.append(what.row(values[place], sigmas[place], problem.configured[place]))
            place += 1
    return rows
