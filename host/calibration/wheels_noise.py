"""The noise of the odometry, from what a fitted geometry leaves: slip, and all else that adds up.

A random walk's squared error grows with what is driven, so that a slope is the noise, and what
motion capture adds at the ends of a window stands in the line's other constant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.wheels_fit import LEAST, OUTLIER, OWN, STRIDE_S, Fit, moving
from host.calibration.wheels_model import (
    Drive,
    advance,
    misses,
    motions,
    path,
    windows_of,
)
from host.messages import FloatArray

_WINDOWS_S = (1.0, 2.0, 4.0, 8.0)
_BENT_RAD = 2.0  # turned by more, an arc's chord tells little of its length
_STRAIGHT_RAD = 0.1  # turned by less, a window tells of the drift
_LEAST_WINDOWS = 4
_DRIFT_SHARE = math.sqrt(0.1)  # of the heading's noise, where nothing was driven straight
_REST = 0.1  # of the squared error, left to the turns at least


@dataclass(frozen=True, slots=True)
class Noise:
    """As in `config.Wheels`: distance (m), heading and drift (rad); their relative sigma.

    drift is nan where nothing was driven straight.
    """

    distance: float
    heading: float
    drift: float
    relative_sigma: float


def noise(drives: Sequence[Drive], fitted: Fit) -> Noise:
    """Fit the three noises of `differential_drive.displacement`.

    That of the way from windows of 1 to 4 s, by its length alone, to which an error of the heading
    adds nothing; the drift from those that are straight; the heading's from 2 to 8 s, less drift.
    """
    travelled = [_travelled(drive, fitted) for drive in drives]
    turns, ways, drifts = [], [], []
    for length in _WINDOWS_S:
        windows = windows_of(drives, length, STRIDE_S)
        windows = windows.where(moving(drives, windows))
        if len(windows) < _LEAST_WINDOWS:
            continue
        wrong = misses(drives, fitted.counts, fitted.values, windows)
        moved = motions(drives, windows)
        exposure = advance(drives, travelled, windows)
        turned = np.abs(moved[:, 2])
        straight = turned < _STRAIGHT_RAD
        if np.count_nonzero(straight) >= _LEAST_WINDOWS:
            drifts.append(_growth(exposure[straight], wrong[straight, 2]))
        if length > _WINDOWS_S[0]:
            turns.append(_growth(exposure, wrong[:, 2]))
        nearly_straight = turned < _BENT_RAD
        if length < _WINDOWS_S[-1] and np.count_nonzero(nearly_straight) >= _LEAST_WINDOWS:
            chord = np.hypot(*moved[:, :2].T)
            longer = np.hypot(*(moved + wrong)[:, :2].T) - chord
            longer /= np.sinc(moved[:, 2] / math.tau)  # arc over chord
            ways.append(_growth(exposure[nearly_straight], longer[nearly_straight]))
    drift2 = _slope([(metres, square) for metres, _, square in drifts])
    heading2 = _slope([_of_turns(point, drift2) for point in turns])
    independent = max(OWN * np.count_nonzero(fitted.used), 1.0)
    return Noise(
        distance=math.sqrt(_slope([(metres, square) for metres, _, square in ways])),
        heading=math.sqrt(heading2),
        drift=math.sqrt(drift2),
        relative_sigma=1.0 / math.sqrt(2.0 * independent),
    )


def _of_turns(point: tuple[float, float, float], drift2: float) -> tuple[float, float]:
    """What of a growth (way, turned, squared error) is for the turns."""
    way, turned, square = point
    if math.isnan(drift2):
        return turned + _DRIFT_SHARE**2 * way, square
    return turned, max(square - drift2 * way, _REST * square)


def _growth(exposure: FloatArray, wrong: FloatArray) -> tuple[float, float, float]:
    """Mean way and turn and mean squared error of windows, without those far out."""
    sigma = max(1.4826 * float(np.median(np.abs(wrong))), LEAST[0])
    good = np.abs(wrong) <= OUTLIER * sigma
    way, turned = exposure[good].mean(axis=0)
    return float(way), float(turned), float(np.mean(wrong[good] ** 2))


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
    """Way (m) and turned angle (rad) since the start of a drive (n, 2), without sign."""
    steps = np.diff(path(drive, fitted.counts, fitted.values), axis=0, prepend=np.zeros((1, 3)))
    way = np.hypot(steps[:, 0], steps[:, 1])
    return np.cumsum(np.stack((way, np.abs(steps[:, 2])), axis=1), axis=0)
