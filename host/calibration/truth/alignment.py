"""When a tracker's file was recorded, on the robot's clock: by how the robot drove and rotated.

Both the wheels and the tracker have how fast the robot went and rotated, each by its own clock. The
offset between the clocks is the one at which the two agree: searched over all of them by
correlation, then fitted together with the drift of the clocks. Rates do not depend on where the
tracked body lies on the robot (speeds do a little), and both are compared up to a factor, since
neither the wheels nor the file's units need be right.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from host.calibration.robust.statistics import (
    bent_factor,
    block_sums,
    blocks_of,
    normal_sigma,
    sandwich,
)
from host.calibration.truth.clock import (
    LEAST_EXPLAINED,
    ClockAlignment,
    check_alignment,
    check_times,
    refused,
)
from host.calibration.truth.frame import frame_slip
from host.calibration.truth.rates import (
    LEAST_OVERLAP_S,
    MOVING,
    Rates,
    search,
)
from host.messages import FloatArray
from host.recording.elsewhere.named_columns import BodyPath

_BLOCK_S = 3.0
_DRIFTS = np.arange(-0.03, 0.0301, 0.005)  # that are searched: nominal times of rows may be 2 % off
_STEPS = np.array([0.02, 1e-3, 0.02, 0.02])  # changes that count
_SLOPE_S = 0.02  # half of the interval over which a slope is taken
_SINGULAR = 1e-10
_SOFT = 2.0  # sigmas: trusted less from here on
_NOISE_FLOOR = np.array([1e-3, 2e-3])
_PART_S, _LEAST_INFORMATION = 10.0, 0.1  # of a part that shows an offset of its own
_LEAP_SIGMAS = 2.0  # of a change of the offset; recorded drives stay below 0.7 ...
_CORRELATED = 20.0  # ... where so many errors are alike, those of a second


def align_clocks(path: BodyPath, by_wheels: BodyPath) -> ClockAlignment:
    """Find when, by the clock of `by_wheels`, the robot went the path of the tracked body.

    Raises UserError where both do not move alike, or move so that several offsets fit as well.
    """
    tracked, wheels = (
        _moving_rates(path, moved, who)
        for moved, who in (
            (path, f"body {path.name}".rstrip()),
            (by_wheels, "the robot, by its wheels,"),
        )
    )
    seen = tracked.at(tracked.grid())
    found = max((search(seen, wheels, drift) for drift in _DRIFTS), key=lambda fit: fit.gain.max())
    first, begin, lag = wheels.grid()[0], tracked.grid()[0], found.best

    def host(times: FloatArray) -> FloatArray:
        return np.asarray(first + (1.0 + found.drift) * (times - begin + lag))

    result = _refine(tracked, wheels, host)
    rate = float(np.nanmean(np.abs(wheels.at(wheels.grid())[:, 1])))
    if result.explained[0] >= LEAST_EXPLAINED:  # else it is another drive's
        known = result.explained[1] >= LEAST_EXPLAINED
        slip = frame_slip(path, rate, result.factors[1] if known else math.nan)
        if slip is not None:
            raise refused(path, *slip)
    check_alignment(path, result, float(np.ptp(found.alike)))
    return result


def _moving_rates(path: BodyPath, moved: BodyPath, who: str) -> Rates:
    check_times(path, moved, who)
    if not len(moved.times):
        raise refused(
            path,
            f"{who} has no pose at all",
            "it was lost in every row, or the rows have no orientation, as quaternions of zeros",
        )
    if len(moved.times) < 2 or moved.times[-1] - moved.times[0] < LEAST_OVERLAP_S:
        raise refused(path, f"{who} was seen for less than {LEAST_OVERLAP_S:.0f} s")
    rates = Rates(moved)
    sizes = np.sqrt(np.nanmean(rates.at(rates.grid()) ** 2, axis=0))
    if not np.any(sizes > MOVING):
        raise refused(path, f"{who} hardly moves")
    if not sizes[1] > MOVING[1] and moved is not path:
        raise refused(
            path,
            f"{who} does not rotate: a straight path shows no headings",
            "drive curves both ways, with changes of speed",
        )
    return rates


def _refine(
    tracked: Rates, wheels: Rates, host: Callable[[FloatArray], FloatArray]
) -> ClockAlignment:
    """Offset, drift and both factors by least squares near the times `host`."""
    times = tracked.grid()
    seen, start = tracked.at(times), wheels.at(host(times))
    both = np.isfinite(seen).all(axis=1) & np.isfinite(start).all(axis=1)
    times, seen, start = times[both], seen[both], start[both]
    middle = 0.5 * float(times[0] + times[-1])
    scale = np.sum(seen * start, axis=0) / np.maximum(np.sum(start**2, axis=0), 1e-9)
    sigmas = np.maximum([normal_sigma(e) for e in (seen - scale * start).T], _NOISE_FLOOR)

    def by_wheels(steps: FloatArray, later: float = 0.0) -> FloatArray:
        offset, drift = steps[:2] * _STEPS[:2]
        at = host(times) + offset + drift * (times - middle) + later
        return np.asarray(wheels.at(at))

    def misses(steps: FloatArray) -> FloatArray:
        missed = seen - (scale + steps[2:] * _STEPS[2:]) * by_wheels(steps)
        return np.asarray(missed / sigmas)

    def slopes(steps: FloatArray) -> FloatArray:
        factors = scale + steps[2:] * _STEPS[2:]
        rise = factors * (by_wheels(steps, _SLOPE_S) - by_wheels(steps, -_SLOPE_S)) / (2 * _SLOPE_S)
        found = np.zeros((len(times), 2, 4))
        found[:, :, 0], found[:, :, 1] = rise, rise * (times - middle)[:, None]
        found[:, [0, 1], [2, 3]] = by_wheels(steps)
        return np.asarray(-np.nan_to_num(found * _STEPS / sigmas[:, None]).reshape(-1, 4))

    found = least_squares(
        lambda steps: np.nan_to_num(misses(steps)).ravel(),
        np.zeros(4),
        jac=slopes,
        loss="soft_l1",
        f_scale=_SOFT,
    )
    values = np.array([0.0, 0.0, *scale]) + found.x * _STEPS
    leap = _leap(found.jac[:, 0] / _STEPS[0], found.fun, times)
    wrong = np.nan_to_num(misses(found.x)) * sigmas
    squares = np.mean(seen**2, axis=0)
    missed = np.mean(wrong**2, axis=0) / np.maximum(squares, 1e-12)
    left = np.where(squares > MOVING**2, missed, 0.0)
    explained = np.clip(1.0 - left, 0.0, 1.0)
    ends = host(np.array([middle, middle + 1.0]))
    covariance = _covariance(found.jac, found.fun, times) * np.outer(_STEPS, _STEPS)
    apart = np.array([1.0, tracked.first - middle])
    return ClockAlignment(
        first=float(tracked.first),
        offset=float(ends[0] + values[0] - middle),
        drift=float(ends[1] - ends[0] - 1.0 + values[1]),
        middle=middle,
        sigma=math.sqrt(covariance[0, 0]),
        first_sigma=math.sqrt(apart @ covariance[:2, :2] @ apart),
        explained=(float(explained[0]), float(explained[1])),
        factors=(float(values[2]), float(values[3])),
        leap=leap,
    )


def _leap(slopes: FloatArray, errors: FloatArray, times: FloatArray) -> float:
    """By how much (s) the offset changes from one part of the path to the next, at most.

    slopes, errors (2 n,): of what is missed at times (n,), by the offset. 0: by less than noise.
    """
    parts = np.repeat(((times - times[0]) // _PART_S).astype(int), 2)
    information = np.bincount(parts, slopes * slopes)
    known = information > _LEAST_INFORMATION * information.max()
    offsets = (np.bincount(parts, slopes * errors) / np.maximum(information, 1e-12))[known]
    variances = _CORRELATED / information[known]
    steps = np.abs(np.diff(offsets))
    clear = steps > _LEAP_SIGMAS * np.sqrt(variances[1:] + variances[:-1])
    return float(np.max(steps, where=clear, initial=0.0))


def _covariance(slopes: FloatArray, errors: FloatArray, times: FloatArray) -> FloatArray:
    """Covariance (4, 4) by the scatter of the scores over blocks of time."""
    size = np.sqrt(np.maximum(np.sum(slopes**2, axis=0), 1e-300))
    slopes = slopes / size
    information = slopes.T @ slopes
    if not np.linalg.eigvalsh(information)[0] > _SINGULAR:
        return np.full((len(size), len(size)), math.inf)
    bread = np.asarray(np.linalg.inv(information))
    pulls = (slopes * errors[:, None]).reshape(len(times), 2, -1).sum(axis=1)
    sums = block_sums(pulls, blocks_of(times, _BLOCK_S))
    middle = bent_factor(len(sums), len(size)) * sums.T @ sums
    return sandwich(bread, middle) / np.outer(size, size)
