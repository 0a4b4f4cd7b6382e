"""Scans, pictures and true paths → how well lidar and cameras detect teammates.

These are the numbers of the filter's sensor models (eq. 18-20, 29, 30): detection by distance,
blind sectors, clutter and noise. Teammates that something hides count neither as seen nor as
missed. The mounting and the delays have to be right before: nothing here corrects them.
"""

import dataclasses
import math
import operator
from collections.abc import Iterable

import numpy as np

from host.calibration.detection.blind_sectors import FoundSector, find_sectors, same_sector
from host.calibration.detection.camera_views import (
    CameraSurvey,
    bearing_noise,
    bearing_noise_sigma,
    survey_cameras,
)
from host.calibration.detection.clutter import clutter, interference, rate_of
from host.calibration.detection.lidar_views import LidarSurvey, open_to, range_noise, survey_lidar
from host.calibration.detection.pictures import camera_pictures, lidar_pictures
from host.calibration.detection.range_curve import RangeCurve, Views, fit_curve
from host.calibration.detection.verdict import camera_verdict, lidar_verdict
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration, Fitted, Quantity, joined
from host.config import Cameras, Lidar, RobotConfig
from host.errors import UserError
from host.messages import BoolArray, FloatArray

_PROBABILITY_LIMIT, _HALF_RANGE_LIMIT_M = 0.05, 0.15
_SHARE_LIMIT = 0.3  # of a noise or a steepness: how well it must be known
_RATE_LIMIT = 0.5  # of a rate: false detections come in swarms
_SECTOR_LIMIT_RAD = math.radians(0.5)
_KEPT = "not observable, so kept as it was"
_CURVE = (
    ("detection_probability", "detection probability close by", ""),
    ("half_range_m", "half-range", "m"),
    ("range_steepness_per_m", "steepness", "/m"),
)
# Key, name and unit of positive quantities, whose sigma may be a share of them.
_LIDAR_CLUTTER = ("lidar.clutter_per_m2", "lidar clutter", "/m² a revolution")
_CAMERA_CLUTTER = ("camera.clutter_per_rad", "camera clutter", "/rad a picture")
_RANGE_NOISE = ("lidar.range_noise_m", "lidar range noise at 1 m", "mm")
_BEARING_NOISE = ("camera.bearing_noise_rad", "bearing noise of lens and mounting", "deg")
_Named = tuple[str, str, str]


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
    curve, rows = _curve_rows("lidar", lidar, views.part(clear))
    found = clutter(survey, curve, lidar)
    noises = (range_noise(survey, clear & part) for part in _all_and_halves(views.times))
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
            *_sector_rows(gathered, sectors),
            _rate_row(config, _LIDAR_CLUTTER, found.counts, survey.areas, survey.times),
            _positive_row(config, _RANGE_NOISE, noises, _SHARE_LIMIT),
            _shown_row("revolutions lost to interference close by", dazzled.share, "%"),
            _shown_row("interference in a row, mean", dazzled.mean_s, "s"),
            _shown_row("interference in a row, longest", dazzled.longest_s, "s"),
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
    curve, rows = _curve_rows("camera", config.camera, views)
    noises = [bearing_noise(survey, part) for part in _all_and_halves(views.times)]
    mean = noises[0][1]
    errors = survey.errors[views.seen]
    rms = math.sqrt(float(np.mean(errors**2))) if len(errors) else math.nan
    return Calibration(
        kind="detection",
        fitted=(
            *rows,
            _rate_row(config, _CAMERA_CLUTTER, survey.false, survey.free, survey.times),
            _bearing_row(config, [noise for noise, _ in noises], bearing_noise_sigma(survey)),
            _shown_row("mean bearing error", mean, "deg"),
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


def _all_and_halves(times: FloatArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which of the times (n,) count: all, those of the first half of the drive, the others."""
    first: BoolArray = np.asarray(times <= 0.5 * (times.min() + times.max()))
    return first | True, first, ~first


def _shown_row(name: str, value: float, unit: str) -> Fitted:
    """A row that is shown and not written."""
    return Quantity("", name, unit, "for information, not written").row(value, math.nan)


def _rate_row(
    config: RobotConfig, what: _Named, counts: FloatArray, sizes: FloatArray, times: FloatArray
) -> Fitted:
    """The row of a rate: so many events (s,) of what was looked at (s,), at times (s,) s."""
    parts = _all_and_halves(times)
    rates = (rate_of(counts[part], sizes[part], times[part]) for part in parts)
    return _positive_row(config, what, rates, _RATE_LIMIT)


def _positive_row(
    config: RobotConfig, what: _Named, fits: Iterable[tuple[float, float]], share: float
) -> Fitted:
    """A row of a positive quantity, from the values and sigmas of all data and of both halves.

    share: of the quantity, as which its sigma may be.
    """
    (value, sigma), (early, _), (late, _) = fits
    before = float(operator.attrgetter(what[0])(config))
    limit = share * max(value, before) if math.isfinite(value) else share * before
    return Quantity(*what, limit).row(value, sigma, before, (early, late))


def _bearing_row(config: RobotConfig, noises: Iterable[float], sigma: float) -> Fitted:
    """The row of the bearings' noise (rad) by all data and by both halves.

    It is not observable below the pixels' own noise.
    """
    noise, *halves = noises
    fits = [(max(noise, sigma), sigma), *((half, sigma) for half in halves)]
    row = _positive_row(config, _BEARING_NOISE, fits, _RATE_LIMIT)
    most = 0.5 * max(noise, config.camera.bearing_noise_rad)
    if sigma < most:
        return dataclasses.replace(row, limit=most)
    name = f"{row.name} (not observable; configured value kept)"
    return dataclasses.replace(row, key="", name=name, limit=None, unbounded=_KEPT)


def _curve_rows(
    section: str, config: Lidar | Cameras, views: Views
) -> tuple[RangeCurve, list[Fitted]]:
    """The curve of one sensor, and its three rows."""
    configured = config.half_range_m, config.range_steepness_per_m
    curve = fit_curve(views, configured)
    _, *parts = _all_and_halves(views.times)
    halves = [fit_curve(views.part(half), configured) for half in parts if half.any()]
    limits = _PROBABILITY_LIMIT, _HALF_RANGE_LIMIT_M, _SHARE_LIMIT * float(curve.values[2])
    rows = []
    for k, (key, name, unit) in enumerate(_CURVE):
        fitted = curve.reached or k == 0
        both = [float(half.values[k]) for half in halves if half.reached or k == 0]
        what = Quantity(f"{section}.{key}", f"{section} {name}", unit, limits[k])
        if not fitted:
            what = Quantity("", f"{what.name} (beyond {curve.reach_m:.1f} m: kept)", unit, _KEPT)
        pair = both if fitted and len(both) == 2 else ()
        rows.append(what.row(curve.values[k], curve.sigmas[k], getattr(config, key), pair))
    return curve, rows


def _sector_rows(gathered: Gathered, sectors: list[FoundSector]) -> list[Fitted]:
    """Two rows for each blind sector; they are written as a list, not by these rows."""
    lidar, scans = gathered.config.lidar, gathered.scans
    before = [FoundSector(s.centre_rad, s.width_rad) for s in lidar.blind_sectors]
    middle = len(scans) // 2
    halves = find_sectors(scans[:middle], lidar), find_sectors(scans[middle:], lidar)
    heading = math.sqrt(gathered.chain.covariance(gathered.config, ("lidar.heading_rad",))[0, 0])
    rows = []
    for number, sector in enumerate(sectors, 1):
        was = same_sector(sector, before)
        early, late = (same_sector(sector, half) for half in halves)
        # Centres are as uncertain as the lidar's heading, too.
        for quantity, unseen in (("centre", heading), ("width", 0.0)):
            value_of = operator.attrgetter(quantity)
            name = f"blind sector {number}, {quantity}"
            rows.append(
                Quantity("", name, "deg", _SECTOR_LIMIT_RAD).row(
                    value_of(sector),
                    math.hypot(getattr(sector, f"{quantity}_sigma"), unseen),
                    value_of(was) if was else None,
                    (value_of(early), value_of(late)) if early and late else (),
                )
            )
    return rows
