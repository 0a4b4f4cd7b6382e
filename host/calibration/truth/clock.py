"""A tracker's clock on the robot's, and whether an alignment of the two is to be used."""

import math
from dataclasses import dataclass

import numpy as np

from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.named_columns import BodyPath

LEAST_EXPLAINED, _MOSTLY = 0.8, 0.5  # of the squared heading rate; the latter by parts
_WIDEST_S = 0.5  # from the best offset to others that fit as well; drift widens the peak
_LARGEST_SIGMA_S, _LARGEST_LEAP_S = 0.02, 0.03
_UNITS = (
    {"mm": 1e3, "cm": 1e2, "m instead of mm": 1e-3, "m instead of cm": 1e-2},
    {"degrees": 180.0 / math.pi, "radians": math.pi / 180.0},
)
_UNIT_RATIO = 0.5  # of the logarithms of two factors that are one unit
_SHOWN_DRIFT, _SHOWN_FACTOR = 5e-4, 0.2
_WIDEST_FACTOR = math.log(5.0)  # by which the wheels' geometry may be off
_INTERVALS_S, _LONGEST_S = (2e-4, 0.5), 1e5  # of a tracker's rows, and of its paths


@dataclass(frozen=True, slots=True)
class ClockAlignment:
    """The robot's time of a tracker's time t: t + offset + drift (t - middle).

    first: that of the path, s. offset and its sigma, s; first_sigma: of the robot's time of that;
    drift s/s. explained: of the squared speed and heading rate, 0 to 1; 1 of one that is nearly
    zero. factors: the tracker's speed and heading rate over the wheels'. leap: by how much (s) the
    offset changes within seconds, at most.
    """

    first: float
    offset: float
    drift: float
    middle: float
    sigma: float
    first_sigma: float
    explained: tuple[float, float]
    factors: tuple[float, float]
    leap: float

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
            f"recording's clock, ± {1e3 * self.first_sigma:.1f} ms"
            f"{drift if abs(self.drift) > _SHOWN_DRIFT else ''}; they explain {rate:.1f} % of its "
            f"rotations, {speed:.1f} % of its speeds"
            f"{other if abs(math.log(max(faster, 1e-9))) > _SHOWN_FACTOR else ''}"
        )

    def host_times(self, times: FloatArray) -> FloatArray:
        """The robot's times (n,) s of a tracker's times (n,) s."""
        return np.asarray(times + self.offset + self.drift * (times - self.middle))


def check_times(path: BodyPath, moved: BodyPath, who: str) -> None:
    """Raise UserError for times that are in other units than s."""
    if len(moved.times) < 2:
        return
    interval, length = float(np.median(np.diff(moved.times))), float(np.ptp(moved.times))
    if not _INTERVALS_S[0] <= interval <= _INTERVALS_S[1]:
        raise refused(
            path,
            f"{who} was seen every {interval:.3g} s, from first to last for {length:.3g} s",
            "say the unit of the file's times with --truth-units, as ms,m,rad; or track it more "
            f"often than every {_INTERVALS_S[1]:g} s",
        )
    if length > _LONGEST_S:
        raise refused(
            path,
            f"{who} was seen from {moved.times[0]:.12g} s to {moved.times[-1]:.12g} s",
            "remove the lines whose times are wrong",
        )


def check_alignment(path: BodyPath, found: ClockAlignment, apart: float) -> None:
    """Raise UserError for an alignment that is not to be used; apart (s): equally good ones."""
    speed, rate = found.explained
    hole = np.diff(path.times)
    if apart > _WIDEST_S and hole.max() > 0.5 * apart:
        raise refused(
            path,
            f"its times leap by {hole.max():.1f} s after {path.times[np.argmax(hole)]:.12g} s, and "
            "what is before fits the wheels as well as what is after",
            "cut the file there, and give the longer part",
        )
    if found.leap > _LARGEST_LEAP_S and min(speed, rate) >= _MOSTLY:
        raise refused(
            path,
            f"its offset to the wheels changes by {1e3 * found.leap:.0f} ms or more within "
            "seconds: its clock leaps, or lines were lost and the rest moved up",
            "record again; or give the part of the file before that, or after",
        )
    if min(speed, rate) < LEAST_EXPLAINED:
        raise refused(
            path,
            f"at the best offset the wheels explain {100 * rate:.0f} % of its rotations "
            f"and {100 * speed:.0f} % of its speeds",
            "see that its headings are those of this robot, and that no symmetric pattern of "
            "markers makes them jump"
            if speed >= LEAST_EXPLAINED
            else "see that the file is of this drive, that the body named is this robot's, and "
            "that lines at which it was lost are blank",
        )
    if apart > _WIDEST_S:
        raise refused(
            path,
            f"offsets that differ by {apart:.1f} s fit as well as the best: on a path like a "
            "circle at constant speed, or one that repeats itself, time does not show",
            "drive with changes of speed and of heading rate, and with stops of unequal length",
        )
    _check_units(path, found)
    if not found.sigma <= _LARGEST_SIGMA_S:
        raise refused(
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
            raise refused(
                path,
                f"its {what} is {abs(factor):.3g} times that of the wheels",
                f"{looks} the file's units with --truth-units (an export of Motive says its own)",
            )


def refused(path: BodyPath, why: str, next_step: str = "") -> UserError:
    name = f"the path of {path.name}" if path.name else "the true path"
    return UserError(
        f"{name} cannot be aligned in time with the wheels",
        why,
        next_step or "record the whole drive with both, and drive for a minute or more",
    )
