"""Encoders that count a wheel's way without its direction: forward, too, where it goes backward.

How a body moves in a short window is a linear function of both wheels' ways, wherever it sits on
the robot. Fitted to all windows and inverted, that function says which way each wheel went.
"""

from collections.abc import Sequence

import numpy as np

from host.calibration.identity.windows import Bodies, Moved, moved_in_windows, runs, spans
from host.config import Wheels
from host.errors import UserError
from host.messages import BoolArray, FloatArray, IntArray

_WINDOW_S, _STRIDE_S = 0.4, 0.1
_LEAST_WINDOWS = 4  # in a row, in which a wheel goes backward
_LEAST_WAY_M = 0.015  # counted in a window: less may be slip
_MOST_DOWN = 0.005  # of the steps of a counter that does not count down: noise
_WRONG = 0.35  # of a way: by how much it may be off
_MOST_MISSED = 0.2  # of how the body moves, in most windows
_PASSES, _LEAST_MISS = 15, 1e-3  # of a fit by least absolute deviations


def check_one_way(
    times: FloatArray,
    ticks: IntArray,
    own: Bodies,
    wheels: Wheels,
    wrong: Sequence[tuple[float, float]],
) -> None:
    """Raise UserError where a wheel counts forward while it goes backward, by the robot's body.

    times (n,) s; ticks (n, 2): left, right, counted from the start; own: that body alone. wrong:
    from when to when (s) wheels are known to contradict it. An encoder that counts down at times
    has directions.
    """
    steps = np.diff(ticks, axis=0)
    upward = np.sum(steps < 0, axis=0) <= _MOST_DOWN * np.sum(steps != 0, axis=0)
    if not upward.any():
        return
    moved = moved_in_windows(times, ticks, own, wheels, _WINDOW_S, _STRIDE_S)
    back = _goes_back(moved, wrong) & upward
    for one in back.T:
        for begin, end in runs(one):
            one[begin:end] &= end - begin >= _LEAST_WINDOWS
    sides = [side for side, one in zip(("left", "right"), back.T, strict=True) if one.any()]
    if not sides:
        return
    parts: list[tuple[float, float]] = []
    for begin, end in runs(back.any(axis=1)):
        first, last = float(moved.starts[begin]), float(moved.starts[end - 1]) + _WINDOW_S
        if parts and first <= parts[-1][1]:
            first, _ = parts.pop()
        parts.append((first, last))
    raise _without_direction(sides, spans(parts, float(times[-1] - times[0])))


def _without_direction(sides: Sequence[str], when: str) -> UserError:
    who = (
        f"the {sides[0]} encoder counts forward while its wheel goes"
        if len(sides) == 1
        else "both encoders count forward while their wheels go"
    )
    return UserError(
        f"{who} backward {when}",
        "nothing is counted backward in the whole drive: steps are counted without a direction, as "
        "with one channel only",
        "check the wires of both channels with tools/try_wheels.py, and record again",
    )


def _goes_back(moved: Moved, wrong: Sequence[tuple[float, float]]) -> BoolArray:
    """In which windows each of the wheels (w, 2) goes back as far as it counts forward."""
    (body,) = moved.bodies.values()
    known = np.isfinite(body).all(axis=1)
    sound = known.copy()
    for begin, end in wrong:
        sound &= (moved.starts + _WINDOW_S < begin) | (moved.starts > end)
    back = np.zeros(moved.ways.shape, dtype=bool)
    ways, motions, weights = moved.ways[sound], body[sound], np.ones((sound.sum(), 1))
    if not len(ways) or np.linalg.matrix_rank(ways) < 2:  # older numpy: no rank of no rows
        return back
    for _ in range(_PASSES):
        by_ways = np.linalg.lstsq(ways * weights, motions * weights, rcond=None)[0]
        missed = np.linalg.norm(motions - ways @ by_ways, axis=1, keepdims=True)
        weights = 1.0 / np.sqrt(np.maximum(missed, _LEAST_MISS))
    if np.median(missed) > _MOST_MISSED * np.median(np.linalg.norm(motions, axis=1)):
        return back  # another robot's body, which is seen elsewhere
    counted, went = moved.ways[known], body[known] @ np.linalg.pinv(by_ways)
    back[known] = (counted > _LEAST_WAY_M) & (np.abs(went + counted) < _WRONG * counted)
    return back
