"""Calibration of the wheels: radii, track and noise of a differential drive, against a true path.

A radius and the counts per revolution are one thing together: only the way per tick is seen. Radii
are fitted, and counts are left alone unless the way per tick is off by about 2 or 4, as it is where
edges of the encoder's signals are counted otherwise than configured.
"""

import math
from collections.abc import Sequence

import numpy as np

from host.calibration.identity.check import check_identity
from host.calibration.result import Calibration, Check, at_most
from host.calibration.stamps import rounding_warnings, stamps_check
from host.calibration.wheels.fit import WINDOW_S, Fit, fit, rough_start
from host.calibration.wheels.model import LAGS, Drive, values_of, without_absurd_rows
from host.calibration.wheels.noise import noise
from host.calibration.wheels.pictures import pictures
from host.calibration.wheels.scale import scale_of
from host.calibration.wheels.verdict import (
    KEYS,
    LEAST_TURN_RAD,
    coverage,
    noise_rows,
    residuals,
    value_rows,
    verdict,
    warnings,
    with_other_paths,
)
from host.config import Mocap, Wheels
from host.errors import UserError
from host.messages import FloatArray

_MOST_ABSURD = 0.005  # of all rows of ticks


def calibrate(
    drives: Sequence[Drive], wheels: Wheels, mocap: Mocap, known: FloatArray | None = None
) -> Calibration:
    """Fit radii, track, the tracked body's pose on the robot, the lag of the ticks, and noise.

    wheels, mocap: as configured. known (3, 3): covariance of radii and track, if an earlier fit
    found those configured. Raises UserError where nothing moved, or the wheels do not count
    as the body moves; whatever else keeps the fit from being used is a failed check.
    """
    drives, absurd = usable(drives)
    for drive in drives:
        _check_identity(drive, len(drives), wheels, mocap)
    driven = coverage(drives, wheels.track_m)
    both_ways = min(driven.left_rad, driven.right_rad) >= LEAST_TURN_RAD
    nominal = values_of(wheels, mocap, len(drives))
    found = _fit(drives, wheels.counts_per_turn, nominal, both_ways)
    found = with_other_paths(found, driven)
    halves = _halves(drives, found.counts, wheels, mocap)
    scale = scale_of(found.values, found.covariance, wheels, known)
    words = f"{absurd} row(s) of ticks that no wheel can count: taken for what is around them"
    other_counts = found.counts != wheels.counts_per_turn
    return Calibration(
        kind="wheels",
        fitted=(
            *value_rows(found, halves, wheels, mocap),
            *noise_rows(*noise(drives, found), wheels),
        ),
        checks=(
            *verdict(found, driven, wheels),
            stamps_check([drive.truth_times for drive in drives]),
            _absurd_check(absurd, drives),
            *scale.checks(mocap),
        ),
        residuals=residuals(found),
        warnings=(
            *([words] if absurd else []),
            *warnings(driven),
            *scale.warnings(mocap),
            *rounding_warnings([d.truth_times if d.stamps is None else d.stamps for d in drives]),
        ),
        pictures=pictures(drives, found, (wheels.counts_per_turn, nominal), driven),
        joint=(KEYS, found.covariance[:6, :6]),
        settings={"wheels.counts_per_turn": found.counts} if other_counts else {},
        figures={
            "drives": [drive.name for drive in drives],
            "way_m": driven.way_m,
            "turned_left_deg": math.degrees(driven.left_rad),
            "turned_right_deg": math.degrees(driven.right_rad),
            "straight_share": driven.straight,
            "turn_spread": driven.spread,
            "curved_share": driven.curved,
            "windows": len(found.windows),
            "windows_used": int(np.count_nonzero(found.used)),
            "lags_at_start_and_end_s": found.values[LAGS].reshape(-1, 2).tolist(),
        },
    )


def _check_identity(drive: Drive, of: int, wheels: Wheels, mocap: Mocap) -> None:
    """`check_identity` of a drive; of several, the error names it."""
    body = {mocap.body: (drive.truth_times, drive.truth)}
    try:
        check_identity(drive.times, drive.ticks, body, wheels, mocap)
    except UserError as error:
        if of == 1:
            raise
        raise UserError(f"{drive.name}: {error.what}", error.why, error.next_step) from error


def usable(drives: Sequence[Drive]) -> tuple[list[Drive], int]:
    """Those longer than a window of the fit, without absurd rows of ticks; how many these were."""
    parts = [without_absurd_rows(drive) for drive in _long(drives)]
    return [drive for drive, _ in parts], sum(count for _, count in parts)


def _absurd_check(absurd: int, drives: Sequence[Drive]) -> Check:
    """That rows which no wheel can count are few: where they are many, others do not show."""
    return at_most(
        "rows of ticks that no wheel can count",
        absurd / max(sum(len(drive.times) for drive in drives), 1),
        _MOST_ABSURD,
        "%",
    ).otherwise(
        f"{absurd} rows of ticks are damaged, and more may be that do not show: check the plugs of "
        "the encoders and the board's cable, and record again"
    )


def _long(drives: Sequence[Drive]) -> list[Drive]:
    return [drive for drive in drives if drive.span[1] - drive.span[0] > WINDOW_S]


def _fit(drives: Sequence[Drive], counts: int, nominal: FloatArray, both_ways: bool) -> Fit:
    """The fit, with other counts per revolution where those are what is wrong."""
    start = rough_start(drives, counts, nominal)
    if start is None:
        raise UserError(
            "the wheels cannot be calibrated: the robot hardly moved",
            "in the time in which both its ticks and its true path are known",
            "drive it for a minute, straight and in curves both ways, in view of motion capture",
        )
    if both_ways:
        if (start[:2] < 0.0).any():
            raise UserError(
                "the wheels cannot be calibrated: they do not move as the tracked body does",
                "no combination of both wheels' ways gives its rotations",
                "see that body in [mocap] is this robot, and that both run at the same time",
            )
    else:
        # Only rotations both ways separate the wheels.
        start[:2] = nominal[:2] * np.median(np.abs(start[:2] / nominal[:2]))
        start[2] = nominal[2]
    factor = round(math.log2(math.sqrt(abs(start[0] * start[1] / (nominal[0] * nominal[1])))))
    if factor and abs(factor) <= 2:
        counts = max(4, round(counts / 2.0**factor))
        start[:2] /= 2.0**factor
    found = fit(drives, counts, start, nominal)
    if found is None:
        raise UserError(
            "the wheels cannot be calibrated: the robot was seen moving for a moment only",
            "in the time in which both its ticks and its true path are known",
            "drive it for a minute in view of motion capture",
        )
    return found


def _halves(
    drives: Sequence[Drive], counts: int, wheels: Wheels, mocap: Mocap
) -> list[FloatArray] | None:
    """Values of the first and of the second half of every drive; None where that is too little."""
    middles = [0.5 * sum(drive.span) for drive in drives]
    firsts = [drive.part(-math.inf, m) for drive, m in zip(drives, middles, strict=True)]
    lasts = [drive.part(m, math.inf) for drive, m in zip(drives, middles, strict=True)]
    values = []
    for parts in (_long(firsts), _long(lasts)):
        driven = coverage(parts, wheels.track_m)
        if min(driven.left_rad, driven.right_rad) < LEAST_TURN_RAD:
            return None
        nominal = values_of(wheels, mocap, len(parts))
        start = rough_start(parts, counts, nominal)
        found = None if start is None else fit(parts, counts, start, nominal)
        if found is None:
            return None
        values.append(found.values)
    return values
