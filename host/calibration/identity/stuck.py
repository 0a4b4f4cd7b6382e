"""Encoders that count nothing or always the same, for a while or for good, as the robot drives.

A wheel may stand: then the robot rotates about it, as fast as the other wheel says, and the body
goes a way that is not much longer than the robot is wide. Where it moves otherwise, it is the
encoder that stands still.
"""

import math

import numpy as np

from host.calibration.identity.spells import held
from host.calibration.identity.windows import Bodies, longest, moved_in_windows, runs, spans
from host.config import Wheels
from host.errors import UserError
from host.messages import BoolArray, FloatArray, IntArray

_WINDOW_S, _STRIDE_S = 0.3, 0.1
_LEAST_S, _MARGIN_S = 0.8, 0.25  # of a silence; and by how much the clocks may differ at its ends
_NEITHER_S = 6.0  # both wheels silent: less may be a robot that is carried
_SILENT_M, _SILENT_TICKS = 5e-4, 1.5
_LEAST_WAY_M = 0.03  # of the other wheel meanwhile
_DRIVES_MPS = 0.02
_WIDE = 2.0  # tracks, of a radius: no body on a robot goes so about a wheel of it
_OTHERWISE = 0.5  # of the rotation about a wheel that stands
_REPEATS_S, _LEAST_COUNT = 3.0, 5  # of one count, row after row; a smaller one may be steady
_CURE = "with tools/try_wheels.py"


def check_silent(times: FloatArray, ticks: IntArray, own: Bodies, wheels: Wheels) -> None:
    """Raise UserError where a wheel counts nothing while the robot's body (own) moves otherwise.

    times (n,) s; ticks (n, 2): left, right, counted from the start.
    """
    moved = moved_in_windows(times, ticks, own, wheels, _WINDOW_S, _STRIDE_S)
    ((number, body),) = moved.bodies.items()
    known = np.isfinite(body[:, 2])
    starts, ways, body = moved.starts[known], np.abs(moved.ways[known]), body[known]
    if not len(starts):
        return
    tick_m = math.tau * max(wheels.left_radius_m, wheels.right_radius_m) / wheels.counts_per_turn
    silent = ways < max(_SILENT_M, _SILENT_TICKS * tick_m)
    way, rotation = np.hypot(*body[:, :2].T), np.abs(body[:, 2])
    drives = way + 0.1 * rotation > _DRIVES_MPS * _WINDOW_S
    begin, end = longest(silent.all(axis=1) & drives)
    if starts[max(end - 1, 0)] - starts[begin] >= _NEITHER_S:
        raise UserError(
            f"neither wheel counts from {starts[begin]:.1f} s on while motion capture sees the "
            "robot drive",
            "both encoders are dead, the robot is pushed, or mocap.body is another robot",
            f"rotate the wheels by hand {_CURE}, and see body in [mocap]",
        )
    usual = np.array([-1.0, 1.0]) / wheels.track_m
    per_way = np.abs(held(moved.ways[known], moved.bodies[number][known, 2], usual))
    for wheel, side in enumerate(("left", "right")):
        parts = []
        for begin, end in runs(silent[:, wheel]):
            first, last = float(starts[begin]), float(starts[end - 1]) + _WINDOW_S
            inside = (starts >= first + _MARGIN_S) & (starts <= last - _MARGIN_S - _WINDOW_S)
            other = ways[inside, 1 - wheel]
            if last - first < _LEAST_S or not len(other):
                continue
            if other.mean() / _WINDOW_S * (last - first) < _LEAST_WAY_M:
                continue
            wide = way[inside].sum() > _WIDE * wheels.track_m * rotation[inside].sum()
            if wide or _otherwise(other, rotation[inside], per_way[1 - wheel], wheels.track_m):
                parts.append((first, last))
        if parts:
            raise _dead(side, parts, float(times[-1] - times[0]))


def _otherwise(other: FloatArray, rotation: FloatArray, per_way: float, track_m: float) -> bool:
    """Whether the robot rotates otherwise than about a wheel that stands, by the other's ways."""
    return all(
        np.abs(rotation - each * other).sum() > _OTHERWISE * each * other.sum()
        for each in (per_way, 1.0 / track_m)
    )


def _dead(side: str, parts: list[tuple[float, float]], whole_s: float) -> UserError:
    loose = "as with a loose plug" if len(parts) > 1 or parts[0][1] < whole_s - 1.0 else ""
    return UserError(
        f"the {side} encoder counts nothing {spans(parts, whole_s)}",
        "the other wheel counts meanwhile, and the robot does not rotate about this one"
        f"{loose and f': {loose}'}",
        f"check the {side} encoder's plug, supply and channels {_CURE}",
    )


def check_repeated(
    times: FloatArray, ticks: IntArray, starts: FloatArray, wrong: BoolArray, window_s: float
) -> None:
    """Raise UserError where a wheel repeats one count in all rows while the robot moves otherwise.

    times (n,), ticks (n, 2) as above; in windows that start at starts (w,) s after the first tick,
    wrong (w,) says whether the wheels contradict the tracked body.
    """
    steps = np.diff(ticks, axis=0)
    since = times - times[0]
    for wheel, side in enumerate(("left", "right")):
        repeats = (np.diff(steps[:, wheel]) == 0) & (np.abs(steps[1:, wheel]) >= _LEAST_COUNT)
        begin, end = longest(repeats)
        first, last = since[begin], since[end + 1]
        inside = (starts >= first) & (starts + window_s <= last)
        if (
            end - begin
            and last - first >= _REPEATS_S
            and inside.any()
            and wrong[inside].mean() > 0.5
        ):
            raise UserError(
                f"the {side} encoder repeats the count of {steps[begin, wheel]} in every row "
                f"{spans([(float(first), float(last))], float(since[-1]))}",
                "the robot moves otherwise meanwhile: the board or the file repeats an old reading",
                f"see whether its count follows the wheel {_CURE}, and record again",
            )
