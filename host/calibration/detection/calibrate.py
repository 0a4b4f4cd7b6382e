"""Scans, pictures and true paths → how well lidar and cameras detect teammates.

These are the numbers of the filter's sensor models (eq. 18-20, 29, 30): detection by distance,
blind sectors, clutter and noise. Teammates that something hides count neither as seen nor as
missed. The mounting and the delays have to be right before: nothing here corrects them.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from host.calibration.detection import pictures
from host.calibration.detection import verdict as checks
from host.calibration.detection.blind_sectors import Sector, find_sectors, match
from host.calibration.detection.camera_views import (
    CameraSurvey,
    bearing_noise,
    bearing_noise_sigma,
    survey_cameras,
)
from host.calibration.detection.clutter import clutter, interference, rate
from host.calibration.detection.lidar_views import (
    LidarSurvey,
    open_to,
    range_noise,
    survey_lidar,
)
from host.calibration.detection.range_curve import RangeCurve, Views, fit_curve
from host.calibration.gathered import Gathered, Tracks
from host.calibration.result import Calibration, Check, Fitted, ReportPicture
from host.config import Cameras, Lidar
from host.errors import UserError
from host.messages import BoolArray, FloatArray

advice = checks.advice

_PROBABILITY_LIMIT, _HALF_RANGE_LIMIT_M = 0.05, 0.15
_SHARE_LIMIT = 0.3  # of a noise or a steepness: how well it must be known
_RATE_LIMIT = 0.5  # of a rate: false detections come in swarms
_SECTOR_LIMIT_RAD = math.radians(0.5)
_DEGREES = math.degrees(1.0)


@dataclass(slots=True)
class _Part:
    """What one kind of sensor adds to the calibration."""

    fitted: list[Fitted] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    pictures: list[ReportPicture] = field(default_factory=list)
    settings: dict[str, Any] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    residuals: str = ""


def calibrate(gathered: Gathered) -> Calibration:
    """Fit the sensor models of the lidar and of the cameras, as far as there is data of each.

    Raises UserError where there is no motion capture, no teammate in it, or no sensor's data.
    """
    tracks = gathered.tracks()
    if not len(tracks.identities):
        raise UserError(
            "there is no teammate to detect",
            f"motion capture saw body {gathered.config.mocap.body} only, which is this robot",
            "put teammates with tracked bodies into the room",
        )
    if not gathered.scans and not gathered.bearings:
        raise UserError(
            "there is nothing to tell detection from",
            "neither a scan of the lidar nor a picture of a camera was received",
            "look how lidar and cameras do with `swarmloc run`",
        )
    parts, scanned = [], None
    if gathered.scans:
        scanned = survey_lidar(gathered, tracks)
        parts.append(_lidar(gathered, tracks, scanned))
    if gathered.bearings:
        seen = survey_cameras(gathered, tracks, scanned)
        parts.append(_cameras(gathered.config.camera, seen))
    return Calibration(
        kind="detection",
        fitted=tuple(row for part in parts for row in part.fitted),
        checks=tuple(check for part in parts for check in part.checks),
        residuals="; ".join(part.residuals for part in parts),
        pictures=tuple(picture for part in parts for picture in part.pictures),
        settings={key: value for part in parts for key, value in part.settings.items()},
        figures={key: value for part in parts for key, value in part.figures.items()},
    )


def _lidar(gathered: Gathered, tracks: Tracks, survey: LidarSurvey) -> _Part:
    lidar, views = gathered.config.lidar, survey.views
    sectors = find_sectors(gathered.scans, lidar)
    clear = open_to(views.bearings, views.distances, sectors, lidar)
    if not clear.any():
        raise _nobody("the lidar", "scan")
    curve, rows = _curve("lidar", lidar, views.part(clear))
    part = _Part(fitted=rows + _sector_rows(gathered, sectors))
    found = clutter(survey, curve, lidar)
    part.fitted.append(
        _rate_row(
            "lidar.clutter_per_m2",
            "lidar clutter",
            lidar.clutter_per_m2,
            [
                rate(found.counts[half], survey.areas[half], survey.times[half])
                for half in _all_and_halves(survey.times)
            ],
            "/m² a turn",
        )
    )
    noises = [range_noise(survey, clear & half) for half in _all_and_halves(views.times)]
    name = "lidar range noise at 1 m"
    part.fitted.append(
        _rate_row("lidar.range_noise_m", name, lidar.range_noise_m, noises, "mm", 1e3, _SHARE_LIMIT)
    )
    dazzled = interference(survey, clear, curve)
    part.fitted += [
        _told("turns lost to interference close by", 100.0 * dazzled.share, "%"),
        _told("interference in a row, mean", dazzled.mean_s, "s"),
        _told("interference in a row, longest", dazzled.longest_s, "s"),
    ]
    part.checks = checks.lidar_checks(survey, clear, curve, lidar)
    if sectors or all(check.passed for check in part.checks):  # else too little was seen to tell
        part.settings["lidar.blind_sectors"] = [
            {"centre_rad": s.centre, "width_rad": s.width} for s in sectors
        ]
    part.pictures = pictures.lidar_pictures(survey, clear, curve, sectors, found)
    off = survey.offsets[clear & views.seen]
    rms = math.sqrt(float(np.mean(np.sum(off**2, axis=1)))) if len(off) else math.nan
    part.residuals = f"lidar {1e3 * rms:.1f} mm rms in {len(off)} of {int(clear.sum())} views"
    part.figures["lidar"] = {
        "turns": len(survey.times),
        "views": int(clear.sum()),
        "seen": len(off),
        "rms_m": rms,
        "bias_along_m": float(np.mean(off[:, 0])) if len(off) else math.nan,
        "false_candidates": float(found.counts.sum()),
        "standing_things": found.standing.tolist(),
        "half_range_reached": curve.reached,
        "reach_m": curve.reach_m,
        "interference_share": dazzled.share,
        "interference_mean_s": dazzled.mean_s,
        "interference_longest_s": dazzled.longest_s,
    }
    return part


def _cameras(camera: Cameras, survey: CameraSurvey) -> _Part:
    views = survey.views
    if not len(views):
        raise _nobody("the cameras", "picture")
    curve, rows = _curve("camera", camera, views)
    part = _Part(fitted=rows)
    part.fitted.append(
        _rate_row(
            "camera.clutter_per_rad",
            "camera clutter",
            camera.clutter_per_rad,
            [
                rate(survey.false[half], survey.free[half], survey.times[half])
                for half in _all_and_halves(survey.times)
            ],
            "/rad a picture",
        )
    )
    (noise, mean), (early, _), (late, _) = (
        bearing_noise(survey, half) for half in _all_and_halves(views.times)
    )
    sigma = bearing_noise_sigma(survey)
    before = camera.bearing_noise_rad
    # Where the pixels' own noise drowns it, the data do not speak against what is configured.
    told = sigma < 0.5 * max(noise, before)
    part.fitted += [
        Fitted(
            key="camera.bearing_noise_rad" if told else "",
            name="bearing noise of lens and mounting" + ("" if told else " (not told: kept)"),
            value=max(noise, sigma),
            sigma=sigma,
            before=before,
            halves=_finite((early, late)),
            unit="deg",
            scale=_DEGREES,
        ),
        _told("mean bearing error", mean, "deg", _DEGREES),
    ]
    part.checks = checks.camera_checks(survey, curve, camera, mean)
    part.pictures = pictures.camera_pictures(survey, curve)
    errors = survey.errors[views.seen]
    rms = math.sqrt(float(np.mean(errors**2))) if len(errors) else math.nan
    part.residuals = (
        f"bearings {math.degrees(rms):.2f} deg rms in {len(errors)} of {len(views)} views"
    )
    part.figures["camera"] = {
        "pictures": len(survey.times),
        "views": len(views),
        "seen": len(errors),
        "rms_rad": rms,
        "mean_rad": mean,
        "false_bearings": float(survey.false.sum()),
        "half_range_reached": curve.reached,
        "reach_m": curve.reach_m,
    }
    return part


def _nobody(sensor: str, moment: str) -> UserError:
    return UserError(
        f"{sensor} never had a teammate in plain view",
        f"in every {moment} each was hidden, too near to another, or not tracked",
        "use fewer teammates, and drive where they are apart from each other",
    )


def _all_and_halves(times: FloatArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which of the times (n,) count: all, those of the first half of the drive, the others."""
    first: BoolArray = np.asarray(times <= 0.5 * (times.min() + times.max()))
    return first | True, first, ~first


def _finite(halves: tuple[float, float]) -> tuple[float, float] | None:
    return halves if math.isfinite(sum(halves)) else None


def _told(name: str, value: float, unit: str, scale: float = 1.0) -> Fitted:
    return Fitted(key="", name=name, value=value, sigma=math.nan, unit=unit, scale=scale)


def _rate_row(
    key: str,
    name: str,
    before: float,
    fits: list[tuple[float, float]],
    unit: str,
    scale: float = 1.0,
    share: float = _RATE_LIMIT,
) -> Fitted:
    """A row of a positive quantity, from its fits to all data and to the two halves."""
    (value, sigma), (early, _), (late, _) = fits
    return Fitted(
        key=key,
        name=name,
        value=value,
        sigma=sigma,
        limit=share * max(value, before) if math.isfinite(value) else share * before,
        before=before,
        halves=_finite((early, late)),
        unit=unit,
        scale=scale,
    )


def _curve(section: str, config: Lidar | Cameras, views: Views) -> tuple[RangeCurve, list[Fitted]]:
    """The curve of one sensor, and its three rows."""
    configured = config.half_range_m, config.range_steepness_per_m
    curve = fit_curve(views, configured)
    _, *parts = _all_and_halves(views.times)
    halves = [fit_curve(views.part(half), configured) for half in parts if half.any()]
    before = (config.detection_probability, *configured)
    keys = "detection_probability", "half_range_m", "range_steepness_per_m"
    names = "detection probability close by", "half-range", "steepness"
    limits = _PROBABILITY_LIMIT, _HALF_RANGE_LIMIT_M, _SHARE_LIMIT * float(curve.values[2])
    rows = []
    for k, (key, name, unit) in enumerate(zip(keys, names, ("", "m", "/m"), strict=True)):
        fitted = curve.reached or k == 0
        told = [float(half.values[k]) for half in halves if half.reached or k == 0]
        rows.append(
            Fitted(
                key=f"{section}.{key}" if fitted else "",
                name=f"{section} {name}"
                + ("" if fitted else f" (beyond {curve.reach_m:.1f} m: kept)"),
                value=float(curve.values[k]),
                sigma=float(curve.sigmas[k]),
                limit=limits[k] if fitted else None,
                before=before[k],
                halves=(told[0], told[1]) if fitted and len(told) == 2 else None,
                unit=unit,
            )
        )
    return curve, rows


def _sector_rows(gathered: Gathered, sectors: list[Sector]) -> list[Fitted]:
    """Two rows for each blind sector; they are written as a list, not by these rows."""
    lidar, scans = gathered.config.lidar, gathered.scans
    before = [Sector(s.centre_rad, s.width_rad) for s in lidar.blind_sectors]
    middle = len(scans) // 2
    halves = find_sectors(scans[:middle], lidar), find_sectors(scans[middle:], lidar)
    rows = []
    for number, sector in enumerate(sectors, 1):
        was = match(sector, before)
        early, late = match(sector, halves[0]), match(sector, halves[1])
        for quantity in ("centre", "width"):
            rows.append(
                Fitted(
                    key="",
                    name=f"blind sector {number}, {quantity}",
                    value=getattr(sector, quantity),
                    sigma=getattr(sector, f"{quantity}_sigma"),
                    limit=_SECTOR_LIMIT_RAD,
                    before=getattr(was, quantity) if was else None,
                    halves=(getattr(early, quantity), getattr(late, quantity))
                    if early and late
                    else None,
                    unit="deg",
                    scale=_DEGREES,
                )
            )
    return rows
