"""How wheels and bodies move in windows of two seconds, which do not ask where the body sits."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from host.calibration.wheels.model import relative
from host.config import Wheels
from host.messages import BoolArray, FloatArray, IntArray

WINDOW_S, STRIDE_S = 2.0, 0.5
_GAP_S = 0.15  # longer ones hide what happened

Bodies = Mapping[int, tuple[FloatArray, FloatArray]]
"""Times (n,) s and poses (n, 3), headings not wrapped, of each body by its number."""


@dataclass(frozen=True, slots=True)
class Moved:
    """In windows of length_s that start at times (w,) s after the first tick: the ways (w, 2) m of
    both wheels, and by body number how it moved (w, 3): along and across its x-axis (m), rotation
    (rad); nan where not seen."""

    length_s: float
    starts: FloatArray
    ways: FloatArray
    bodies: dict[int, FloatArray]


def moved_in_windows(
    times: FloatArray,
    ticks: IntArray,
    bodies: Bodies,
    wheels: Wheels,
    length_s: float = WINDOW_S,
    stride_s: float = STRIDE_S,
) -> Moved:
    """Windows of a drive: times (n,) s, ticks (n, 2) counted from the start."""
    starts = np.arange(times[0], times[-1] - length_s, stride_s) if len(times) else np.zeros(0)
    radii = np.array([wheels.left_radius_m, wheels.right_radius_m])
    metres = math.tau / wheels.counts_per_turn * radii
    first, last = (_at(times, ticks * metres, starts + late) for late in (0.0, length_s))
    whole = np.isfinite(last - first).all(axis=1)
    starts, ways = starts[whole], (last - first)[whole]
    found = {}
    for number, (seen, poses) in bodies.items():
        begin, end = (_at(seen, poses, starts + late) for late in (0.0, length_s))
        found[number] = relative(begin, end)
    return Moved(length_s, starts - times[0] if len(times) else starts, ways, found)


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


def runs(chosen: BoolArray) -> Iterator[tuple[int, int]]:
    """Begin and end of each run of chosen (w,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], chosen.astype(int), [0]))))
    yield from ((int(begin), int(end)) for begin, end in edges.reshape(-1, 2))


def longest(chosen: BoolArray) -> tuple[int, int]:
    """Begin and end of the longest run of chosen (w,)."""
    return max(runs(chosen), key=lambda run: run[1] - run[0], default=(0, 0))


def spans(parts: list[tuple[float, float]], whole_s: float) -> str:
    """Parts of a drive of whole_s, each from when to when (s), in words."""
    if parts[0][0] < 1.0 and parts[0][1] > whole_s - 1.0:
        return "in the whole drive"
    words = [
        f"from {begin:.1f} s on" if end > whole_s - 1.0 else f"from {begin:.1f} to {end:.1f} s"
        for begin, end in parts
    ]
    if len(words) > 4:
        words[3:] = [f"{len(words) - 3} times more"]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
