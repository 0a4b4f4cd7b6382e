"""Lens, mounting and delay of the cameras, from strips of teammates whose true place is known."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from pydantic import ValidationError

from host.calibration.camera_fit import CameraFit, CameraProblem
from host.calibration.camera_model import LENS_NAMES, NAMES
from host.calibration.camera_pairs import EYES, Captured, reference_of, strips_of
from host.calibration.camera_pictures import pictures
from host.calibration.camera_verdict import (
    LEAST_VIEWS,
    SECTOR_DEG,
    Sector,
    bearing_errors,
    difference,
    gaps,
    in_words,
    sectors,
    shown_sectors,
)
from host.calibration.gathered import Gathered
from host.calibration.lens_fit import LensFit
from host.calibration.result import Calibration, Check, Fitted
from host.calibration.time_offset import scan
from host.config import Eye
from host.errors import UserError
from host.geometry import wrap
from host.messages import FloatArray
from host.perception.lens import equidistant_limit

_SIGMA_DEG, _HALVES_DEG = 0.3, 1.0  # of bearings
_DELAY_MS, _USED_PERCENT = 15.0, 40.0
_CURVE_S, _CURVE_STEP_S = 0.2, 0.02  # around the delay found
_LEAST_NOISE_RAD = 0.001
_ENOUGH_STRIPS, _ENOUGH_TURN_RAD = 200, 1.5  # to drive on for; the turn each way
_NEAR_M, _FAR_M = 0.8, 1.5

_NORMAL_MEDIAN = 0.6745  # of an error's size, in standard deviations
_LABELS = {
    "focal_px": ("focal length", "px", 1.0),
    "centre_x_px": ("centre x", "px", 1.0),
    "centre_y_px": ("centre y", "px", 1.0),
    "k1": ("k1", "", 1.0),
    "k2": ("k2", "", 1.0),
    "heading_rad": ("heading", "deg", math.degrees(1.0)),
    "tilt_rad": ("tilt", "deg", math.degrees(1.0)),
    "roll_rad": ("roll", "deg", math.degrees(1.0)),
    "x_m": ("place x", "mm", 1000.0),
    "y_m": ("place y", "mm", 1000.0),
    "z_m": ("height", "mm", 1000.0),
}

Halves = tuple[CameraFit, CameraFit] | None


def calibrate(gathered: Gathered, lenses: Mapping[str, LensFit] | None = None) -> Calibration:
    """Fit both cameras and their delay against motion capture, or the lidar where there is none.

    lenses: of the eyes ("front", "rear") whose lens is known by checkerboards; it is held, and the
    mounting alone is fitted. Raises UserError where nothing at all can be fitted.
    """
    camera = gathered.config.camera
    known = {name: lens.eye for name, lens in (lenses or {}).items()}
    reference = reference_of(gathered)
    problem = CameraProblem(strips_of(gathered), reference, camera, known)
    fit = problem.fit()
    if not any(fit.fitted):
        raise UserError(
            "the cameras cannot be fitted",
            f"{len(fit.used)} strips were seen, of which {np.count_nonzero(fit.used)} can be "
            "where a teammate truly was",
            "check the strip's colour and height in [camera.strip], and that front and rear are "
            "not exchanged",
        )
    times = problem.strips.times
    before = times < np.median(times[fit.used])
    parts = problem.again(fit, before), problem.again(fit, ~before)
    halves = (parts[0], parts[1]) if parts[0] is not None and parts[1] is not None else None
    numbers = [n for n, name in enumerate(EYES) if fit.fitted[n] or _exists(gathered, name)]
    table = {n: sectors(fit, n, camera) for n in numbers}
    curve = scan(
        lambda delay: problem.cost_at(fit, delay),
        max(fit.delay - _CURVE_S, -camera.delay_s),
        fit.delay + _CURVE_S,
        _CURVE_STEP_S,
    )
    off = _used_errors(fit)
    return Calibration(
        kind="camera",
        fitted=_rows(gathered, fit, halves, known, off, isinstance(reference, Captured)),
        checks=_checks(gathered, fit, halves, table),
        residuals=(
            f"bearings rms {math.degrees(math.sqrt(float(np.mean(off**2)))):.2f} deg over "
            f"{len(fit.used)} strips, {100 * np.mean(fit.used):.0f} % of them used"
        ),
        pictures=pictures(gathered, fit, table, curve),
        settings={f"camera.{EYES[n]}.lens": "equidistant" for n in (0, 1) if fit.fitted[n]},
        figures=_figures(fit, off, table, isinstance(reference, Captured)),
    )


def advice(gathered: Gathered) -> list[str]:
    """What is still missing while the robot drives; empty when enough.

    By the bearings that the present configuration gives, which is near enough for this.
    """
    config = gathered.config
    messages = [b for b in gathered.bearings if b.pixels is not None and b.eye in EYES]
    count = sum(len(b.bearings) for b in messages)
    missing = []
    if count < _ENOUGH_STRIPS:
        missing.append(f"drive on: {count} strips were seen so far, {_ENOUGH_STRIPS} are needed")
    for name in EYES:
        if _exists(gathered, name):
            eye: Eye = getattr(config.camera, name)
            seen = [b.bearings for b in messages if b.eye == name]
            place = np.degrees(wrap(np.concatenate([*seen, np.zeros(0)])))
            shown = shown_sectors(eye, config.camera.strip.height_m)
            hits = [int(np.count_nonzero((place >= s) & (place < s + SECTOR_DEG))) for s in shown]
            found = [Sector(name, s, n, math.nan) for s, n in zip(shown, hits, strict=True)]
            missing += [f"{words}: bring a teammate there" for words in [gaps(found)] if words]
    ranges = np.concatenate([b.ranges for b in messages if b.ranges is not None] + [np.zeros(0)])
    if len(ranges) and not (ranges < _NEAR_M).any():
        missing.append(f"go nearer to a teammate than {_NEAR_M} m")
    if len(ranges) and not (ranges > _FAR_M).any():
        missing.append(f"go farther from a teammate than {_FAR_M} m")
    turns = np.array([d.dpsi for d in gathered.displacements] or [0.0])
    for way, total in (("left", turns[turns > 0.0].sum()), ("right", -turns[turns < 0.0].sum())):
        if gathered.displacements and total < _ENOUGH_TURN_RAD:
            missing.append(f"turn more to the {way}: {math.degrees(total):.0f} deg so far")
    return missing


def _exists(gathered: Gathered, name: str) -> bool:
    """Whether the robot has this camera: it is configured, or something came from it."""
    eye: Eye = getattr(gathered.config.camera, name)
    return eye.source != "none" or any(b.eye == name for b in gathered.bearings)


def _used_errors(fit: CameraFit) -> FloatArray:
    """Errors of the bearings (n,) rad of the pairs that the fit rests upon."""
    parts = []
    points, strips = fit.pairs.at(fit.delay), fit.pairs.strips
    for number, eye in enumerate(fit.eyes):
        mine = fit.used & (strips.eyes == number)
        parts.append(bearing_errors(eye, points[mine], strips.pixels[mine]))
    off = np.concatenate(parts)
    kept: FloatArray = off[np.isfinite(off)]
    return kept


def _rows(
    gathered: Gathered,
    fit: CameraFit,
    halves: Halves,
    known: Mapping[str, Eye],
    off: FloatArray,
    captured: bool,
) -> tuple[Fitted, ...]:
    camera = gathered.config.camera
    sigmas = np.sqrt(np.diag(fit.covariance))
    rows = []
    for place in range(len(NAMES) * len(EYES)):
        number, k = divmod(place, len(NAMES))
        eye, name = EYES[number], NAMES[k]
        if not fit.fitted[number]:
            continue
        label, unit, scale = _LABELS[name]
        held = eye in known and k < LENS_NAMES
        value = float(getattr(fit.eyes[number], name))
        apart = [float(half.values[place] - fit.values[place]) for half in halves or ()]
        rows.append(
            Fitted(
                key=f"camera.{eye}.{name}",
                name=f"{eye} camera: {label}",
                value=value,
                sigma=math.nan if held else float(sigmas[place]),
                before=float(getattr(getattr(camera, eye), name)),
                halves=(value + apart[0], value + apart[1]) if apart and not held else None,
                unit=unit,
                scale=scale,
            )
        )
    total = [camera.delay_s + part.delay for part in (fit, *(halves or ()))]
    noise = max(float(np.median(np.abs(off))) / _NORMAL_MEDIAN, _LEAST_NOISE_RAD)
    delay = Fitted(
        key="camera.delay_s",
        name="delay of the cameras",
        value=max(total[0], 0.0),
        sigma=float(sigmas[-1]),
        before=camera.delay_s,
        halves=(total[1], total[2]) if halves else None,
        unit="ms",
        scale=1000.0,
    )
    spread = Fitted(
        # Against the lidar it is that of both sensors together.
        key="camera.bearing_noise_rad" if captured else "",
        name="noise of a bearing",
        value=noise,
        sigma=noise / math.sqrt(2.0 * max(len(off), 1)),
        before=camera.bearing_noise_rad,
        unit="deg",
        scale=math.degrees(1.0),
    )
    return (*rows, delay, spread)


def _checks(
    gathered: Gathered, fit: CameraFit, halves: Halves, table: Mapping[int, list[Sector]]
) -> tuple[Check, ...]:
    checks = []
    sigma = 1000.0 * math.sqrt(fit.covariance[-1, -1])
    for number, found in table.items():
        checks.append(_views(EYES[number], found))
        if fit.fitted[number]:
            checks += [
                _bearings(EYES[number], found, sigma <= _DELAY_MS),
                _explained(fit, number),
                *_sound(fit, number),
            ]
    checks.append(
        Check(
            name="sigma of the delay",
            value=sigma,
            threshold=_DELAY_MS,
            unit="ms",
            passed=sigma <= _DELAY_MS,
            advice="turn the robot to the left and to the right by turns while teammates are in "
            "view: at one constant speed a delay looks like a camera that is mounted askew",
        )
    )
    return (*checks, _agreement(gathered, fit, halves, table))


def _views(name: str, found: list[Sector]) -> Check:
    seen = sum(sector.pairs >= LEAST_VIEWS for sector in found)
    return Check(
        name=f"{name} camera: sectors with views",
        value=float(seen),
        threshold=float(len(found)),
        unit="sectors",
        passed=bool(found) and seen == len(found),
        advice=f"{gaps(found) or f'{name} camera shows no strip anywhere as it is mounted'}; "
        "drive so that a teammate comes by there, near and far",
    )


def _bearings(name: str, found: list[Sector], timed: bool) -> Check:
    seen = [sector for sector in found if sector.pairs >= LEAST_VIEWS]
    worst = max((math.degrees(sector.sigma_rad) for sector in seen), default=math.inf)
    bad = [sector for sector in seen if not math.degrees(sector.sigma_rad) <= _SIGMA_DEG]
    return Check(
        name=f"{name} camera: sigma of a bearing, worst sector",
        value=worst,
        threshold=_SIGMA_DEG,
        unit="deg",
        passed=bool(seen) and not bad,
        advice=f"{name} camera knows bearings badly {in_words(bad, found)}: record for longer, "
        "with teammates there, near (0.5 m) and far (2 m)"
        if timed
        else "as long as the delay is not known, neither is where the camera looks",
    )


def _explained(fit: CameraFit, number: int) -> Check:
    used = 100.0 * float(np.mean(fit.used[fit.pairs.strips.eyes == number]))
    return Check(
        name=f"{EYES[number]} camera: strips where a teammate was",
        value=used,
        threshold=_USED_PERCENT,
        unit="%",
        passed=used >= _USED_PERCENT,
        advice="take away what else has the strip's colour, or narrow the colour; check the "
        "strip's height in [camera.strip], and motion capture for bodies it loses",
    )


def _sound(fit: CameraFit, number: int) -> list[Check]:
    """What is wrong with an eye in itself: at most one failed check each for lens and values."""
    eye, name = fit.eyes[number], EYES[number]
    limit = math.degrees(equidistant_limit(eye.k1, eye.k2))
    checks = [
        Check(
            name=f"{name} camera: the lens reaches off its axis",
            value=limit,
            threshold=90.0,
            unit="deg",
            passed=limit >= 90.0,
            advice="no such lens is built: bring teammates to the border of the picture, or give "
            "pictures of a checkerboard",
        )
    ]
    try:
        Eye.model_validate(eye.model_dump())
    except ValidationError as error:
        wrong = ", ".join(str(detail["loc"][0]) for detail in error.errors())
        checks.append(
            Check(
                name=f"{name} camera: values out of all bounds",
                value=float(error.error_count()),
                threshold=0.0,
                unit="values",
                passed=False,
                advice=f"{wrong} cannot be; check that front and rear are not exchanged, and the "
                "strip's height in [camera.strip]",
            )
        )
    return checks


def _agreement(
    gathered: Gathered, fit: CameraFit, halves: Halves, table: Mapping[int, list[Sector]]
) -> Check:
    """Whether both halves of the data give the same bearings, where both had views."""
    apart = math.inf
    if halves is not None:
        camera = gathered.config.camera
        off = [np.zeros(0)]
        for number in table:
            both = [sectors(half, number, camera) for half in halves]
            seen = [{s.first_deg for s in part if s.pairs >= LEAST_VIEWS} for part in both]
            chosen = [s for s in table[number] if s.first_deg in seen[0] & seen[1]]
            off.append(difference(*halves, number, chosen, camera.strip.height_m))
        all_off = np.abs(np.concatenate(off))
        apart = math.degrees(float(np.percentile(all_off, 95))) if len(all_off) else math.inf
    return Check(
        name="bearings by the halves of the data, apart (95 %)",
        value=apart,
        threshold=_HALVES_DEG,
        unit="deg",
        passed=apart <= _HALVES_DEG,
        advice="record for longer, with teammates all around in each half; if that does not help, "
        "look whether a camera is loose",
    )


def _figures(
    fit: CameraFit, off: FloatArray, table: Mapping[int, list[Sector]], captured: bool
) -> dict[str, object]:
    return {
        "reference": "motion capture" if captured else "lidar",
        "strips": len(fit.used),
        "strips_used": int(np.count_nonzero(fit.used)),
        "bearing_error_p95_deg": math.degrees(float(np.percentile(np.abs(off), 95))),
        "sectors": [
            {
                **dataclasses.asdict(sector),
                "name": f"{sector.eye} camera, {sector.name}",
                "sigma_deg": math.degrees(sector.sigma_rad),
            }
            for found in table.values()
            for sector in found
        ],
    }
