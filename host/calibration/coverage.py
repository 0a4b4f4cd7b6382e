"""What of all directions and rotations a drive has, and what of its messages so far says that."""

import math

import numpy as np

from host.calibration.gathered import Gathered, Tracks
from host.geometry import wrap
from host.messages import FloatArray

DIRECTIONS = (
    "ahead",
    "ahead on the left",
    "on the left",
    "behind on the left",
    "behind",
    "behind on the right",
    "on the right",
    "ahead on the right",
)
_THINNED_S = 0.05  # motion capture is fast; for advice this will do


def missing_directions(bearings: FloatArray, least: int) -> list[str]:
    """Of the eight directions those with fewer than `least` of the bearings (n,) rad, as text."""
    known = np.asarray(wrap(bearings[np.isfinite(bearings)]))
    index = np.round(known / (math.tau / len(DIRECTIONS))).astype(int)
    counts = np.bincount(index % len(DIRECTIONS), minlength=len(DIRECTIONS))
    return [name for name, n in zip(DIRECTIONS, counts, strict=True) if n < least]


def missing_rotations(steps: FloatArray, least_rad: float) -> list[str]:
    """Which way a robot has not rotated enough, as an advice; steps (k,) rad, left is positive."""
    rotated = {"left": steps[steps > 0.0].sum(), "right": abs(steps[steps < 0.0].sum())}
    return [
        f"rotate to the {side} by {math.degrees(least_rad):.0f} deg: "
        f"{math.degrees(angle):.0f} so far"
        for side, angle in rotated.items()
        if angle < least_rad
    ]


def tracks_so_far(gathered: Gathered) -> Tracks:
    """The true paths of a drive that goes on, in steps that are good enough for advice.

    gathered: with frames of motion capture. Raises UserError where the robot was never seen.
    """
    frames = gathered.bodies
    a_second = (len(frames) - 1) / max(frames[-1].time - frames[0].time, 1e-9)
    return Tracks(frames[:: max(round(_THINNED_S * a_second), 1)], gathered.config.mocap)
