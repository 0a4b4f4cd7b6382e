"""The noise of the odometry, from what a fitted geometry leaves: slip, and all else that adds up.

A random walk's squared error grows with what is driven, so that a slope is the noise, and what
motion capture adds at the ends of a window stands in the line's other constant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.robust.statistics import jackknife_sigma, normal_sigma
from host.calibration.wheels.fit import NOISE_FLOOR, OUTLIER, STRIDE_S, Fit, moving
from host.calibration.wheels.model import Drive, advance, misses, motions, path, windows_of
from host.messages import BoolArray, FloatArray, IntArray

_WINDOWS_S = (1.0, 2.0, 4.0, 8.0)
_BENT_RAD = 2.0  # rotated by more, an arc's chord says little of its length
_STRAIGHT_RAD = 0.1  # rotated by less, the drift of a window is observable
_LEAST_WINDOWS = 4
_PIECES = 8  # of the drives, each left out once
_DRIFT_SHARE = math.sqrt(0.1)  # of the heading's noise, where nothing was driven straight
_REST = 0.1  # of the squared error, left to the rotations at least


@dataclass(frozen=True, slots=True)
class Noise:
    """As in `config.Wheels`: distance (m), heading and drift (rad); sigmas (3,) of these.

    drift is nan where nothing was driven straight.
    """

    distance: float
    heading: float
    drift: float
    sigmas: FloatArray


@dataclass(frozen=True, slots=True)
class _Missed:
    """What windows (w,) of one length miss.

    pieces (w,): of the drives, 0 to 7. exposure (w, 2): way (m) and rotation (rad) driven.
    heading (w,) rad: missed; longer (w,) m: of the way. straight, open (w,): those in which the
    drift, and the way, are observable.
    """

    length_s: float
    pieces: IntArray
    exposure: FloatArray
    heading: FloatArray
    longer: FloatArray
    straight: BoolArray
    open: BoolArray


def noise(drives: Sequence[Drive], fitted: Fit) -> Noise:
    """Fit the three noises of `differential_drive.displacement`.

    That of the way from windows of 1 to 4 s, by its length alone, to which an error of the heading
    adds nothing; the drift from those that are straight; the heading's from 2 to 8 s, less drift.
    Their sigmas are a jackknife's, over eighths of the drives.
    """
    travelled = [_travelled(drive, fitted) for drive in drives]
    missed = [_missed(drives, fitted, travelled, length) for length in _WINDOWS_S]
    distance, heading, drift = _noises(missed, -1)
    others = np.array([_noises(missed, left_out) for left_out in range(_PIECES)])
    return Noise(distance, heading, drift, jackknife_sigma(others))


def _missed(
    drives: Sequence[Drive], fitted: Fit, travelled: Sequence[FloatArray], length_s: float
) -> _Missed:
    windows = windows_of(drives, length_s, STRIDE_S)
    windows = windows.where(moving(drives, windows))
    wrong = misses(drives, fitted.counts, fitted.values, windows)
    moved = motions(drives, windows)
    rotated = np.abs(moved[:, 2])
    longer = np.hypot(*(moved + wrong)[:, :2].T) - np.hypot(*moved[:, :2].T)
    count = len(windows)
    return _Missed(
        length_s,
        np.arange(count) * _PIECES // max(count, 1),
        advance(drives, travelled, windows),
        wrong[:, 2],
        longer / np.sinc(np.minimum(rotated, _BENT_RAD) / math.tau),  # arc over chord
        rotated < _STRAIGHT_RAD,
        rotated < _BENT_RAD,
    )


def _noises(missed: Sequence[_Missed], left_out: int) -> tuple[float, float, float]:
    """Distance, heading and drift from all windows but those of the piece `left_out`."""
    rotations, ways, drifts = [], [], []
    for of in missed:
        kept = of.pieces != left_out
        if np.count_nonzero(kept) < _LEAST_WINDOWS:
            continue
        straight, open_ = kept & of.straight, kept & of.open
        if np.count_nonzero(straight) >= _LEAST_WINDOWS:
            drifts.append(_growth(of.exposure[straight], of.heading[straight]))
        if of.length_s > _WINDOWS_S[0]:
            rotations.append(_growth(of.exposure[kept], of.heading[kept]))
        if of.length_s < _WINDOWS_S[-1] and np.count_nonzero(open_) >= _LEAST_WINDOWS:
            ways.append(_growth(of.exposure[open_], of.longer[open_]))
    drift2 = _slope([(metres, square) for metres, _, square in drifts])
    heading2 = _slope([_of_turns(point, drift2) for point in rotations])
    distance2 = _slope([(metres, square) for metres, _, square in ways])
    return math.sqrt(distance2), math.sqrt(heading2), math.sqrt(drift2)


def _of_turns(point: tuple[float, float, float], drift2: float) -> tuple[float, float]:
    """What of a growth (way, rotated, squared error) is for the rotations."""
    way, rotated, square = point
    if math.isnan(drift2):
        return rotated + _DRIFT_SHARE**2 * way, square
    return rotated, max(square - drift2 * way, _REST * square)


def _growth(exposure: FloatArray, wrong: FloatArray) -> tuple[float, float, float]:
    """Mean way and rotation and mean squared error of windows, without those far out."""
    sigma = max(normal_sigma(wrong), NOISE_FLOOR[0])
    good = np.abs(wrong) <= OUTLIER * sigma
    way, rotated = exposure[good].mean(axis=0)
    return float(way), float(rotated), float(np.mean(wrong[good] ** 2))


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
