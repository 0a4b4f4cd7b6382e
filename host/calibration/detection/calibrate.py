"""Scans, pictures and true paths → how well lidar and cameras detect teammates.

These are the numbers of the filter's sensor models (eq. 18-20, 29, 30): detection by distance,
blind sectors, clutter and noise. Teammates that something hides count neither as seen nor as
missed. The mounting and the delays have to be right before: nothing here corrects them.
"""

import math

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
    SHARE_LIMIT,
    all_and_halves,
    bearing_row,
    curve_rows,
    positive_row,
    sector_rows,
    shown_row,
)
from host.calibration.detection.verdict import camera_verdict, lidar_verdict
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration, joined
from host.config import RobotConfig
from host.errors import UserError

_RATE_UNIT, _NOISE = "/m² a revolution", "lidar range noise at 1 m"


def calibrate(gathered: Gathered) -> Calibration:
    """Fit the sensor models of the lidar and of the cameras, as far as there is data of each.

    Raises UserError where there is no motion capture, no teammate in it, or no sensor's data.
    """
    tracks = gathered.tracks_of_teammates()
    if not gathered.scans and not gathered.bearings:
        raise UserError(
            "there is nothing to fit detection to",
            "neither a scan of the lidar nor a picture of a camera was received",
            "check lidar and cameras with `swarmloc run`",
        )
    parts, scanned = [], None
    if gathered.scans:
        scanned = survey_lidar(gathered, tracks)
        parts.append(_lidar(gathered, scanned))
    if gathered.bearings:
        seen = survey_cameras(gathered, tracks, scanned)
        parts.append(_cameras(gathered.config, seen))
    return joined(parts)


def _lidar(gathered: Gathered, survey: LidarSurvey) -> Calibration:
    lidar, views = gathered.config.lidar, survey.views
    sectors = find_sectors(gathered.scans, lidar)
    clear = open_to(views.bearings, views.distances, sectors, lidar)
    if not clear.any():
        raise _nobody("the lidar", "scan")
    curve, rows = curve_rows("lidar", lidar, views.part(clear))
    found = clutter(survey, curve, lidar)
    parts = all_and_halves(survey.times)
    rates = (rate_of(found.counts[k], survey.areas[k], survey.times[k]) for k in parts)
    noises = (range_noise(survey, clear & half) for half in all_and_halves(views.times))
    dazzled = interference(survey, clear, curve)
    config = gathered.config
    checks = lidar_verdict(survey, clear, curve, lidar)
    settings = {}
    if sectors or all(check.passed for check in checks):  # else too little was seen
        settings["lidar.blind_sectors"] = [
            {"centre_rad": s.centre, "width_rad": s.width} for s in sectors
        ]
    off = survey.offsets[clear & views.seen]
    rms = math.sqrt(float(np.mean(np.sum(off**2, axis=1)))) if len(off) else math.nan
    return Calibration(
        kind="detection",
        fitted=(
            *rows,
            *sector_rows(gathered, sectors),
            positive_row(config, "lidar.clutter_per_m2", "lidar clutter", rates, _RATE_UNIT),
            positive_row(config, "lidar.range_noise_m", _NOISE, noises, "mm", SHARE_LIMIT),
            shown_row("revolutions lost to interference close by", dazzled.share, "%"),
            shown_row("interference in a row, mean", dazzled.mean_s, "s"),
            shown_row("interference in a row, longest", dazzled.longest_s, "s"),
        ),
        checks=tuple(checks),
        residuals=f"lidar {1e3 * rms:.1f} mm rms in {len(off)} of {int(clear.sum())} views",
        pictures=tuple(lidar_pictures(survey, clear, curve, sectors, found)),
        settings=settings,
        figures={
            "lidar": {
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
        },
    )


def _cameras(config: RobotConfig, survey: CameraSurvey) -> Calibration:
    views = survey.views
    if not len(views):
        raise _nobody("the cameras", "picture")
    curve, rows = curve_rows("camera", config.camera, views)
    parts = all_and_halves(survey.times)
    rates = (rate_of(survey.false[k], survey.free[k], survey.times[k]) for k in parts)
    noises = [bearing_noise(survey, half) for half in all_and_halves(views.times)]
    mean = noises[0][1]
    errors = survey.errors[views.seen]
    rms = math.sqrt(float(np.mean(errors**2))) if len(errors) else math.nan
    return Calibration(
        kind="detection",
        fitted=(
            *rows,
            positive_row(
                config, "camera.clutter_per_rad", "camera clutter", rates, "/rad a picture"
            ),
            bearing_row(config, [noise for noise, _ in noises], bearing_noise_sigma(survey)),
            shown_row("mean bearing error", mean, "deg"),
        ),
        checks=tuple(camera_verdict(survey, curve, config.camera, mean)),
        residuals=f"bearings {math.degrees(rms):.2f} deg rms in {len(errors)} of "
        f"{len(views)} views",
        pictures=tuple(camera_pictures(survey, curve)),
        figures={
            "camera": {
                "pictures": len(survey.times),
                "views": len(views),
                "seen": len(errors),
                "rms_rad": rms,
                "mean_rad": mean,
                "false_bearings": float(survey.false.sum()),
                "half_range_reached": curve.reached,
                "reach_m": curve.reach_m,
            }
        },
    )


def _nobody(sensor: str, moment: str) -> UserError:
    return UserError(
        f"{sensor} never had a teammate in plain view",
        f"in every {moment} each was hidden, too near to another, or not tracked",
        "use fewer teammates, and drive where they are apart from each other",
    )
