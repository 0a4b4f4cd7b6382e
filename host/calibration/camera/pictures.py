"""What there is to see of a calibration of the cameras."""

import math
from collections.abc import Mapping

import numpy as np

from host.calibration.camera.bearing_errors import (
    SECTOR_DEG,
    BearingSector,
    bearings_of,
    in_picture,
    pair_errors,
)
from host.calibration.camera.fit import CameraFit
from host.calibration.camera.model import equidistant
from host.calibration.camera.pairs import CAMERAS
from host.calibration.camera.reach import Reach
from host.calibration.result import ReportPicture, Role, Series, thinned
from host.config import Camera, Cameras
from host.messages import BoolArray, FloatArray
from host.perception.lens import Lens

_BEARING = "bearing in the robot frame, deg (left is positive)"


def pictures(
    cameras: Cameras,
    fit: CameraFit,
    table: Mapping[int, list[BearingSector]],
    reaches: Mapping[int, Reach],
) -> tuple[ReportPicture, ...]:
    """Where strips were, how well bearings are known, and errors before and after.

    cameras: as configured.
    """
    bearings = np.degrees(bearings_of(fit))
    ranges = np.hypot(*fit.pairs.at(fit.delay)[:, :2].T)
    configured = [equidistant(getattr(cameras, name)) for name in CAMERAS]
    after = np.degrees(pair_errors(fit, fit.cameras, fit.delay))
    before = np.degrees(pair_errors(fit, configured, 0.0))
    shown = fit.used & np.isfinite(after)
    taken_by = fit.pairs.strips.cameras
    return (
        *(_in_picture(fit, number, reaches.get(number)) for number in table),
        _sigmas(table),
        ReportPicture(
            title="Errors of bearings by range",
            axes=("range, m", "error, deg"),
            series=tuple(
                _points(f"{name} camera", ranges, after, shown & (taken_by == number), name)
                for number, name in enumerate(CAMERAS)
                if fit.fitted[number]
            ),
            caption="Good is a band about 0 at any range.",
        ),
        ReportPicture(
            title="Errors of bearings by bearing",
            axes=(_BEARING, "error, deg"),
            series=(
                _points("before", bearings, before, shown & np.isfinite(before), "before"),
                _points("fitted", bearings, after, shown, "fitted"),
            ),
            caption="Good is a band about 0; waves mean a lens that the model does not know.",
        ),
    )


def _sigmas(table: Mapping[int, list[BearingSector]]) -> ReportPicture:
    return ReportPicture(
        title="How well bearings are known",
        axes=(_BEARING, "sigma, deg"),
        series=tuple(
            Series(
                np.array([s.first_deg + 0.5 * SECTOR_DEG for s in found]),
                np.array([math.degrees(s.sigma_rad) for s in found]),
                f"{CAMERAS[number]} camera",
                CAMERAS[number],
                "bars",
            )
            for number, found in table.items()
        ),
        caption="Predicted for each sector, with or without views in it.",
    )


def _in_picture(fit: CameraFit, number: int, reach: Reach | None) -> ReportPicture:
    mine = fit.pairs.strips.cameras == number
    x, y = fit.pairs.strips.pixels.T
    camera = fit.cameras[number]
    up = camera.height_px - y
    circle = [] if reach is None else [_circle(camera, reach)]
    return ReportPicture(
        title=f"Strips in the picture of the {CAMERAS[number]} camera",
        axes=("x, px", "above the lower border, px"),
        series=(
            _points("used", x, up, mine & fit.used, "measured"),
            _points("not where a teammate was", x, up, mine & ~fit.used, "refused"),
            *circle,
        ),
        caption="The lens is known within the line.",
        equal=True,
    )


def _circle(camera: Camera, reach: Reach) -> Series:
    """As far off the axis as the lens is known, within the picture."""
    around = np.linspace(0.0, math.tau, 361)
    radius = float(Lens(camera).radius(np.array([reach.angle]))[0])
    x = camera.centre_x_px + radius * np.cos(around)
    y = camera.centre_y_px + radius * np.sin(around)
    x = np.where(in_picture(camera, np.column_stack((x, y))), x, math.nan)
    label = f"{math.degrees(reach.angle):.0f} deg off the axis"
    return Series(x, camera.height_px - y, label, "fitted", "line")


def _points(label: str, x: FloatArray, y: FloatArray, chosen: BoolArray, role: Role) -> Series:
    return thinned(x[chosen], y[chosen], label, role)
