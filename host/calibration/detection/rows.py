"""What was fitted to detection, as rows of the report."""

import dataclasses
import math
import operator
from collections.abc import Iterable, Sequence

import numpy as np

from host.calibration.detection.blind_sectors import FoundSector, find_sectors, same_sector
from host.calibration.detection.range_curve import RangeCurve, Views, fit_curve
from host.calibration.gathered import Gathered
from host.calibration.result import Fitted, Quantity
from host.config import Cameras, Lidar, RobotConfig
from host.messages import BoolArray, FloatArray

_PROBABILITY_LIMIT, _HALF_RANGE_LIMIT_M = 0.05, 0.15
SHARE_LIMIT = 0.3  # of a noise or a steepness: how well it must be known
_RATE_LIMIT = 0.5  # of a rate: false detections come in swarms
_SECTOR_LIMIT_RAD = math.radians(0.5)
KEPT = "not observable, so kept as it was"
_CURVE = (
    ("detection_probability", "detection probability close by", ""),
    ("half_range_m", "half-range", "m"),
    ("range_steepness_per_m", "steepness", "/m"),
)


def all_and_halves(times: FloatArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Which of the times (n,) count: all, those of the first half of the drive, the others."""
    first: BoolArray = np.asarray(times <= 0.5 * (times.min() + times.max()))
    return first | True, first, ~first


def shown_row(name: str, value: float, unit: str) -> Fitted:
    """A row that is shown and not written."""
    return Quantity("", name, unit, "for information, not written").row(value, math.nan)


def positive_row(
    config: RobotConfig,
    key: str,
    name: str,
    fits: Iterable[tuple[float, float]],
    unit: str,
    share: float = _RATE_LIMIT,
) -> Fitted:
    """A row of a positive quantity, from the values and sigmas of all data and of both halves.

    share: of the quantity, as which its sigma may be.
    """
    (value, sigma), (early, _), (late, _) = fits
    before = float(operator.attrgetter(key)(config))
    limit = share * max(value, before) if math.isfinite(value) else share * before
    return Quantity(key, name, unit, limit).row(value, sigma, before, (early, late))


def bearing_row(config: RobotConfig, noises: Sequence[float], sigma: float) -> Fitted:
    """The row of the bearings' noise (rad) by all data and by both halves.

    It is not observable below the pixels' own noise.
    """
    fits = [(max(noises[0], sigma), sigma), *((noise, sigma) for noise in noises[1:])]
    name = "bearing noise of lens and mounting"
    row = positive_row(config, "camera.bearing_noise_rad", name, fits, "deg")
    most = 0.5 * max(noises[0], config.camera.bearing_noise_rad)
    if sigma < most:
        return dataclasses.replace(row, limit=most)
    name += " (not observable; configured value kept)"
    return dataclasses.replace(row, key="", name=name, limit=None, unbounded=KEPT)


def curve_rows(
    section: str, config: Lidar | Cameras, views: Views
) -> tuple[RangeCurve, list[Fitted]]:
    """The curve of one sensor, and its three rows."""
    configured = config.half_range_m, config.range_steepness_per_m
    curve = fit_curve(views, configured)
    _, *parts = all_and_halves(views.times)
    halves = [fit_curve(views.part(half), configured) for half in parts if half.any()]
    limits = _PROBABILITY_LIMIT, _HALF_RANGE_LIMIT_M, SHARE_LIMIT * float(curve.values[2])
    rows = []
    for k, (key, name, unit) in enumerate(_CURVE):
        fitted = curve.reached or k == 0
        both = [float(half.values[k]) for half in halves if half.reached or k == 0]
        what = Quantity(f"{section}.{key}", f"{section} {name}", unit, limits[k])
        if not fitted:
            what = Quantity("", f"{what.name} (beyond {curve.reach_m:.1f} m: kept)", unit, KEPT)
        pair = both if fitted and len(both) == 2 else ()
        rows.append(what.row(curve.values[k], curve.sigmas[k], getattr(config, key), pair))
    return curve, rows


def sector_rows(gathered: Gathered, sectors: list[FoundSector]) -> list[Fitted]:
    """Two rows for each blind sector; they are written as a list, not by these rows."""
    lidar, scans = gathered.config.lidar, gathered.scans
    before = [FoundSector(s.centre_rad, s.width_rad) for s in lidar.blind_sectors]
    middle = len(scans) // 2
    halves = find_sectors(scans[:middle], lidar), find_sectors(scans[middle:], lidar)
    heading = math.sqrt(gathered.chain.covariance(gathered.config, ("lidar.heading_rad",))[0, 0])
    unseen = {"centre": heading, "width": 0.0}  # the centres turn with the lidar
    rows = []
    for number, sector in enumerate(sectors, 1):
        was = same_sector(sector, before)
        early, late = (same_sector(sector, half) for half in halves)
        for quantity in ("centre", "width"):
            value_of = operator.attrgetter(quantity)
            name = f"blind sector {number}, {quantity}"
            rows.append(
                Quantity("", name, "deg", _SECTOR_LIMIT_RAD).row(
                    value_of(sector),
                    math.hypot(getattr(sector, f"{quantity}_sigma"), unseen[quantity]),
                    value_of(was) if was else None,
                    (value_of(early), value_of(late)) if early and late else (),
                )
            )
    return rows
