"""What a calibration of the wheels is worth: how odometry ends on drives the fit has not seen."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from host.calibration.result import Calibration
from host.calibration.wheels.fit import lags_of
from host.calibration.wheels.model import (
    Drive,
    at,
    body_path,
    compose,
    relative,
    values_of,
)
from host.config import Mocap, Wheels
from host.errors import UserError


def end_error(
    drive: Drive, wheels: Wheels, mocap: Mocap, lags: tuple[float, float] = (0.0, 0.0)
) -> float:
    """How far (m) odometry from the first true pose on is from truth at the last one.

    lags: by how much (s) the stamps of the ticks are late at the drive's start and end.
    """
    first, last = drive.span
    ends = np.searchsorted(drive.truth_times, (first, np.nextafter(last, math.inf))) - (0, 1)
    poses = body_path(drive, wheels.counts_per_turn, values_of(wheels, mocap))
    reached = at(drive, poses, np.array(lags), drive.truth_times[ends])
    start, end = drive.truth[ends][:1], drive.truth[ends][1:]
    by_wheels = compose(start, relative(reached[:1], reached[1:])[0])
    return float(np.hypot(*(by_wheels - end)[0, :2]))


def score_unseen(
    name: str,
    drives: Sequence[Drive],
    nominal: tuple[Wheels, Mocap],
    fitted: tuple[Wheels, Mocap],
) -> dict[str, Any]:
    """How well odometry ends on drives that the fit has not seen, before and after.

    nominal, fitted: what was configured, and what it is with the fit in it (`apply_fit`). Means
    over the drives, and each of them under "runs". By how much the clocks of a drive differ is the
    recording's affair, not the wheels': it is found from the headings by the fitted geometry and
    used for both. It matters only where the robot moves at an end of the drive. Raises UserError
    for a drive without ticks and a true path at the same time.
    """
    runs = []
    for drive in drives:
        if drive.span == (0.0, 0.0):
            raise UserError(
                f"{name} cannot be scored",
                "its ticks and its true path are never known at the same time",
                "name a run that was recorded with motion capture in view of the robot",
            )
        wheels, mocap = fitted
        start, end = lags_of(drive, wheels.counts_per_turn, values_of(wheels, mocap)).tolist()
        runs.append(
            {
                "name": drive.name,
                "nominal_end_error_m": end_error(drive, *nominal, (start, end)),
                "fitted_end_error_m": end_error(drive, *fitted, (start, end)),
            }
        )
    errors = "nominal_end_error_m", "fitted_end_error_m"
    means = {key: float(np.mean([run[key] for run in runs])) for key in errors}
    return {"source": name, **means, "runs": runs}


def apply_fit(calibration: Calibration, wheels: Wheels, mocap: Mocap) -> tuple[Wheels, Mocap]:
    """The configuration with what was fitted in it."""
    new = [(*key.split("."), value) for key, value in calibration.new_settings().items()]
    both = {
        name: {key: value for at, key, value in new if at == name} for name in ("wheels", "mocap")
    }
    return wheels.model_copy(update=both["wheels"]), mocap.model_copy(update=both["mocap"])
