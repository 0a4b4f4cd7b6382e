"""How far off its axis a lens is known, and what bearings beyond are worth.

Where strips were seen the fit holds. Beyond, a lens is what its polynomial makes of it, which two
halves of one drive continue differently.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.bearing_errors import (
    bearing_errors,
    bearing_sigmas,
    in_picture,
    points_around,
)
from host.calibration.camera.fit import CameraFit
from host.calibration.camera.model import draw, row_of
from host.config import Cameras
from host.messages import FloatArray
from host.perception.lens import View

_REACH_PERCENT = 99.0  # of the strips are nearer to the axis
_BEARINGS_DEG = 3.0  # from one bearing that is looked at to the next
_LEAST_BEYOND = math.radians(5.0)  # less hardly shows how errors grow
_MOST_NOISE_PER_RAD = 10.0  # that robot.toml may have


@dataclass(frozen=True, slots=True)
class Reach:
    """Of one camera's lens.

    angle (rad): how far off the axis strips (or corners of a checkerboard) were seen.
    beyond_noise_per_rad: std of a bearing from beyond, in rad for each rad² beyond `angle`.
    """

    angle: float
    beyond_noise_per_rad: float


def reach_of(
    fit: CameraFit,
    number: int,
    halves: tuple[CameraFit, CameraFit] | None,
    cameras: Cameras,
    board_rad: float = 0.0,
) -> Reach:
    """The reach of the lens of camera `number`; halves: of the fit.

    board_rad: how far off the axis its lens is known by a checkerboard. A bearing's error is what
    the halves show, half their difference, and no less than what the fit's covariance predicts.
    """
    camera, row = fit.cameras[number], row_of(fit.values, number)
    mine = fit.used & (fit.pairs.strips.cameras == number)
    seen = draw(row, fit.pairs.at(fit.delay)[mine])[1]
    angle = max(float(np.percentile(seen, _REACH_PERCENT)), board_rad)
    around = np.radians(np.arange(-180.0, 180.0, _BEARINGS_DEG))
    points = points_around(around, cameras.strip.height_m).reshape(-1, 3)
    pixels = View(camera).pixels_of(points)
    shown = in_picture(camera, pixels)
    points, pixels = points[shown], pixels[shown]
    angles = draw(row, points)[1]
    sigmas = bearing_sigmas(fit, number, points, pixels)
    if halves is not None:
        first, second = (bearing_errors(half.cameras[number], points, pixels) for half in halves)
        apart = np.abs(np.nan_to_num(first - second, nan=math.inf))
        sigmas = np.maximum(sigmas, 0.5 * apart)
    known = np.isfinite(sigmas)
    return Reach(angle, _growth(angles[known] - angle, sigmas[known]))


def _growth(beyond: FloatArray, sigmas: FloatArray) -> float:
    """Rad of sigma for each rad² beyond the reach, so that all variances have the same mean."""
    far = beyond > 0.0
    if not far.any():
        return 0.0
    beyond = np.maximum(beyond[far], _LEAST_BEYOND)
    growth = math.sqrt(float(np.mean(sigmas[far] ** 2) / np.mean(beyond**4)))
    return min(growth, _MOST_NOISE_PER_RAD)
