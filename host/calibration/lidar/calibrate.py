"""Where the lidar sits on the robot, its heading and its delay, from teammates it saw.

Motion capture has where each teammate was in the robot frame; the lidar has turrets, some of them
teammates, in its own frame. The best mounting is searched at each of many delays; at the
best of these, mounting and delay are fitted together.
"""

import math
from functools import partial

import numpy as np

from host.calibration.chain import BODY, LIDAR, by_base, carried
from host.calibration.coverage import missing_rotations, tracks_so_far
from host.calibration.gathered import Gathered, Tracks
from host.calibration.lidar.pictures import pictures
from host.calibration.lidar.search import (
    NEAR_M,
    Turrets,
    find_turrets,
    fit_at,
    places_of,
    recognised,
)
from host.calibration.lidar.verdict import (
    STEP_S,
    Outcome,
    coverage_checks,
    verdict,
)
from host.calibration.result import Calibration, Fitted, Quantity
from host.calibration.robust.time_offset import (
    CORRELATED_S,
    DelayCurve,
    JointFit,
    fit_jointly,
    scan,
)
from host.calibration.stamps import delay_check, rounding_warnings, stamps_check
from host.errors import UserError
from host.geometry import polar, to_parent, wrap
from host.messages import FloatArray, IntArray

_DELAYS_S = (-0.5, 1.0)  # that robot.toml may have
_SCANNED = 500  # turrets that the cost at a delay is of
_PAIRING_ROUNDS = 3
_RISE_SIGMAS = 3.0
_LEAST_ROTATION = math.pi
# Std of what repeating does not show: a byte is stamped up to its own time late.
_BYTE_S = 7.8e-5 / math.sqrt(3.0)
UNSEEN = np.diag([0.0, 0.0, 0.0, _BYTE_S, 0.0]) ** 2
# Of each row: place among the fitted values, and what it is.
_ROWS = (
    (2, Quantity("lidar.heading_rad", "heading of the lidar", "deg", math.radians(0.1))),
    (0, Quantity("lidar.x_m", "x of the lidar", "mm", 0.003)),
    (1, Quantity("lidar.y_m", "y of the lidar", "mm", 0.003)),
    (3, Quantity("lidar.delay_s", "delay of the lidar", "ms", 0.005)),
    (
        4,
        Quantity(
            "",
            "range bias at turrets",
            "mm",
            "not written; it shows whether lidar.target_diameter_m is the turrets'",
        ),
    ),
)


def calibrate(gathered: Gathered) -> Calibration:
    """Fit lidar.heading_rad, x_m, y_m and delay_s to the teammates that motion capture saw.

    Raises UserError where there is nothing to fit: no revolution of the lidar, no motion capture of
    this robot and a teammate, or no mounting that brings turrets onto teammates.
    """
    tracks = gathered.tracks_of_teammates()
    lidar = gathered.config.lidar
    configured = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad, lidar.delay_s, 0.0])
    seen = find_turrets(gathered.scans, lidar)
    curve, start = _search(seen, tracks)
    joint, who = _fit_pairs(seen, tracks, start)
    halves = _halves(seen, tracks, joint.values, who)
    outcome = _outcome(configured, tracks, seen, curve, joint, who)
    covariance = _complete(_honest(joint.covariance, outcome), joint.values, gathered)
    used = int(np.count_nonzero(outcome.used))
    return Calibration(
        kind="lidar",
        fitted=value_rows(configured, joint.values, covariance, halves),
        checks=(
            *verdict(outcome),
            stamps_check([gathered.frame_times]),
            delay_check(
                "delay of the lidar", float(joint.values[3]), math.sqrt(joint.covariance[3, 3])
            ),
        ),
        residuals=f"rms {1e3 * outcome.rms:.1f} mm over {used} sightings of teammates, "
        f"{100.0 * outcome.share:.0f} % of all turrets seen",
        warnings=tuple(rounding_warnings([gathered.own_times])),
        pictures=pictures(outcome),
        joint=((*LIDAR, "lidar.delay_s"), covariance[:4, :4]),
        figures={
            "rms_m": outcome.rms,
            "used": used,
            "candidates": outcome.candidates,
            "plausible_delays_s": list(outcome.plausible),
        },
    )


def _search(seen: Turrets, tracks: Tracks) -> tuple[DelayCurve, FloatArray]:
    """The best cost at each delay, and the values (5,) that are best."""
    some = seen.some(_SCANNED)
    curve = scan(lambda delay: fit_at(delay, some, tracks)[1], *_DELAYS_S, STEP_S)
    pose, cost = fit_at(curve.best, some, tracks)
    if cost >= NEAR_M**2:
        raise UserError(
            "no mounting of the lidar brings what it saw onto the teammates",
            "at no delay and no rotation do turrets lie where motion capture has teammates",
            "see that motion capture streams at the same time, and that [mocap] body is this robot",
        )
    return curve, np.array([*pose, curve.best, 0.0])


def _fit_pairs(seen: Turrets, tracks: Tracks, values: FloatArray) -> tuple[JointFit, IntArray]:
    """The joint fit, and who each candidate is (n,): a teammate's identity, or -1."""
    for _ in range(_PAIRING_ROUNDS):
        who = recognised(seen, tracks, values)
        joint = _fit(seen, tracks, values, who)
        values = joint.values
    return joint, who


def _fit(seen: Turrets, tracks: Tracks, start: FloatArray, who: IntArray) -> JointFit:
    """The joint fit of candidates (n,) that are the teammates `who` (n,); -1 has no truth."""
    truth = partial(places_of, tracks, who)
    return fit_jointly(seen.points, seen.times, seen.sigmas, truth, start)


def _halves(seen: Turrets, tracks: Tracks, values: FloatArray, who: IntArray) -> list[FloatArray]:
    """The fit (5,) of either half of the data in time; nan where a half has too little."""
    middle = float(np.median(seen.times[who >= 0]))
    found = []
    for chosen in (seen.times < middle, seen.times >= middle):
        try:
            found.append(_fit(seen, tracks, values, np.where(chosen, who, -1)).values)
        except UserError:
            found.append(np.full(5, math.nan))
    return found


def _outcome(
    configured: FloatArray,
    tracks: Tracks,
    seen: Turrets,
    curve: DelayCurve,
    joint: JointFit,
    who: IntArray,
) -> Outcome:
    paired = (who >= 0) & np.isfinite(joint.errors).all(axis=1)
    used = joint.weights > 0.0
    placed = to_parent(seen.points, joint.values[:3])
    # As configured, a reading belongs to another time, at which its teammate was elsewhere.
    then = places_of(tracks, who, seen.times - configured[3])
    before = to_parent(seen.points, configured[:3]) - then
    squares = float(np.mean(np.sum(joint.errors[used] ** 2, axis=1)))
    # As if errors were alike for seconds: one independent sighting for each three seconds.
    blocks = max((seen.times[-1] - seen.times[0]) / CORRELATED_S, 1.0)
    return Outcome(
        truths=(placed - joint.errors)[paired],
        errors=joint.errors[paired],
        before=before[paired],
        used=used[paired],
        origin=joint.values[:2],
        candidates=len(seen.times),
        curve=curve,
        plausible=curve.interval(_RISE_SIGMAS**2 * squares / blocks),
    )


def _honest(covariance: FloatArray, outcome: Outcome) -> FloatArray:
    """The covariance (5, 5), as wide as the curve of the cost says where that is flat.

    On a circle at constant speed the curvature at the least cost claims far too much.
    """
    if outcome.separable or not np.isfinite(covariance).all():
        return covariance
    low, high = outcome.plausible
    return np.asarray(covariance * ((0.5 * (high - low)) ** 2 / covariance[3, 3]))


def _complete(covariance: FloatArray, values: FloatArray, gathered: Gathered) -> FloatArray:
    """The covariance (5, 5) with what repeating this drive does not show.

    How the tracked body lies on the robot, when the truth was stamped, how late bytes are.
    """
    config = gathered.config
    slopes = np.zeros((5, 3))
    slopes[:3] = by_base(values[:2], np.array([config.mocap.x_m, config.mocap.y_m]))
    wider = covariance + carried(slopes, gathered.chain.covariance(config, BODY))
    wider[3, 3] += gathered.truth_time_sigma**2
    return np.asarray(wider + UNSEEN)


def value_rows(
    configured: FloatArray, values: FloatArray, covariance: FloatArray, halves: list[FloatArray]
) -> tuple[Fitted, ...]:
    """Rows of a report for the values (5,) and their covariance (5, 5); halves: none, or two."""
    whole = np.array([0.0, 0.0, values[2] - float(wrap(values[2])), 0.0, 0.0])  # circles
    values, halves = values - whole, [half - whole for half in halves]
    return tuple(
        what.row(
            values[k],
            math.sqrt(covariance[k, k]),
            configured[k] if what.key else None,
            [half[k] for half in halves],
        )
        for k, what in _ROWS
    )


def lidar_advice(gathered: Gathered) -> list[str]:
    """What is still missing for `calibrate`, by the paths alone; empty when enough.

    Raises UserError where motion capture never saw this robot.
    """
    if not gathered.scans:
        return ["no revolution of the lidar yet"]
    if not gathered.bodies:
        return ["motion capture has seen nothing yet"]
    tracks = tracks_so_far(gathered)
    times = np.array([scan.time for scan in gathered.scans])
    ranges, bearings = polar(tracks.teammates(times).reshape(-1, 2))
    in_range = ranges <= gathered.config.lidar.max_range_m
    steps = np.diff(tracks.own(times)[:, 2])
    checks = coverage_checks(ranges[in_range], bearings[in_range])
    return [
        *(check.advice for check in checks if not check.passed),
        *missing_rotations(steps[np.isfinite(steps)], _LEAST_ROTATION),
    ]
