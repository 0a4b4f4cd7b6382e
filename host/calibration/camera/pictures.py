"""What there is to see of a calibration of the cameras."""

import math
from collections.abc import Mapping

import numpy as np

from host.calibration.camera.bearing_errors import (
    SECTOR_DEG,
    BearingSector,
    bearing_errors,
    bearings_of,
    in_picture,
)
from host.calibration.camera.fit import CameraFit
from host.calibration.camera.model import equidistant
from host.calibration.camera.pairs import CAMERAS
from host.calibration.camera.reach import Reach
from host.calibration.gathered import Gathered
from host.calibration.result import ReportPicture, Role, Series, thinned
from host.calibration.robust.time_offset import DelayCurve
from host.config import Camera
from host.messages import BoolArray, FloatArray
from host.perception.lens import Lens

_BEARING = "bearing in the robot frame, deg (left is positive)"


def pictures(
    gathered: Gathered,
    fit: CameraFit,
    table: Mapping[int, list[BearingSector]],
    curve: DelayCurve,
    reaches: Mapping[int, Reach],
) -> tuple[ReportPicture, ...]:
    """Coverage, what is left of the errors, the delay's curve, and before and after."""
    bearings = np.degrees(bearings_of(fit))
    points = fit.pairs.at(fit.delay)
    ranges = np.hypot(points[:, 0], points[:, 1])
    after, before = _errors_deg(gathered, fit)
    shown = fit.used & np.isfinite(after)
    return (
        *(_in_picture(fit, number, reaches.get(number)) for number in table),
        ReportPicture(
            title="Where teammates were",
            x_label=_BEARING,
            y_label="range, m",
            series=_by_camera(fit, shown, bearings, ranges),
            caption="Views should be all around, near and far.",
        ),
        _sigmas(table),
        _by_angle(reaches),
        ReportPicture(
            title="Errors of bearings by bearing",
            x_label=_BEARING,
            y_label="error, deg",
            series=_by_camera(fit, shown, bearings, after),
            caption="Good is a band about 0; waves mean a lens that the model does not know.",
        ),
        ReportPicture(
            title="Errors of bearings by range",
            x_label="range, m",
            y_label="error, deg",
            series=_by_camera(fit, shown, ranges, after),
            caption="Good is a band about 0 at any range.",
        ),
        ReportPicture(
            title="The delay",
            x_label="delay, ms",
            y_label="share of strips not explained",
            series=(
                Series(
                    x=1000.0 * (gathered.config.camera.delay_s + curve.delays),
                    y=curve.costs,
                    role="fitted",
                    style="line",
                ),
            ),
            caption="Good is one narrow valley; in a flat one the delay is not observable.",
        ),
        ReportPicture(
            title="Before and after",
            x_label=_BEARING,
            y_label="error, deg",
            series=(
                _points("before", bearings, before, shown & np.isfinite(before), "before"),
                _points("fitted", bearings, after, shown, "fitted"),
            ),
        ),
    )


def _sigmas(table: Mapping[int, list[BearingSector]]) -> ReportPicture:
    return ReportPicture(
        title="How well bearings are known",
        x_label=_BEARING,
        y_label="sigma, deg",
        series=tuple(
            Series(
                x=np.array([s.first_deg + 0.5 * SECTOR_DEG for s in found]),
                y=np.array([math.degrees(s.sigma_rad) for s in found]),
                label=f"{CAMERAS[number]} camera",
                role=CAMERAS[number],
                style="bars",
            )
            for number, found in table.items()
        ),
        caption="Predicted for each sector, with or without views in it.",
    )


def _by_angle(reaches: Mapping[int, Reach]) -> ReportPicture:
    series = []
    for number, reach in reaches.items():
        beyond = np.linspace(reach.angle, max(float(reach.angles.max()), reach.angle), 20)
        name = CAMERAS[number]
        series += [
            thinned(
                np.degrees(reach.angles), np.degrees(reach.sigmas), f"{name} camera", role=name
            ),
            Series(
                x=np.degrees(beyond),
                y=np.degrees(reach.beyond_noise_per_rad * (beyond - reach.angle) ** 2),
                label=f"{name}, beyond its reach",
                role=name,
                style="line",
            ),
        ]
    return ReportPicture(
        title="How far off its axis a lens is known",
        x_label="angle off the axis, deg",
        y_label="sigma of a bearing, deg",
        series=tuple(series),
        caption="A line begins where the strips end: so much is added to what bearings beyond are "
        "off. Bring teammates to the borders of the picture to have it begin farther out.",
    )


def _errors_deg(gathered: Gathered, fit: CameraFit) -> tuple[FloatArray, FloatArray]:
    """Errors (n,) deg of all pairs' bearings as fitted, and as they were configured."""
    strips = fit.pairs.strips
    after, before = np.full(len(fit.used), math.nan), np.full(len(fit.used), math.nan)
    for number, camera in enumerate(fit.cameras):
        mine = strips.cameras == number
        old = equidistant(getattr(gathered.config.camera, CAMERAS[number]))
        after[mine] = bearing_errors(camera, fit.pairs.at(fit.delay)[mine], strips.pixels[mine])
        before[mine] = bearing_errors(old, fit.pairs.at(0.0)[mine], strips.pixels[mine])
    return np.degrees(after), np.degrees(before)


def _in_picture(fit: CameraFit, number: int, reach: Reach | None) -> ReportPicture:
    mine = fit.pairs.strips.cameras == number
    x, y = fit.pairs.strips.pixels.T
    camera = fit.cameras[number]
    up = camera.height_px - y
    circle = [] if reach is None else [_circle(camera, reach)]
    return ReportPicture(
        title=f"Strips in the picture of the {CAMERAS[number]} camera",
        x_label="x, px",
        y_label="above the lower border, px",
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
    return Series(
        x=np.where(in_picture(camera, np.column_stack((x, y))), x, math.nan),
        y=camera.height_px - y,
        label=f"{math.degrees(reach.angle):.0f} deg off the axis",
        role="fitted",
        style="line",
    )


def _by_camera(
    fit: CameraFit, shown: BoolArray, x: FloatArray, y: FloatArray
) -> tuple[Series, ...]:
    cameras = fit.pairs.strips.cameras
    return tuple(
        _points(f"{name} camera", x, y, shown & (cameras == number), name)
        for number, name in enumerate(CAMERAS)
        if fit.fitted[number]
    )


def _points(label: str, x: FloatArray, y: FloatArray, chosen: BoolArray, role: Role) -> Series:
    return thinned(x[chosen], y[chosen], label, role)
