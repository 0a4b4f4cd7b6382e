"""When a tracker's file was recorded, on the robot's clock: by how the robot drove and rotated.

Both the wheels and the tracker have how fast the robot went and rotated, each by its own clock. The
offset between the clocks is the one at which the two agree: searched over all of them by
correlation, then fitted together with the drift of the clocks. Rates do not depend on where the
tracked body lies on the robot (speeds do a little), and both are compared up to a factor, since
neither the wheels nor the file's units need be right.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from host.calibration.robust.statistics import (
    bent_factor,
    block_sums,
    blocks_of,
    normal_sigma,
    sandwich,
)
from host.calibration.truth.frame import frame_slip
from host.calibration.truth.rates import (
    LEAST_OVERLAP_S,
    MOVING,
    Rates,
    search,
)
from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.named_columns import BodyPath

_BLOCK_S = 3.0
_WIDEST_S = 0.5  # from the best offset to others that fit as well; drift widens the peak
_LEAST_EXPLAINED = 0.8  # of the squared heading rate
_LARGEST_SIGMA_S = 0.02
_DRIFTS = np.arange(-0.03, 0.0301, 0.005)  # that are searched: nominal times of rows may be 2 % off
_STEPS = np.array([0.02, 1e-3, 0.02, 0.02])  # changes that count
_SLOPE_S = 0.02  # half of the interval over which a slope is taken
_SINGULAR = 1e-10
_SOFT = 2.0  # sigmas: trusted less from here on
_UNITS = (
    {"mm": 1e3, "cm": 1e2, "m instead of mm": 1e-3, "m instead of cm": 1e-2},
    {"degrees": 180.0 / math.pi, "radians": math.pi / 180.0},
)
_UNIT_RATIO = 0.5  # of the logarithms of two factors that are one unit
_SHOWN_DRIFT, _SHOWN_FACTOR = 5e-4, 0.2
_WIDEST_FACTOR = math.log(5.0)  # by which the wheels' geometry may be off
_INTERVALS_S, _LONGEST_S = (2e-4, 0.5), 1e5  # of a tracker's rows, and of its paths
_NOISE_FLOOR = np.array([1e-3, 2e-3])


@dataclass(frozen=True, slots=True)
class ClockAlignment:
    """The robot's time of a tracker's time t: t + offset + drift (t - middle).

    first: that of the path, s. offset, sigma s; drift s/s. explained: of the squared speed and
    heading rate, 0 to 1; 1 of one that is nearly zero. factors: the tracker's speed and heading
    rate over the wheels'.
    """

    first: float
    offset: float
    drift: float
    middle: float
    sigma: float
    explained: tuple[float, float]
    factors: tuple[float, float]

    def words(self) -> str:
        """What was found, for a reader."""
        speed, rate = (100.0 * share for share in self.explained)
        drift = (
            f", its clock is {abs(100.0 * self.drift):.2f} % {'fast' if self.drift < 0 else 'slow'}"
        )
        begin = self.host_times(np.array([self.first]))[0]
        faster = abs(self.factors[0])
        other = f"; it drives {faster:.2f} times as fast as they say"
        return (
            f"aligned by the wheels: its {self.first:.12g} s is at {begin:.3f} s of the "
            f"recording's clock, ± {1e3 * self.sigma:.1f} ms"
            f"{drift if abs(self.drift) > _SHOWN_DRIFT else ''}; they explain {rate:.1f} % of its "
            f"rotations, {speed:.1f} % of its speeds"
            f"{other if abs(math.log(max(faster, 1e-9))) > _SHOWN_FACTOR else ''}"
        )

    def host_times(self, times: FloatArray) -> FloatArray:
        """The robot's times (n,) s of a tracker's times (n,) s."""
        return np.asarray(times + self.offset + self.drift * (times - self.middle))


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
    if result.explained[0] >= _LEAST_EXPLAINED:  # else it is another drive's
        known = result.explained[1] >= _LEAST_EXPLAINED
        slip = frame_slip(path, rate, result.factors[1] if known else math.nan)
        if slip is not None:
            raise _refused(path, *slip)
    _check(path, result, float(np.ptp(found.alike)))
    return result


def _moving_rates(path: BodyPath, moved: BodyPath, who: str) -> Rates:
    _check_times(path, moved, who)
    if not len(moved.times):
        raise _refused(
            path,
            f"{who} has no pose at all",
            "it was lost in every row, or the rows have no orientation, as quaternions of zeros",
        )
    if len(moved.times) < 2 or moved.times[-1] - moved.times[0] < LEAST_OVERLAP_S:
        raise _refused(path, f"{who} was seen for less than {LEAST_OVERLAP_S:.0f} s")
    rates = Rates(moved)
    sizes = np.sqrt(np.nanmean(rates.at(rates.grid()) ** 2, axis=0))
    if not np.any(sizes > MOVING):
        raise _refused(path, f"{who} hardly moves")
    return rates


def _check_times(path: BodyPath, moved: BodyPath, who: str) -> None:
    """Raise UserError for times that are in other units than s."""
    if len(moved.times) < 2:
        return
    interval, length = float(np.median(np.diff(moved.times))), float(np.ptp(moved.times))
    if not _INTERVALS_S[0] <= interval <= _INTERVALS_S[1]:
        raise _refused(
            path,
            f"{who} was seen every {interval:.3g} s, from first to last for {length:.3g} s",
            "say the unit of the file's times with --truth-units, as ms,m,rad; or track it more "
            f"often than every {_INTERVALS_S[1]:g} s",
        )
    if length > _LONGEST_S:
        raise _refused(
            path,
            f"{who} was seen from {moved.times[0]:.12g} s to {moved.times[-1]:.12g} s",
            "remove the lines whose times are wrong",
        )


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
    wrong = np.nan_to_num(misses(found.x)) * sigmas
    squares = np.mean(seen**2, axis=0)
    missed = np.mean(wrong**2, axis=0) / np.maximum(squares, 1e-12)
    left = np.where(squares > MOVING**2, missed, 0.0)
    explained = np.clip(1.0 - left, 0.0, 1.0)
    ends = host(np.array([middle, middle + 1.0]))
    return ClockAlignment(
        first=float(tracked.first),
        offset=float(ends[0] + values[0] - middle),
        drift=float(ends[1] - ends[0] - 1.0 + values[1]),
        middle=middle,
        sigma=_STEPS[0] * math.sqrt(_covariance(found.jac, found.fun, times)[0, 0]),
        explained=(float(explained[0]), float(explained[1])),
        factors=(float(values[2]), float(values[3])),
    )


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


def _check(path: BodyPath, found: ClockAlignment, apart: float) -> None:
    """Raise UserError for an alignment that is not to be used; apart (s): equally good ones."""
    speed, rate = found.explained
    if min(speed, rate) < _LEAST_EXPLAINED:
        raise _refused(
            path,
            f"at the best offset the wheels explain {100 * rate:.0f} % of its rotations "
            f"and {100 * speed:.0f} % of its speeds",
            "see that its headings are those of this robot, and that no symmetric pattern of "
            "markers makes them jump"
            if speed >= _LEAST_EXPLAINED
            else "see that the file is of this drive, that the body named is this robot's, and "
            "that lines at which it was lost are blank",
        )
    if apart > _WIDEST_S:
        raise _refused(
            path,
            f"offsets that differ by {apart:.1f} s fit as well as the best: on a path like a "
            "circle at constant speed, or one that repeats itself, time does not show",
            "drive with changes of speed and of heading rate, and with stops of unequal length",
        )
    _check_units(path, found)
    if not found.sigma <= _LARGEST_SIGMA_S:
        raise _refused(
            path,
            f"the offset of the clocks is known to {1e3 * found.sigma:.0f} ms only",
            "drive with more changes of speed and of heading rate",
        )


def _check_units(path: BodyPath, found: ClockAlignment) -> None:
    for factor, what, words in zip(found.factors, ("speed", "rotation"), _UNITS, strict=True):
        size = math.log(max(abs(factor), 1e-9))
        units = [u for u, ratio in words.items() if abs(size - math.log(ratio)) < _UNIT_RATIO]
        if units or abs(size) > _WIDEST_FACTOR:
            looks = f"it looks like {units[0]}: say" if units else "say"
            raise _refused(
                path,
                f"its {what} is {abs(factor):.3g} times that of the wheels",
                f"{looks} the file's units with --truth-units (an export of Motive says its own)",
            )


def _refused(path: BodyPath, why: str, next_step: str = "") -> UserError:
    name = f"the path of {path.name}" if path.name else "the true path"
    return UserError(
        f"{name} cannot be aligned in time with the wheels",
        why,
        next_step or "record the whole drive with both, and drive for a minute or more",
    )
