"""Slips of a tracker's file that time does not show: mirrored axes, headings of other kinds."""

import math

import numpy as np

from host.calibration.truth.rates import MOVING
from host.messages import FloatArray
from host.recording.elsewhere.named_columns import BodyPath

_STEP_S, _LEAST_STEP_M = 0.5, 0.03  # over which a course is taken
_LEAST_STEPS = 10
_ALIKE, _UNLIKE = 0.7, 0.4  # lengths of mean directions: one for all, and none
_UNIT_RATIO = 0.5  # of the logarithms of two factors that are one unit
_LEFT_HANDED = (
    "it rotates to the right where the wheels rotate the robot to the left",
    "reverse the signs of y and heading where the file's y-axis is to the right of x, as with z "
    "down; else left and right wheel are exchanged: exchange their plugs",
)


def frame_slip(path: BodyPath, wheels_rate: float, rate_factor: float) -> tuple[str, str] | None:
    """What is wrong with a file's axes or headings, and what to do; None where nothing is.

    wheels_rate (rad/s): how fast the robot rotates by its wheels, on average, either way.
    rate_factor: the file's rotation over that of the wheels; nan where that is not known.
    """
    heading = path.poses[:, 2]
    if wheels_rate > MOVING[1] and np.ptp(np.unwrap(heading)) < MOVING[1]:
        return (
            "its heading stays the same while the wheels rotate the robot",
            "see that the column called heading is it, and of this body",
        )
    # Degrees taken for radians seem to jump; undo that by their own period.
    jumps = np.abs(np.mod(np.diff(heading) + 180.0, 360.0) - 180.0)
    factor = float(jumps.sum() / np.diff(path.times).sum()) / max(wheels_rate, 1e-9)
    if abs(math.log(max(factor, 1e-9) * math.pi / 180.0)) < _UNIT_RATIO:
        return (
            f"its rotation is {factor:.3g} times that of the wheels",
            "it looks like degrees: say the file's units with --truth-units",
        )
    if not _mirrored(path):
        return _LEFT_HANDED if rate_factor < 0.0 else None
    if rate_factor < 0.0:
        return (
            "its headings count clockwise, as a compass does, its places do not",
            "give headings that count counter-clockwise from the x-axis: 90 deg less those of a "
            "compass",
        )
    return (
        "its places are mirrored: its path bends the other way than its heading rotates",
        "exchange the columns x and y, or reverse the sign of one: y is to the left of x",
    )


def _mirrored(path: BodyPath) -> bool:
    """Whether the course changes against the heading, instead of with it."""
    count = int((path.times[-1] - path.times[0]) / _STEP_S)
    times = path.times[0] + _STEP_S * np.arange(count + 1)
    x, y, heading = (
        np.interp(times, path.times, column)
        for column in (*path.poses[:, :2].T, np.unwrap(path.poses[:, 2]))
    )
    way = np.diff(x) + 1j * np.diff(y)
    went = np.abs(way) > _LEAST_STEP_M
    if np.count_nonzero(went) < _LEAST_STEPS:
        return False
    middle = 0.5 * (heading[1:] + heading[:-1])[went]
    course = np.angle(way[went])
    return _agreement(course + middle) > _ALIKE and _agreement(course - middle) < _UNLIKE


def _agreement(angles: FloatArray) -> float:
    """How much angles (n,) are one, 0 to 1; a robot that backs is as one that goes ahead."""
    return float(np.abs(np.mean(np.exp(2j * angles))))
