"""Calibration of the wheels: radii, track and noise of a differential drive, against a true path.

A radius and the counts per turn are one thing together: only the way per tick is seen. Radii are
fitted, and counts are left alone unless the way per tick is off by about 2 or 4, as it is where
edges of the encoder's signals are counted otherwise than configured.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from host.calibration.gathered import Gathered
from host.calibration.result import Calibration
from host.calibration.wheels.fit import WINDOW_S, Fit, fit, lags_of, rough_start
from host.calibration.wheels.model import (
    LAGS,
    Drive,
    at,
    body_path,
    compose,
    configured,
    relative,
    values_of,
)
from host.calibration.wheels.noise import noise
from host.calibration.wheels.pictures import pictures
from host.calibration.wheels.verdict import (
    BIN_S,
    LEAST_TURN_RAD,
    LEAST_WAY_M,
    NOISES,
    checks,
    coverage,
    noise_rows,
    residuals,
    value_rows,
    warnings,
)
from host.config import Mocap, Wheels
from host.errors import UserError
from host.messages import FloatArray
from host.recording.optiodom import OptiodomRun

__all__ = [
    "Drive",
    "advice",
    "apply",
    "calibrate",
    "drive_of_run",
    "drives_of",
    "end_error",
    "score",
]

_HOLE_S = 0.1  # ticks of a longer gap are lost
_MARGIN_S = 1.0  # truth that goes with a drive whose stamps are late or early


def drives_of(gathered: Gathered) -> list[Drive]:
    """What calibration needs of a robot's messages: a drive for each stretch without a hole.

    Raises UserError where there are no ticks, or motion capture never saw the robot's body.
    """
    steps = [step for step in gathered.displacements if step.ticks is not None]
    if not steps:
        raise UserError(
            "there are no wheel ticks to calibrate with",
            "the board sent no displacement, or the recording was made without ticks",
            "see how the board does with `swarmloc run`, and record again",
        )
    tracks = gathered.tracks()
    body = gathered.config.mocap.body
    seen = np.unique([frame.time for frame in gathered.bodies if body in frame.identities])
    truth = tracks.body(body, seen)
    known = np.isfinite(truth).all(axis=1)
    begins = [step.time - step.interval for step in steps]
    holes = [k for k in range(1, len(steps)) if begins[k] - steps[k - 1].time > _HOLE_S]
    drives = []
    for first, last in itertools.pairwise([0, *holes, len(steps)]):
        part = steps[first:last]
        times = np.array([begins[first], *(step.time for step in part)])
        ticks = np.cumsum([(0, 0), *(step.ticks for step in part if step.ticks)], axis=0)
        within = known & (seen >= times[0] - _MARGIN_S) & (seen <= times[-1] + _MARGIN_S)
        name = f"drive from {times[0]:.1f} s" if holes else "drive"
        drives.append(Drive(times, ticks.astype(np.int64), seen[within], truth[within], name))
    return drives


def drive_of_run(run: OptiodomRun) -> Drive:
    """A recorded run as a drive."""
    return Drive(run.times, run.ticks, run.truth_times, run.truth, run.name)


def calibrate(drives: Sequence[Drive], wheels: Wheels, mocap: Mocap) -> Calibration:
    """Fit radii, track, the tracked body's pose on the robot, the lag of the ticks, and noise.

    wheels, mocap: as configured. Raises UserError where nothing moved, or a wheel counts the
    wrong way round; whatever else keeps the fit from being used is a failed check.
    """
    drives = _usable(drives)
    driven = coverage(drives, wheels.track_m)
    both_ways = min(driven.left_rad, driven.right_rad) >= LEAST_TURN_RAD
    nominal = values_of(wheels, mocap, len(drives))
    found = _fit(drives, wheels.counts_per_turn, nominal, both_ways)
    halves = _halves(drives, found.counts, wheels, mocap)
    settings: dict[str, Any] = {}
    if found.counts != wheels.counts_per_turn:
        settings["wheels.counts_per_turn"] = found.counts
    return Calibration(
        kind="wheels",
        fitted=(
            *value_rows(found, halves, wheels, mocap),
            *noise_rows(noise(drives, found), wheels),
        ),
        checks=checks(found, driven, wheels),
        residuals=residuals(found),
        warnings=tuple(warnings(driven)),
        pictures=pictures(drives, found, (wheels.counts_per_turn, nominal), driven),
        settings=settings,
        figures={
            "drives": [drive.name for drive in drives],
            "way_m": driven.way_m,
            "turned_left_deg": math.degrees(driven.left_rad),
            "turned_right_deg": math.degrees(driven.right_rad),
            "straight_share": driven.straight,
            "turn_spread": driven.spread,
            "windows": len(found.windows),
            "windows_used": int(np.count_nonzero(found.used)),
            "lags_at_start_and_end_s": found.values[LAGS].reshape(-1, 2).tolist(),
        },
    )


def _usable(drives: Sequence[Drive]) -> list[Drive]:
    return [drive for drive in drives if drive.span[1] - drive.span[0] > WINDOW_S]


def _fit(drives: Sequence[Drive], counts: int, nominal: FloatArray, both_ways: bool) -> Fit:
    """The fit, with other counts per turn where those are what is wrong."""
    start = rough_start(drives, counts, nominal)
    if start is None:
        raise UserError(
            "the wheels cannot be calibrated: the robot hardly moved",
            "in the time in which both its ticks and its true path are known",
            "drive it for a minute, straight and in turns both ways, in view of motion capture",
        )
    if both_ways:
        _check_signs(start)
    else:
        # Only turns both ways tell the wheels apart.
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


def _check_signs(start: FloatArray) -> None:
    left, right = start[0] < 0.0, start[1] < 0.0
    if not (left or right):
        return
    which = (
        "both encoders count" if left and right else f"the {'left' if left else 'right'} one counts"
    )
    raise UserError(
        "the wheels' encoders do not fit the true path",
        f"{which} the wrong way round, or left and right are exchanged",
        "set left_encoder_reversed, right_encoder_reversed in [motors] of robot.toml, or exchange "
        "the plugs",
    )


def _halves(
    drives: Sequence[Drive], counts: int, wheels: Wheels, mocap: Mocap
) -> tuple[FloatArray, FloatArray] | None:
    """Values of the first and of the second half of every drive; None where that is too little."""
    fits = []
    for first in (True, False):
        middles = [0.5 * sum(drive.span) for drive in drives]
        parts = [
            drive.part(-math.inf, middle) if first else drive.part(middle, math.inf)
            for drive, middle in zip(drives, middles, strict=True)
        ]
        parts = _usable(parts)
        driven = coverage(parts, wheels.track_m)
        if min(driven.left_rad, driven.right_rad) < LEAST_TURN_RAD:
            return None
        nominal = values_of(wheels, mocap, len(parts))
        start = rough_start(parts, counts, nominal)
        found = None if start is None else fit(parts, counts, start, nominal)
        if found is None:
            return None
        fits.append(found.values)
    return fits[0], fits[1]


def advice(gathered: Gathered) -> list[str]:
    """What is still missing while the robot drives; empty when enough was driven.

    By the wheels as configured, so it costs little: it is asked for every second.
    """
    if not gathered.bodies:
        return ["motion capture has not sent a frame yet"]
    body = gathered.config.mocap.body
    if not any(body in frame.identities for frame in gathered.bodies[-200:]):
        return [f"motion capture does not see body {body}: is it the robot's, and in view?"]
    steps = [(step.time, step.dx, step.dpsi) for step in gathered.displacements if step.ticks]
    if not steps:
        return ["no wheel ticks have come yet: drive"]
    times, ways, turns = np.array(steps).T
    bins = ((times - times[0]) / BIN_S).astype(np.int64)
    turned = np.bincount(bins, turns)
    left, right = turned[turned > 0.0].sum(), abs(turned[turned < 0.0].sum())
    way = np.abs(ways).sum()
    wanted = []
    if way < LEAST_WAY_M:
        wanted.append(f"drive further than {LEAST_WAY_M:.0f} m: {way:.1f} m so far")
    for side, angle in (("left", left), ("right", right)):
        # Asked for a little more than the least, for the wheels are not known yet.
        if angle < 1.2 * LEAST_TURN_RAD:
            wanted.append(
                f"turn to the {side} by {math.degrees(1.2 * LEAST_TURN_RAD):.0f} deg: "
                f"{math.degrees(angle):.0f} so far"
            )
    straight = np.abs(np.bincount(bins, ways))[np.abs(turned) < 0.2].sum()
    if straight < 0.05 * way:
        wanted.append(f"drive straight on for a while: {straight:.1f} m of {way:.1f} m so far")
    return wanted


def end_error(
    drive: Drive, wheels: Wheels, mocap: Mocap, lags: tuple[float, float] = (0.0, 0.0)
) -> float:
    """How far (m) odometry from the first true pose on is from truth at the last one.

    lags: by how much (s) the stamps of the ticks are late at the drive's start and end.
    """
    first, last = drive.span
    ends = np.searchsorted(drive.truth_times, (first, np.nextafter(last, math.inf))) - (0, 1)
    poses = body_path(drive, wheels.counts_per_turn, values_of(wheels, mocap))
    reached = at(drive, poses, np.array(lags), drive.truth_times[ends])
    start, end = drive.truth[ends][:1], drive.truth[ends][1:]
    by_wheels = compose(start, relative(reached[:1], reached[1:])[0])
    return float(np.hypot(*(by_wheels - end)[0, :2]))


def score(
    name: str,
    drives: Sequence[Drive],
    nominal: tuple[Wheels, Mocap],
    fitted: tuple[Wheels, Mocap],
) -> dict[str, Any]:
    """How well odometry ends on drives that the fit has not seen, before and after.

    nominal, fitted: what was configured, and what it is with the fit in it (`apply`). Means over
    the drives, and each of them under "runs". By how much the clocks of a drive differ is the
    recording's affair, not the wheels': it is found from the headings by the fitted geometry and
    used for both. It matters only where the robot moves at an end of the drive. Raises UserError
    for a drive without ticks and a true path at the same time.
    """
    runs = []
    for drive in drives:
        if drive.span == (0.0, 0.0):
            raise UserError(
                f"{name} cannot be scored",
                "its ticks and its true path are never known at the same time",
                "name a run that was recorded with motion capture in view of the robot",
            )
        wheels, mocap = fitted
        start, end = lags_of(drive, wheels.counts_per_turn, values_of(wheels, mocap)).tolist()
        runs.append(
            {
                "name": drive.name,
                "nominal_end_error_m": end_error(drive, *nominal, (start, end)),
                "fitted_end_error_m": end_error(drive, *fitted, (start, end)),
            }
        )
    means = {
        key: float(np.mean([run[key] for run in runs]))
        for key in ("nominal_end_error_m", "fitted_end_error_m")
    }
    return {"source": name, **means, "runs": runs}


def apply(calibration: Calibration, wheels: Wheels, mocap: Mocap) -> tuple[Wheels, Mocap]:
    """The configuration with what was fitted in it."""
    new = calibration.new_settings()
    values = [new[row.key] for row in calibration.fitted[:6]]
    wheels, mocap = configured(np.array(values), wheels, mocap)
    rest = {
        key.removeprefix("wheels."): new[key]
        for key in ("wheels.counts_per_turn", *NOISES)
        if key in new
    }
    return wheels.model_copy(update=rest), mocap
