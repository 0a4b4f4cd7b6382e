"""Lens, mounting and delay of the cameras, from strips of teammates whose true place is known."""

import dataclasses
import math
from collections.abc import Collection, Mapping

import numpy as np

from host.calibration.camera.bearing_errors import (
    SECTOR_DEG,
    BearingSector,
    pair_errors,
    sectors_of,
    sectors_without_views,
    shown_sectors,
)
from host.calibration.camera.checkerboard import LensFit
from host.calibration.camera.fit import CameraFit, CameraProblem
from host.calibration.camera.model import LENS_NAMES, NAMES
from host.calibration.camera.pairs import CAMERAS, Captured, reference_of, strips_of
from host.calibration.camera.pictures import pictures
from host.calibration.camera.reach import Reach, reach_of
from host.calibration.camera.verdict import Halves, verdict
from host.calibration.chain import BODY, LIDAR, by_base, carried
from host.calibration.coverage import missing_rotations
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration, Fitted, Quantity
from host.calibration.robust.statistics import normal_sigma
from host.calibration.stamps import rounding_warnings, stamps_check
from host.config import Camera, Cameras
from host.errors import UserError
from host.geometry import wrap
from host.messages import FloatArray

_LEAST_NOISE_RAD = 0.001
_ENOUGH_STRIPS, _ENOUGH_ROTATION_RAD = 200, 1.5  # to drive on for; the rotation each way
_NEAR_M, _FAR_M = 0.8, 1.5
_LABELS = {
    "focal_px": ("focal length", "px"),
    "centre_x_px": ("centre x", "px"),
    "centre_y_px": ("centre y", "px"),
    "k1": ("k1", ""),
    "k2": ("k2", ""),
    "heading_rad": ("heading", "deg"),
    "tilt_rad": ("tilt", "deg"),
    "roll_rad": ("roll", "deg"),
    "x_m": ("position x", "mm"),
    "y_m": ("position y", "mm"),
    "z_m": ("height", "mm"),
}
_HELD = "held, as the checkerboard has it"
_TOGETHER = "judged together, by the checks of bearings and delay"
_FARTHEST = "as far off the axis as strips were seen"
_BEYOND = "what halves of the data differ by there, and at least what the fit predicts"


def calibrate(gathered: Gathered, lenses: Mapping[str, LensFit] | None = None) -> Calibration:
    """Fit both cameras and their delay against motion capture, or the lidar where there is none.

    lenses: of the cameras ("front", "rear") whose lens is known by checkerboards; it is held, and
    the mounting alone is fitted. Raises UserError where nothing at all can be fitted.
    """
    cameras = gathered.config.camera
    lenses = lenses or {}
    known = {name: lens.camera for name, lens in lenses.items()}
    reference = reference_of(gathered)
    problem = CameraProblem(strips_of(gathered), reference, cameras, known)
    fit = problem.fit()
    if not any(fit.fitted):
        raise UserError(
            "the cameras cannot be fitted",
            f"{len(fit.used)} strips were seen, of which {np.count_nonzero(fit.used)} can be "
            "where a teammate truly was",
            "check the strip's colour and height in [camera.strip], and that front and rear are "
            "not exchanged",
        )
    fit = _complete(fit, gathered)
    times = problem.strips.times
    before = times < np.median(times[fit.used])
    parts = problem.again(fit, before), problem.again(fit, ~before)
    halves = (parts[0], parts[1]) if parts[0] is not None and parts[1] is not None else None
    numbers = [n for n, name in enumerate(CAMERAS) if fit.fitted[n] or _exists(gathered, name)]
    table = {n: sectors_of(fit, n, cameras) for n in numbers}
    off = pair_errors(fit, fit.cameras, fit.delay)
    off = off[fit.used & np.isfinite(off)]
    reaches = {
        n: reach_of(fit, n, halves, cameras, lenses[name].reach_rad if name in lenses else 0.0)
        for n, name in enumerate(CAMERAS)
        if fit.fitted[n]
    }
    return Calibration(
        kind="camera",
        fitted=_rows(gathered, fit, halves, known, off, reaches),
        checks=(
            *verdict(cameras, fit, halves, table),
            stamps_check([gathered.frame_times]),
        ),
        residuals=(
            f"bearings rms {math.degrees(math.sqrt(float(np.mean(off**2)))):.2f} deg over "
            f"{len(fit.used)} strips, {100 * np.mean(fit.used):.0f} % of them used"
        ),
        warnings=tuple(rounding_warnings([gathered.own_times])),
        pictures=pictures(cameras, fit, table, reaches),
        settings={f"camera.{CAMERAS[n]}.lens": "equidistant" for n in (0, 1) if fit.fitted[n]},
        figures=_figures(fit, off, table, isinstance(reference, Captured)),
    )


def _complete(fit: CameraFit, gathered: Gathered) -> CameraFit:
    """The fit with what of its covariance repeating this drive does not show.

    How the tracked body (without motion capture: the lidar) lies on the robot, and when the truth
    was stamped.
    """
    config = gathered.config
    keys, base = (BODY, config.mocap) if gathered.bodies else (LIDAR, config.lidar)
    slopes = np.zeros((len(fit.values), 3))
    for number in range(len(CAMERAS)):
        rows = [len(NAMES) * number + NAMES.index(name) for name in ("x_m", "y_m", "heading_rad")]
        slopes[rows] = by_base(fit.values[rows[:2]], np.array([base.x_m, base.y_m]))
    covariance = fit.covariance + carried(slopes, gathered.chain.covariance(config, keys))
    covariance[-1, -1] += gathered.truth_time_sigma**2
    return dataclasses.replace(fit, covariance=covariance)


def camera_advice(gathered: Gathered) -> list[str]:
    """What is still missing while the robot drives; empty when enough.

    By the bearings that the present configuration gives, which is near enough for this.
    """
    config = gathered.config
    messages = [b for b in gathered.bearings if b.pixels is not None and b.camera in CAMERAS]
    count = sum(len(b.bearings) for b in messages)
    missing = []
    if count < _ENOUGH_STRIPS:
        missing.append(f"drive on: {count} strips were seen so far, {_ENOUGH_STRIPS} are needed")
    for name in CAMERAS:
        if _exists(gathered, name):
            camera: Camera = getattr(config.camera, name)
            seen = [b.bearings for b in messages if b.camera == name]
            place = np.degrees(wrap(np.concatenate([*seen, np.zeros(0)])))
            shown = shown_sectors(camera, config.camera.strip.height_m)
            hits = [int(np.count_nonzero((place >= s) & (place < s + SECTOR_DEG))) for s in shown]
            found = [BearingSector(name, s, n, math.nan) for s, n in zip(shown, hits, strict=True)]
            if gaps := sectors_without_views(found):
                missing.append(f"{gaps}: bring a teammate there")
    ranges = np.concatenate([b.ranges for b in messages if b.ranges is not None] + [np.zeros(0)])
    if len(ranges) and not (ranges < _NEAR_M).any():
        missing.append(f"go nearer to a teammate than {_NEAR_M} m")
    if len(ranges) and not (ranges > _FAR_M).any():
        missing.append(f"go farther from a teammate than {_FAR_M} m")
    if gathered.displacements:
        steps = np.array([d.dpsi for d in gathered.displacements])
        missing += missing_rotations(steps, _ENOUGH_ROTATION_RAD)
    return missing


def _exists(gathered: Gathered, name: str) -> bool:
    """Whether the robot has this camera: it is configured, or something came from it."""
    camera: Camera = getattr(gathered.config.camera, name)
    return camera.source != "none" or any(b.camera == name for b in gathered.bearings)


def _rows(
    gathered: Gathered,
    fit: CameraFit,
    halves: Halves,
    known: Mapping[str, Camera],
    off: FloatArray,
    reaches: Mapping[int, Reach],
) -> tuple[Fitted, ...]:
    cameras = gathered.config.camera
    noise = max(normal_sigma(off), _LEAST_NOISE_RAD)
    spread = Quantity("", "noise of a bearing", "deg", "the fit of detection writes it").row(
        noise, noise / math.sqrt(2.0 * max(len(off), 1)), cameras.bearing_noise_rad
    )
    *rows, delay = value_rows(cameras, fit, halves, known)
    return (*rows, *_reach_rows(reaches), delay, spread)


def value_rows(
    cameras: Cameras, fit: CameraFit, halves: Halves, known: Collection[str]
) -> tuple[Fitted, ...]:
    """Rows of a report for what is fitted, the delay last. known: cameras whose lens is held."""
    sigmas = np.sqrt(np.diag(fit.covariance))
    rows = []
    for place in range(len(NAMES) * len(CAMERAS)):
        number, k = divmod(place, len(NAMES))
        camera, name = CAMERAS[number], NAMES[k]
        if not fit.fitted[number]:
            continue
        label, unit = _LABELS[name]
        held = camera in known and k < LENS_NAMES
        value = float(getattr(fit.cameras[number], name))
        apart = [float(half.values[place] - fit.values[place]) for half in halves or ()]
        why = _HELD if held else _TOGETHER
        what = Quantity(f"camera.{camera}.{name}", f"{camera} camera: {label}", unit, why)
        before = getattr(getattr(cameras, camera), name)
        pair = () if held else [value + each for each in apart]
        rows.append(what.row(value, math.nan if held else sigmas[place], before, pair))
    total, *pair = (cameras.delay_s + part.delay for part in (fit, *(halves or ())))
    delay = Quantity("camera.delay_s", "delay of the cameras", "ms", _TOGETHER)
    return (*rows, delay.row(max(total, 0.0), sigmas[-1], cameras.delay_s, pair))


def _reach_rows(reaches: Mapping[int, Reach]) -> list[Fitted]:
    """How far off the axis each camera's lens was seen, and what bearings beyond are worth."""
    rows = []
    for number, reach in reaches.items():
        camera, growth = CAMERAS[number], reach.beyond_noise_per_rad
        key, name = f"camera.{camera}.", f"{camera} camera: "
        angle = Quantity(f"{key}reach_rad", f"{name}lens known up to", "deg", _FARTHEST)
        beyond = Quantity(
            f"{key}beyond_noise_per_rad", f"{name}noise beyond, by angle²", "/rad", _BEYOND
        )
        rows += [angle.row(reach.angle, math.nan), beyond.row(growth, math.nan)]
    return rows


def _figures(
    fit: CameraFit, off: FloatArray, table: Mapping[int, list[BearingSector]], captured: bool
) -> dict[str, object]:
    return {
        "reference": "motion capture" if captured else "lidar",
        "strips": len(fit.used),
        "strips_used": int(np.count_nonzero(fit.used)),
        "bearing_error_p95_deg": math.degrees(float(np.percentile(np.abs(off), 95))),
        "sectors": [
            {
                **dataclasses.asdict(sector),
                "name": f"{sector.camera} camera, {sector.name}",
                "sigma_deg": math.degrees(sector.sigma_rad),
            }
            for found in table.values()
            for sector in found
        ],
    }
