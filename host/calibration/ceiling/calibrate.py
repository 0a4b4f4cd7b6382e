"""The ceiling camera: lens and mounting from tags that it saw, its delay by the wheels."""

import math

import numpy as np

from host.calibration.ceiling.fit import LENS, CeilingFit, CeilingProblem
from host.calibration.gathered import Gathered
from host.calibration.result import (
    Calibration,
    Check,
    Fitted,
    Quantity,
    ReportPicture,
    at_least,
    at_most,
    thinned,
)
from host.calibration.stamps import delay_check
from host.calibration.wheels import calibrate as wheels
from host.calibration.wheels.drives import drives_of
from host.calibration.wheels.verdict import KEYS, LAG
from host.config import Ceiling
from host.errors import UserError
from host.messages import BoolArray, FloatArray

_LEAST_TAGS, _LEAST_A_PART, _LEAST_PARTS = 60, 3, 8
_PARTS = 3  # of the picture, a side
_LARGEST_RMS_PX, _PLACE_LIMIT_M, _DELAY_LIMIT_S = 0.6, 0.005, 0.01
_SHOWN = (
    ("focal_px", "focal length", "px"),
    ("centre_x_px", "centre x", "px"),
    ("centre_y_px", "centre y", "px"),
    ("k1", "k1", ""),
    ("k2", "k2", ""),
    ("z_m", "height above the floor", "mm"),
    ("", "rotated about the floor's x-axis", "deg"),
    ("", "rotated about the floor's y-axis", "deg"),
)
_ANGLES = ("heading_rad", "tilt_rad", "roll_rad")
_TOGETHER = "judged together, by what places on the floor are off"
_HELD = "held, as the checkerboard has it"


def calibrate_view(corners: FloatArray, ceiling: Ceiling, lens_known: bool = False) -> Calibration:
    """Fit lens and mounting to the corners (n, 4, 2) px of tags, in order of time.

    lens_known: that of `ceiling` is held. Raises UserError where there are too few tags for a fit.
    """
    if len(corners) < _LEAST_A_PART * _LEAST_PARTS:
        raise UserError(
            "the ceiling camera cannot be fitted",
            f"{len(corners)} tags were seen",
            "drive a robot with a tag through all of the view; check dictionary in [mocap.ceiling]",
        )
    problem = CeilingProblem(corners, ceiling, lens_known)
    fit = problem.fit()
    first = np.arange(len(corners)) < len(corners) // 2
    halves = problem.part(first).fit(), problem.part(~first).fit()
    eye = {f"mocap.ceiling.eye.{k}": getattr(fit.ceiling.eye, k) for k in (*_ANGLES, *LENS)}
    return Calibration(
        kind="ceiling",
        fitted=_rows(problem, fit, halves, lens_known),
        checks=_checks(problem, fit),
        residuals=f"rms {fit.rms_px:.2f} px over the corners of {int(fit.used.sum())} tags, "
        f"{100.0 * np.mean(fit.used):.0f} % of them used",
        pictures=_pictures(problem, fit),
        settings=eye | {"mocap.ceiling.eye.lens": "equidistant"},
        figures={"rms_px": fit.rms_px, "tags": len(corners), "tags_used": int(fit.used.sum())},
    )


def calibrate_delay(gathered: Gathered) -> Calibration:
    """Fit the camera's delay to a drive: ticks are hardly late, so that their lag shows it.

    Raises UserError as the fit of the wheels does, or where the truth is not of the ceiling camera.
    """
    mocap = gathered.config.mocap
    if mocap.source != "ceiling":
        raise UserError(
            "the delay of the ceiling camera cannot be fitted",
            f'source is "{mocap.source}" in [mocap] of robot.toml',
            'write source = "ceiling" there, and record a drive under that camera',
        )
    known = gathered.chain.covariance(gathered.config, KEYS[:3])
    found = wheels.calibrate(drives_of(gathered), gathered.config.wheels, mocap, known)
    (lag,) = (row for row in found.fitted if row.name == LAG)
    delay = mocap.ceiling.delay_s - lag.value
    what = Quantity("mocap.ceiling.delay_s", "delay of the ceiling camera", "ms", _DELAY_LIMIT_S)
    return Calibration(
        kind="ceiling",
        fitted=(what.row(max(delay, 0.0), lag.sigma, mocap.ceiling.delay_s),),
        checks=(*found.checks, delay_check(what.name, delay, lag.sigma)),
        residuals=found.residuals,
        pictures=found.pictures,
        warnings=found.warnings,
    )


def _rows(
    problem: CeilingProblem, fit: CeilingFit, halves: tuple[CeilingFit, CeilingFit], held: bool
) -> tuple[Fitted, ...]:
    rows = []
    before = problem.ceiling.eye
    for k, (key, name, unit) in enumerate(_SHOWN):
        fixed = held and k < len(LENS)
        written = "mocap.ceiling.eye.z_m" if key == "z_m" else ""
        rows.append(
            Quantity(written, name, unit, _HELD if fixed else _TOGETHER).row(
                fit.values[k],
                math.nan if fixed else math.sqrt(fit.covariance[k, k]),
                getattr(before, key) if key else None,
                () if fixed else [half.values[k] for half in halves],
            )
        )
    return tuple(rows)


def _checks(problem: CeilingProblem, fit: CeilingFit) -> tuple[Check, ...]:
    eye = fit.ceiling.eye
    part = np.floor(_middles(problem, fit.used) / (eye.width_px, eye.height_px) * _PARTS)
    _, counts = np.unique(part, axis=0, return_counts=True)
    sigmas = problem.place_sigmas(fit)
    return (
        at_least("tags used", int(fit.used.sum()), _LEAST_TAGS).otherwise(
            "take more pictures of tags"
        ),
        at_least(
            "parts of the picture with tags",
            int(np.count_nonzero(counts >= _LEAST_A_PART)),
            _LEAST_PARTS,
            f"of {_PARTS**2}",
        ).otherwise("drive a tag through all of the view, its corners, too"),
        at_most("error of tag corners", fit.rms_px, _LARGEST_RMS_PX, "px rms").otherwise(
            "tags of the given size do not explain the pictures: check tag_m, that tags are flat "
            "and level, and that pictures are sharp"
        ),
        at_most(
            "sigma of a position on the floor, worst in the picture",
            float(np.max(sigmas)) if len(sigmas) else math.inf,
            _PLACE_LIMIT_M,
            "mm",
        ).otherwise(
            "take more pictures, with tags towards the corners of the picture; a larger tag makes "
            "the scale surer"
        ),
    )


def _middles(problem: CeilingProblem, chosen: BoolArray) -> FloatArray:
    return np.asarray(problem.corners[chosen].mean(axis=1))


def _pictures(problem: CeilingProblem, fit: CeilingFit) -> tuple[ReportPicture, ...]:
    eye = fit.ceiling.eye
    (x_used, y_used), (x_other, y_other) = (
        _middles(problem, chosen).T for chosen in (fit.used, ~fit.used)
    )
    before = np.hypot(*np.moveaxis(problem.errors(problem.start), -1, 0)).max(axis=1)
    after = np.hypot(*np.moveaxis(fit.errors, -1, 0)).max(axis=1)
    aside = np.hypot(*(_middles(problem, fit.used) - [eye.centre_x_px, eye.centre_y_px]).T)
    return (
        ReportPicture(
            title="Tags in the picture",
            axes=("x, px", "above the lower border, px"),
            series=(
                thinned(x_used, eye.height_px - y_used, "used", "measured"),
                thinned(x_other, eye.height_px - y_other, "not as a tag looks", "refused"),
            ),
            caption="Good is all over the picture, into its corners.",
            equal=True,
        ),
        ReportPicture(
            title="Corners of tags, by distance from the middle",
            axes=("distance from the middle of the picture, px", "worst corner of a tag, px off"),
            series=(
                thinned(aside, before[fit.used], "before", "before"),
                thinned(aside, after[fit.used], "fitted", "fitted"),
            ),
            caption="Good is level and low; what climbs outwards is a lens that is not known.",
        ),
    )
