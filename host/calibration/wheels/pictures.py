"""What there is to see of a calibration of the wheels."""

import math
from collections.abc import Sequence

import numpy as np

from host.calibration.result import ReportPicture, Role, Series
from host.calibration.wheels.fit import WINDOW_S, Fit
from host.calibration.wheels.model import (
    LAGS,
    Drive,
    at,
    body_path,
    compose,
    misses,
    relative,
)
from host.calibration.wheels.verdict import Coverage
from host.messages import FloatArray

Geometry = tuple[int, FloatArray]  # counts per revolution, and values

_MOST_POINTS, _MOST_PATHS = 1500, 4


def pictures(
    drives: Sequence[Drive],
    found: Fit,
    nominal: Geometry,
    driven: Coverage,
) -> tuple[ReportPicture, ...]:
    """Paths, headings, what was driven, and what the fit leaves.

    nominal: counts per revolution and values, as configured.
    """
    lags = found.values[LAGS].reshape(-1, 2)
    # How late ticks are was not configured: what was before has that of the fit.
    before = nominal[0], np.concatenate((nominal[1][:6], found.values[LAGS]))
    after = found.counts, found.values
    shown = list(zip(drives, lags, strict=True))[:_MOST_PATHS]
    paths = [_path(drive, lag, before, after) for drive, lag in shown]
    return (
        *paths,
        _headings(shown, before, after),
        ReportPicture(
            title="What was driven",
            axes=("speed, m/s", "rotation rate, deg/s"),
            series=(Series(driven.speeds, np.degrees(driven.turn_rates), "", "reference"),),
            caption="Each point is 2 s. Good: points above and below zero, and along it.",
        ),
        _left_over(drives, found, before),
    )


def _both(
    drive: Drive, lag: FloatArray, geometry: Geometry
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (k,) s, true poses (k, 3) then, and those by the wheels from the first true one on."""
    first, last = drive.span
    index = np.flatnonzero((drive.truth_times >= first) & (drive.truth_times <= last))
    index = index[:: max(1, math.ceil(len(index) / _MOST_POINTS))]
    times, true = drive.truth_times[index], drive.truth[index]
    poses = at(drive, body_path(drive, *geometry), lag, times)
    return times, true, compose(true[:1], relative(poses[:1], poses))


def _path(drive: Drive, lag: FloatArray, before: Geometry, after: Geometry) -> ReportPicture:
    _, true, old = _both(drive, lag, before)
    *_, new = _both(drive, lag, after)
    return ReportPicture(
        title=f"Path {drive.name}".rstrip(),
        axes=("x, m", "y, m"),
        series=(
            Series(true[:, 0], true[:, 1], "motion capture", "reference", "line"),
            Series(old[:, 0], old[:, 1], "wheels, before", "before", "line"),
            Series(new[:, 0], new[:, 1], "wheels, fitted", "fitted", "line"),
        ),
        caption="By the wheels alone from the first true pose on.",
        equal=True,
    )


def _headings(
    shown: Sequence[tuple[Drive, FloatArray]], before: Geometry, after: Geometry
) -> ReportPicture:
    series = []
    both: tuple[tuple[Geometry, Role], ...] = ((before, "before"), (after, "fitted"))
    for drive, lag in shown:
        for geometry, role in both:
            times, true, wheels = _both(drive, lag, geometry)
            error = np.degrees(wheels[:, 2] - true[:, 2])
            label = f"{drive.name} {role}".strip()
            series.append(Series(times - drive.span[0], error, label, role, "line"))
    return ReportPicture(
        title="Error of the heading",
        axes=("time, s", "by the wheels minus true, deg"),
        series=tuple(series),
        caption="What is left is a random walk; a line that still climbs steadily is geometry.",
    )


def _left_over(drives: Sequence[Drive], found: Fit, before: Geometry) -> ReportPicture:
    used = found.windows.where(found.used)
    rates = np.degrees(used.moved[:, 2]) / WINDOW_S
    old = np.degrees(misses(drives, *before, used)[:, 2])
    new = np.degrees(found.residuals[found.used, 2])
    return ReportPicture(
        title="Heading error in 2 s, by rotation rate",
        axes=("rotation rate, deg/s", "by the wheels minus true, deg"),
        series=(Series(rates, old, "before", "before"), Series(rates, new, "fitted", "fitted")),
        caption="Before, a slope is the track and an offset the radii; fitted, neither is left.",
    )
