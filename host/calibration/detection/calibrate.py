"""Scans, pictures and true paths → how well lidar and cameras detect teammates.

These are the numbers of the filter's sensor models (eq. 18-20, 29, 30): detection by distance,
blind sectors, clutter and noise. Teammates that something hides count neither as seen nor as
missed. The mounting and the delays have to be right before: nothing here corrects them.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from host.calibration.detection.blind_sectors import find_sectors
from host.calibration.detection.camera_views import (
    CameraSurvey,
    bearing_noise,
    bearing_noise_sigma,
    survey_cameras,
)
from host.calibration.detection.clutter import clutter, interference, rate_of
from host.calibration.detection.lidar_views import (
    LidarSurvey,
    open_to,
    range_noise,
    survey_lidar,
)
from host.calibration.detection.pictures import camera_pictures, lidar_pictures
from host.calibration.detection.rows import (
    KEPT,
    SHARE_LIMIT,
    all_and_halves,
    curve_rows,
    finite_halves,
    positive_row,
    sector_rows,
    shown_row,
)
from host.calibration.detection.verdict import camera_verdict, lidar_verdict
from host.calibration.gathered import Gathered, Tracks
from host.calibration.result import Calibration, Check, Fitted, ReportPicture
from host.config import Cameras
from host.errors import UserError


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
            "there is nothing to fit detection to",
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
    curve, rows = curve_rows("lidar", lidar, views.part(clear))
    part = _Part(fitted=rows + sector_rows(gathered, sectors))
    found = clutter(survey, curve, lidar)
    parts = all_and_halves(survey.times)
    rates = (rate_of(found.counts[k], survey.areas[k], survey.times[k]) for k in parts)
    name, unit = "lidar clutter", "/m² a revolution"
    before = lidar.clutter_per_m2
    part.fitted.append(positive_row("lidar.clutter_per_m2", name, before, rates, unit))
    noises = (range_noise(survey, clear & half) for half in all_and_halves(views.times))
    name, before = "lidar range noise at 1 m", lidar.range_noise_m
    row = positive_row("lidar.range_noise_m", name, before, noises, "mm", SHARE_LIMIT)
    part.fitted.append(row)
    dazzled = interference(survey, clear, curve)
    part.fitted += [
        shown_row("revolutions lost to interference close by", dazzled.share, "%"),
        shown_row("interference in a row, mean", dazzled.mean_s, "s"),
        shown_row("interference in a row, longest", dazzled.longest_s, "s"),
    ]
    part.checks = lidar_verdict(survey, clear, curve, lidar)
    if sectors or all(check.passed for check in part.checks):  # else too little was seen
        part.settings["lidar.blind_sectors"] = [
            {"centre_rad": s.centre, "width_rad": s.width} for s in sectors
        ]
    part.pictures = lidar_pictures(survey, clear, curve, sectors, found)
    off = survey.offsets[clear & views.seen]
    rms = math.sqrt(float(np.mean(np.sum(off**2, axis=1)))) if len(off) else math.nan
    part.residuals = f"lidar {1e3 * rms:.1f} mm rms in {len(off)} of {int(clear.sum())} views"
    part.figures["lidar"] = {
        "revolutions": len(survey.times),
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


def _cameras(cameras: Cameras, survey: CameraSurvey) -> _Part:
    views = survey.views
    if not len(views):
        raise _nobody("the cameras", "picture")
    curve, rows = curve_rows("camera", cameras, views)
    part = _Part(fitted=rows)
    parts = all_and_halves(survey.times)
    rates = (rate_of(survey.false[k], survey.free[k], survey.times[k]) for k in parts)
    name, unit = "camera clutter", "/rad a picture"
    before = cameras.clutter_per_rad
    part.fitted.append(positive_row("camera.clutter_per_rad", name, before, rates, unit))
    (noise, mean), (early, _), (late, _) = (
        bearing_noise(survey, half) for half in all_and_halves(views.times)
    )
    sigma = bearing_noise_sigma(survey)
    before = cameras.bearing_noise_rad
    # Not observable below the pixels' own noise.
    most = 0.5 * max(noise, before)
    observable = sigma < most
    part.fitted += [
        Fitted(
            key="camera.bearing_noise_rad" if observable else "",
            name="bearing noise of lens and mounting"
            + ("" if observable else " (not observable; configured value kept)"),
            value=max(noise, sigma),
            sigma=sigma,
            limit=most if observable else None,
            unbounded="" if observable else KEPT,
            before=before,
            halves=finite_halves((early, late)),
            unit="deg",
        ),
        shown_row("mean bearing error", mean, "deg"),
    ]
    part.checks = camera_verdict(survey, curve, cameras, mean)
    part.pictures = camera_pictures(survey, curve)
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
