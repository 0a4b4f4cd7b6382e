"""The noise of the odometry, from what a fitted geometry leaves: slip, and all else that adds up.

A random walk's squared error grows with what is driven, so that a slope is the noise, and what
motion capture adds at the ends of a window stands in the line's other constant.
"""

import math
from collections.abc import Sequence

import numpy as np

from host.calibration.robust.statistics import jackknife_sigma, normal_sigma
from host.calibration.wheels.fit import NOISE_FLOOR, OUTLIER, STRIDE_S, Fit
from host.calibration.wheels.model import Drive, at_ends, misses, path, windows_of
from host.messages import FloatArray

_WINDOWS_S = (1.0, 2.0, 4.0, 8.0)
_BENT_RAD = 2.0  # rotated by more, an arc's chord says little of its length
_STRAIGHT_RAD = 0.1  # rotated by less, the drift of a window is observable
_LEAST_WINDOWS = 4
_PIECES = 8  # of the drives, each left out once
_DRIFT_SHARE = math.sqrt(0.1)  # of the heading's noise, where nothing was driven straight
_REST = 0.1  # of the squared error, left to the rotations at least


def noise(drives: Sequence[Drive], fitted: Fit) -> tuple[FloatArray, FloatArray]:
    """Fit the three noises of `differential_drive.displacement`, with their sigmas: (3,) each.

    Distance (m), heading and drift (rad) as in `config.Wheels`; drift is nan where nothing was
    driven straight. That of the way is from windows of 1 to 4 s, by its length alone, to which an
    error of the heading adds nothing; the drift from those that are straight; the heading's from
    2 to 8 s, less drift. Their sigmas are a jackknife's, over eighths of the drives.
    """
    travelled = [_travelled(drive, fitted) for drive in drives]
    tables = [_missed(drives, fitted, travelled, length) for length in _WINDOWS_S]
    ways, rotations, straight = zip(*tables, strict=True)
    kinds = ways[:-1], rotations[1:], straight
    others = [_noises(kinds, left_out) for left_out in range(_PIECES)]
    return _noises(kinds, -1), jackknife_sigma(np.array(others))


def _missed(
    drives: Sequence[Drive], fitted: Fit, travelled: Sequence[FloatArray], length_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What windows of one length miss: rows of piece of the drives, way, rotation, and error.

    The error is of the way (m) where that is observable; of the heading (rad); and of the heading
    where its drift is observable.
    """
    windows = windows_of(drives, length_s, STRIDE_S)
    windows = windows.where(windows.moving)
    wrong = misses(drives, fitted.counts, fitted.values, windows)
    moved, rotated = windows.moved, np.abs(windows.moved[:, 2])
    longer = np.hypot(*(moved + wrong)[:, :2].T) - np.hypot(*moved[:, :2].T)
    longer /= np.sinc(np.minimum(rotated, _BENT_RAD) / math.tau)  # arc over chord
    first, last = at_ends(drives, travelled, windows, np.zeros((len(drives), 2)))
    pieces = np.arange(len(windows)) * _PIECES // max(len(windows), 1)
    ways, headings = (np.column_stack((pieces, last - first, e)) for e in (longer, wrong[:, 2]))
    return ways[rotated < _BENT_RAD], headings, headings[rotated < _STRAIGHT_RAD]


def _noises(kinds: Sequence[Sequence[FloatArray]], left_out: int) -> FloatArray:
    """Distance, heading and drift (3,) from all windows but those of the piece `left_out`."""
    kept = [[rows[rows[:, 0] != left_out, 1:] for rows in kind] for kind in kinds]
    ways, rotations, drifts = (
        [_growth(rows) for rows in kind if len(rows) >= _LEAST_WINDOWS] for kind in kept
    )
    drift2 = _slope([(metres, square) for metres, _, square in drifts])
    heading2 = _slope([_of_turns(point, drift2) for point in rotations])
    distance2 = _slope([(metres, square) for metres, _, square in ways])
    return np.sqrt([distance2, heading2, drift2])


def _of_turns(point: tuple[float, float, float], drift2: float) -> tuple[float, float]:
    """What of a growth (way, rotated, squared error) is for the rotations."""
    way, rotated, square = point
    if math.isnan(drift2):
        return rotated + _DRIFT_SHARE**2 * way, square
    return rotated, max(square - drift2 * way, _REST * square)


def _growth(rows: FloatArray) -> tuple[float, float, float]:
    """Mean way and rotation and mean squared error of windows (w, 3), without those far out."""
    error = np.abs(rows[:, 2])
    good = rows[error <= OUTLIER * max(normal_sigma(error), NOISE_FLOOR[0])]
    way, rotated = good[:, :2].mean(axis=0)
    return float(way), float(rotated), float(np.mean(good[:, 2] ** 2))


def _slope(points: Sequence[tuple[float, float]]) -> float:
    """Slope, not below zero, of the line through points (x, y) of equal relative error in y; nan.

    At x = 0 it may be below zero: slip that lasts a while adds little to short ways.
    """
    if len(points) < 2:
        return math.nan
    x, y = np.array(points).T
    design = np.stack((1.0 / y, x / y), axis=1)
    return max(float(np.linalg.lstsq(design, np.ones(len(y)), rcond=None)[0][1]), 0.0)


def _travelled(drive: Drive, fitted: Fit) -> FloatArray:
    """Way (m) and rotated angle (rad) since the start of a drive (n, 2), without sign."""
    steps = np.diff(path(drive, fitted.counts, fitted.values), axis=0, prepend=np.zeros((1, 3)))
    way = np.hypot(steps[:, 0], steps[:, 1])
    return np.cumsum(np.stack((way, np.abs(steps[:, 2])), axis=1), axis=0)
