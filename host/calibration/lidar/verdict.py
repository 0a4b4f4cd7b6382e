"""What a fit of the lidar's mounting is worth: coverage, checks and pictures."""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.result import Check, ReportPicture, Series
from host.calibration.robust.time_offset import DelayCurve
from host.geometry import wrap
from host.messages import BoolArray, FloatArray

_SECTORS = (
    "ahead",
    "ahead on the left",
    "on the left",
    "behind on the left",
    "behind",
    "behind on the right",
    "on the right",
    "ahead on the right",
)
_LEAST_SECTORS, _LEAST_IN_SECTOR = 7, 10
_LEAST_RANGES_M = 0.6
_LEAST_PAIRS, _LEAST_SHARE = 100, 0.1
_WIDEST_S = 0.1
_LARGEST_RMS_M = 0.02
_BIAS_M = 0.005
_PIECES, _LEAST_IN_PIECE = 12, 5
_PERCENTILES = [5.0, 95.0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A fit and its data. Rows (n,) are turrets that were taken for teammates.

    truths (n, 2) m: where these were, in the robot frame; errors, before (n, 2) m: where the lidar
    put them, less the truth, as fitted and as configured. used (n,): not rejected as wrong.
    origin (2,) m: the lidar. candidates: all turrets. curve: cost by the delay in all;
    plausible: from which to which delay (s) it does not rise.
    """

    truths: FloatArray
    errors: FloatArray
    before: FloatArray
    used: BoolArray
    origin: FloatArray
    candidates: int
    curve: DelayCurve
    plausible: tuple[float, float]

    @property
    def told_apart(self) -> bool:
        """Whether the path tells the delay from a turn of the lidar."""
        low, high = self.plausible
        first, last = self.curve.delays[[0, -1]]
        return bool(high - low <= _WIDEST_S and low > first and high < last)

    @property
    def share(self) -> float:
        """Of all turrets those that were teammates, 0 to 1."""
        return float(np.count_nonzero(self.used)) / max(self.candidates, 1)

    @property
    def rms(self) -> float:
        """Of the length of the errors of what was used, m."""
        return float(np.sqrt(np.mean(np.sum(self.errors[self.used] ** 2, axis=1))))

    @property
    def polar(self) -> tuple[FloatArray, FloatArray]:
        """Range (m) and bearing (rad) of what was used (k,), from the lidar."""
        offset = self.truths[self.used] - self.origin
        return np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])

    @property
    def along_across(self) -> tuple[FloatArray, FloatArray]:
        """Errors (k,) m of what was used: along the beam (away from the lidar), and across."""
        offset = self.truths[self.used] - self.origin
        x, y = (offset / np.maximum(np.hypot(*offset.T), 1e-9)[:, None]).T
        errors = self.errors[self.used]
        return errors[:, 0] * x + errors[:, 1] * y, errors[:, 1] * x - errors[:, 0] * y


def missing_sectors(bearings: FloatArray) -> list[str]:
    """Of eight directions around the robot those with too few bearings (n,) rad, in words."""
    index = np.round(np.asarray(wrap(bearings)) / (math.tau / len(_SECTORS))).astype(int)
    counts = np.bincount(index % len(_SECTORS), minlength=len(_SECTORS))
    return [name for name, n in zip(_SECTORS, counts, strict=True) if n < _LEAST_IN_SECTOR]


def missing_bearings(bearings: FloatArray) -> str:
    """Where teammates have not been seen enough, as an advice; "" where that will do."""
    missing = missing_sectors(bearings)
    if len(_SECTORS) - len(missing) >= _LEAST_SECTORS:
        return ""
    return f"let a teammate be seen {', '.join(missing)}"


def missing_ranges(ranges: FloatArray) -> str:
    """What ranges (n,) m have not been seen, as an advice; "" where they will do."""
    near, far = np.percentile(ranges, _PERCENTILES) if len(ranges) else (0.0, 0.0)
    if far - near >= _LEAST_RANGES_M:
        return ""
    return f"let a teammate come from 0.5 to 2 m away: {near:.1f} to {far:.1f} m so far"


def missing_pairs(count: int) -> str:
    """How many more turns with a teammate in range are needed, as an advice, or ""."""
    if count >= _LEAST_PAIRS:
        return ""
    return f"go on driving: a teammate in range in {count} turns, {_LEAST_PAIRS} are needed"


def checks(outcome: Outcome) -> tuple[Check, ...]:
    """The conditions under which the fit is to be used."""
    ranges, bearings = outcome.polar
    sectors = len(_SECTORS) - len(missing_sectors(bearings))
    span = float(np.ptp(np.percentile(ranges, _PERCENTILES))) if len(ranges) else 0.0
    count = int(np.count_nonzero(outcome.used))
    low, high = outcome.plausible
    return (
        Check(
            name="teammates seen",
            value=count,
            threshold=_LEAST_PAIRS,
            unit="",
            passed=count >= _LEAST_PAIRS,
            advice="record for longer, with a teammate 0.5 to 2 m away",
        ),
        Check(
            name="turrets that are teammates",
            value=100.0 * outcome.share,
            threshold=100.0 * _LEAST_SHARE,
            unit="%",
            passed=outcome.share >= _LEAST_SHARE,
            advice="see that [mocap] body is this robot, that every robot on the floor has a "
            "body, and clear the floor of other things as thin as a turret",
        ),
        Check(
            name="delay told apart from rotation",
            value=1e3 * (high - low),
            threshold=1e3 * _WIDEST_S,
            unit="ms",
            passed=outcome.told_apart,
            advice=f"all delays from {1e3 * low:.0f} to {1e3 * high:.0f} ms fit as well, since on "
            "a path like a circle at constant speed, delay and turn of the lidar are one; "
            "turn both ways, and change the speed",
        ),
        Check(
            name="bearings covered",
            value=sectors,
            threshold=_LEAST_SECTORS,
            unit="of 8 directions",
            passed=sectors >= _LEAST_SECTORS,
            advice=missing_bearings(bearings),
        ),
        Check(
            name="ranges covered",
            value=span,
            threshold=_LEAST_RANGES_M,
            unit="m",
            passed=span >= _LEAST_RANGES_M,
            advice=missing_ranges(ranges),
        ),
        Check(
            name="residual",
            value=1e3 * outcome.rms,
            threshold=1e3 * _LARGEST_RMS_M,
            unit="mm rms",
            passed=outcome.rms <= _LARGEST_RMS_M,
            advice="the lidar and motion capture do not agree: see that the bodies' origins are "
            "above the middle of the turrets, and that lidar.target_diameter_m is right",
        ),
    )


def pictures(outcome: Outcome) -> tuple[ReportPicture, ...]:
    """Coverage, residuals by range and by bearing, the delay curve, before and after."""
    ranges, bearings = outcome.polar
    used = outcome.truths[outcome.used]
    rejected = outcome.truths[~outcome.used]
    return (
        ReportPicture(
            title="Coverage",
            x_label="x (ahead), m",
            y_label="y (left), m",
            series=(
                Series(x=used[:, 0], y=used[:, 1], label="used"),
                Series(x=rejected[:, 0], y=rejected[:, 1], label="rejected as wrong"),
            ),
            caption="Where teammates truly were when the lidar saw them, in the robot frame. "
            "Good is all around, near and far.",
            equal=True,
        ),
        _residuals(outcome, ranges, "range", "m", _bias(outcome)),
        _residuals(outcome, np.degrees(bearings), "bearing", "deg", _BEARING_CAPTION),
        ReportPicture(
            title="Delay",
            x_label="delay, ms",
            y_label="rms error, cut off at 100 mm, mm",
            series=(
                Series(
                    x=1e3 * outcome.curve.delays, y=1e3 * np.sqrt(outcome.curve.costs), style="line"
                ),
            ),
            caption="How well the best mounting fits at each delay. Good is one narrow dip; "
            "where it is flat, the path does not tell the delay from a turn of the lidar.",
        ),
        ReportPicture(
            title="Before and after",
            x_label="error in x, mm",
            y_label="error in y, mm",
            series=(
                _cloud(outcome.before[outcome.used], "as configured"),
                _cloud(outcome.errors[outcome.used], "as fitted"),
            ),
            caption="Where the lidar puts teammates in the robot frame, less where they were.",
            equal=True,
        ),
    )


_BEARING_CAPTION = (
    "A wave once around is a mounting that moved, or a body whose origin is beside the turret."
)


def _cloud(errors: FloatArray, label: str) -> Series:
    return Series(x=1e3 * errors[:, 0], y=1e3 * errors[:, 1], label=label)


def _residuals(
    outcome: Outcome, x: FloatArray, name: str, unit: str, caption: str
) -> ReportPicture:
    along, across = outcome.along_across
    return ReportPicture(
        title=f"Residuals by {name}",
        x_label=f"{name}, {unit}",
        y_label="error, mm",
        series=(
            Series(x=x, y=1e3 * along, label="along the beam"),
            Series(x=x, y=1e3 * across, label="across"),
            _medians(x, 1e3 * along),
        ),
        caption=caption,
    )


def _medians(x: FloatArray, errors: FloatArray) -> Series:
    """The median error in each of some equal pieces of x, where there are some."""
    edges = np.linspace(x.min(), x.max(), _PIECES + 1) if len(x) else np.zeros(_PIECES + 1)
    piece = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _PIECES - 1)
    filled = [k for k in range(_PIECES) if np.count_nonzero(piece == k) >= _LEAST_IN_PIECE]
    return Series(
        x=np.array([0.5 * (edges[k] + edges[k + 1]) for k in filled]),
        y=np.array([float(np.median(errors[piece == k])) for k in filled]),
        label="along the beam, median",
        style="line",
    )


def _bias(outcome: Outcome) -> str:
    """Whether turrets lie too far or too near all in all, in words."""
    along, _ = outcome.along_across
    bias = float(np.median(along)) if len(along) else 0.0
    if abs(bias) < _BIAS_M:
        return f"All in all turrets lie {1e3 * bias:+.1f} mm too far along the beam: no bias."
    return (
        f"Turrets lie {1e3 * abs(bias):.0f} mm too {'far' if bias > 0.0 else 'near'} along the "
        "beam: the fit of the circle is biased, or lidar.target_diameter_m is not the turret's."
    )
