"""Is the tracked body this robot, and do its wheels count as they are thought to?

Over windows of two seconds, the rotation that the wheels should give is compared with that of every
body seen, up to a factor: geometry need not be known. Encoders that count the wrong way, or are
exchanged, give the body's rotation by another combination of both wheels' ways.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from host.calibration.wheels.model import relative
from host.config import Mocap, Wheels
from host.errors import UserError
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, IntArray

_WINDOW_S, _STRIDE_S, _GAP_S = 2.0, 0.5, 0.15
_LEAST_WINDOWS = 12
_STILL_M, _STILL_RAD = 0.01, 0.03  # in a window
_DRIVEN_M = 1.0  # by the wheels, before a body that stands still is noticed
_LEAST_ROTATION_RAD = 0.15  # rms in a window: less does not show who is who
_ABSURD = 5.0  # times the 90 % percentile of rotations
_FITS, _FAILS = 0.85, 0.6  # share of the squared rotation that is explained
_FACTORS = (0.2, 5.0)  # by which the geometry may be off
_LEAST_EXCHANGED = 0.1  # of the windows
_EDGE_WINDOWS = 5  # at an exchange, in which a body jumps from one robot to the other
_LEAST_CHANGE = 1.3  # of what a wheel counts for the same way
_DEAD_S, _SILENT_M, _DRIVES_M = 6.0, 0.001, 0.04  # of a wheel, in a window
_SETTINGS = "left_encoder_reversed, right_encoder_reversed in [motors] of robot.toml"
# What becomes of the ways of the left and the right wheel, and what that says.
_WIRINGS = {
    "the left encoder counts the wrong way round": ((-1.0, 0.0), (0.0, 1.0)),
    "the right encoder counts the wrong way round": ((1.0, 0.0), (0.0, -1.0)),
    "left and right wheel are exchanged": ((0.0, 1.0), (1.0, 0.0)),
}

Bodies = Mapping[int, tuple[FloatArray, FloatArray]]
"""Times (n,) s and poses (n, 3), headings not wrapped, of each body by its number."""


@dataclass(frozen=True, slots=True)
class _Moved:
    """In windows that start at times (w,) s: the ways (w, 2) m of both wheels, and by body number
    how it moved (w, 3): along and across its x-axis (m), rotation (rad); nan where not seen."""

    starts: FloatArray
    ways: FloatArray
    bodies: dict[int, FloatArray]

    def rotation(self, track_m: float) -> FloatArray:
        """(w,) rad by the wheels."""
        return np.asarray((self.ways[:, 1] - self.ways[:, 0]) / track_m)


def check_identity(
    times: FloatArray, ticks: IntArray, bodies: Bodies, wheels: Wheels, mocap: Mocap
) -> None:
    """Raise UserError where the body in `mocap` does not move as the wheels do, and say why.

    times (n,) s; ticks (n, 2): left, right, counted from the start. What cannot be judged passes:
    a drive too short, without rotation, or with a body that is not seen.
    """
    moved = _windows(times, ticks, bodies, wheels)
    if not len(moved.starts):
        return
    own = moved.bodies.get(mocap.body)
    if own is None or np.count_nonzero(np.isfinite(own[:, 2])) < _LEAST_WINDOWS:
        return
    turned = moved.rotation(wheels.track_m)
    explained = {number: _explained(turned, rows[:, 2]) for number, rows in moved.bodies.items()}
    best = max(explained, key=lambda number: explained[number])
    other = best if explained[best] >= _FITS and best != mocap.body else None
    _check_dead(moved, own, turned)
    if explained[mocap.body] < _FITS:
        _check_exchanged(moved, turned, mocap.body)
    _check_still(moved, own, mocap.body, other)
    if explained[mocap.body] < _FITS and other is None:
        _check_counting(moved, own)
    if explained[mocap.body] < _FAILS:
        if other is not None:
            raise _other_body(mocap.body, other)
        _check_wiring(moved, own, wheels, mocap)


def _windows(times: FloatArray, ticks: IntArray, bodies: Bodies, wheels: Wheels) -> _Moved:
    starts = np.arange(times[0], times[-1] - _WINDOW_S, _STRIDE_S) if len(times) else np.zeros(0)
    metres = (
        math.tau / wheels.counts_per_turn * np.array([wheels.left_radius_m, wheels.right_radius_m])
    )
    first, last = (_at(times, ticks * metres, starts + late) for late in (0.0, _WINDOW_S))
    whole = np.isfinite(last - first).all(axis=1)
    starts, ways = starts[whole], (last - first)[whole]
    found = {}
    for number, (seen, poses) in bodies.items():
        begin, end = (_at(seen, poses, starts + late) for late in (0.0, _WINDOW_S))
        found[number] = relative(begin, end)
    return _Moved(starts, ways, found)


def _at(times: FloatArray, rows: FloatArray, when: FloatArray) -> FloatArray:
    """Rows (n, c), known at `times` (n,), at `when` (k,): nan outside and in gaps."""
    if not len(times):
        return np.full((len(when), rows.shape[1]), math.nan)
    after = np.clip(np.searchsorted(times, when), 1, max(len(times) - 1, 1)).clip(
        max=len(times) - 1
    )
    found = np.stack([np.interp(when, times, column) for column in rows.T], axis=1)
    gap = times[after] - times[np.maximum(after - 1, 0)] > _GAP_S
    found[(when < times[0]) | (when > times[-1]) | gap] = math.nan
    return found


def _explained(by_wheels: FloatArray, rotation: FloatArray) -> float:
    """Share of the squared rotation (w,) that the wheels explain; nan where there is too little."""
    known = np.isfinite(rotation)
    # A corrupt row of ticks is in some windows only.
    known &= np.abs(by_wheels) <= _ABSURD * float(np.percentile(np.abs(by_wheels), 90.0, axis=0))
    a, b = by_wheels[known], rotation[known]
    if len(b) < _LEAST_WINDOWS or math.sqrt(np.mean(np.maximum(a**2, b**2))) < _LEAST_ROTATION_RAD:
        return math.nan
    factor = float(np.clip(a @ b / max(float(a @ a), 1e-12), *_FACTORS))
    return 1.0 - float(np.sum((b - factor * a) ** 2)) / max(float(b @ b), 1e-12)


def _check_dead(moved: _Moved, own: FloatArray, turned: FloatArray) -> None:
    """Raise where a wheel counts nothing for a while in which the body moves otherwise."""
    drives = np.hypot(own[:, 0], own[:, 1]) + 0.1 * np.abs(own[:, 2]) > _DRIVES_M
    silent = np.abs(moved.ways) < _SILENT_M
    if _longest(silent.all(axis=1) & drives)[0] * _STRIDE_S >= _DEAD_S:
        raise UserError(
            "neither wheel counts while motion capture sees the robot drive",
            "both encoders are dead, the robot is pushed, or mocap.body is another robot",
            "rotate the wheels by hand with tools/try_wheels.py, and see body in [mocap]",
        )
    for wheel, side in ((0, "left"), (1, "right")):
        still = silent[:, wheel] & (np.abs(moved.ways[:, 1 - wheel]) > _DRIVES_M) & drives
        length, begin = _longest(still)
        part = slice(begin, begin + length)
        wrong = np.abs(own[part, 2] - turned[part]) > 0.5 * np.abs(turned[part])
        if length * _STRIDE_S >= _DEAD_S and np.mean(wrong) > 0.5:
            raise UserError(
                f"the {side} encoder counts nothing from {moved.starts[begin]:.1f} s on for "
                f"{length * _STRIDE_S:.0f} s",
                "the other wheel counts meanwhile, and the robot does not rotate about this one",
                f"check the {side} encoder's plug, supply and channels with tools/try_wheels.py",
            )


def _longest(chosen: BoolArray) -> tuple[int, int]:
    """Length and begin of the longest run of chosen (w,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], chosen.astype(int), [0]))))
    if not len(edges):
        return 0, 0
    runs = edges.reshape(-1, 2)
    longest = int(np.argmax(runs[:, 1] - runs[:, 0]))
    return int(runs[longest, 1] - runs[longest, 0]), int(runs[longest, 0])


def _check_still(moved: _Moved, own: FloatArray, body: int, other: int | None) -> None:
    """Raise where the body stands still, from some time on, while the wheels drive."""
    driven = np.abs(moved.ways).mean(axis=1)
    still = (np.hypot(own[:, 0], own[:, 1]) < _STILL_M) & (np.abs(own[:, 2]) < _STILL_RAD)
    length, begin = _longest(still & (driven > _STILL_M))
    way = float(driven[begin : begin + length].sum()) * _STRIDE_S / _WINDOW_S
    if way < _DRIVEN_M:
        return
    if other is not None:
        raise _other_body(body, other)
    raise UserError(
        f"body {body} stands still while the wheels drive {way:.1f} m, from "
        f"{moved.starts[begin]:.1f} s on",
        "motion capture takes something else for this robot or repeats its last pose, or the "
        "wheels run in the air",
        "set body in [mocap] of robot.toml to the number of the body on this robot",
    )


def _other_body(body: int, other: int) -> UserError:
    return UserError(
        f"body {other} moves as these wheels do; robot.toml says {body}",
        f"body {body} rotates otherwise",
        f"set body = {other} in [mocap] of robot.toml",
    )


def _check_exchanged(moved: _Moved, turned: FloatArray, body: int) -> None:
    """Raise where the wheels move as the body for a part of the drive, then as another."""
    own = moved.bodies[body][:, 2]
    for number, rows in moved.bodies.items():
        known = np.isfinite(own) & np.isfinite(rows[:, 2])
        if number == body or np.count_nonzero(known) < _LEAST_WINDOWS:
            continue
        ours, theirs, wheels = own[known], rows[known, 2], turned[known]
        begin, end = _nearer(theirs, ours, wheels)
        row = np.arange(len(wheels))
        inside = (row >= begin) & (row < end)
        clear = np.abs(row[:, None] - (begin - 0.5, end - 0.5)).min(axis=1) > _EDGE_WINDOWS
        if all(
            np.mean(part) > _LEAST_EXCHANGED and _explained(wheels[part], rotated[part]) >= _FITS
            for part, rotated in ((inside & clear, theirs), (~inside & clear, ours))
        ):
            first = moved.starts[known][begin or end] + 0.5 * _WINDOW_S
            raise UserError(
                f"bodies {body} and {number} change places at about {first:.1f} s",
                "before, one of them moves as these wheels do, and afterwards the other",
                "give the bodies marker patterns that differ, and record again; or use what is "
                "before and after as two recordings",
            )


def _check_counting(moved: _Moved, own: FloatArray) -> None:
    """Raise where a wheel counts more or less for the same way from some time on."""
    whole = np.abs(moved.ways).max(axis=1)
    known = np.isfinite(own[:, 2]) & (whole <= _ABSURD * np.percentile(whole, 90.0))
    ways, rotation, starts = moved.ways[known], own[known, 2], moved.starts[known]
    least = max(_LEAST_WINDOWS, len(ways) // 5)
    if len(ways) < 2 * least:
        return
    splits = [
        [np.linalg.lstsq(ways[part], rotation[part], rcond=None) for part in parts]
        for parts in ((slice(k), slice(k, None)) for k in range(least, len(ways) - least))
    ]
    left = [sum(float(fit[1].sum()) for fit in fits) for fits in splits]
    at = int(np.argmin(left))
    before, after = (fit[0] for fit in splits[at])
    ratios = before / after
    wheel = int(np.argmax(np.where(ratios < 0.0, math.inf, np.abs(np.log(np.abs(ratios))))))
    if 1.0 - left[at] / max(float(rotation @ rotation), 1e-12) < _FITS or (
        1.0 / _LEAST_CHANGE < ratios[wheel] < _LEAST_CHANGE
    ):
        return
    side = ("left", "right")[wheel]
    when = starts[at + least] + 0.5 * _WINDOW_S
    raise UserError(
        f"from {when:.0f} s on the {side} encoder counts {ratios[wheel]:.2g} times as much for the "
        "same way as before",
        "it loses counts or its direction, as by a loose plug, or the wheel slips",
        f"check the {side} encoder's plug, supply and channels with tools/try_wheels.py",
    )


def _nearer(theirs: FloatArray, ours: FloatArray, wheels: FloatArray) -> tuple[int, int]:
    """Begin and end of the windows in which `theirs` (w,) is nearest to `wheels` against `ours`."""
    gain = np.cumsum([0.0, *((ours - wheels) ** 2 - (theirs - wheels) ** 2)])
    end = int(np.argmax(gain - np.minimum.accumulate(gain)))
    return int(np.argmin(gain[: end + 1])), end


def _check_wiring(moved: _Moved, own: FloatArray, wheels: Wheels, mocap: Mocap) -> None:
    for words, matrix in _WIRINGS.items():
        ways = moved.ways @ np.array(matrix).T
        if _explained((ways[:, 1] - ways[:, 0]) / wheels.track_m, own[:, 2]) < _FITS:
            continue
        cure = f"set {_SETTINGS}"
        if "exchanged" in words:
            # Both reversed rotate likewise, but drive backwards, by how the body is said to lie.
            forward = ways.mean(axis=1)
            known = np.isfinite(own[:, 2]) & (np.abs(own[:, 2]) < 0.5)
            seen = math.atan2(forward[known] @ own[known, 1], forward[known] @ own[known, 0])
            if abs(float(wrap(seen + mocap.heading_rad))) > math.pi / 2.0:
                words = "both encoders count the wrong way round"
            words += " (if the tracked body's x-axis points as heading_rad in [mocap] says)"
            cure = f"exchange the plugs of the encoders or motors, or set {_SETTINGS}"
        raise UserError("the wheels' encoders do not fit the true path", words, cure)
