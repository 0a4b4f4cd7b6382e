"""What there is to see of a calibration of the lidar."""

import numpy as np

from host.calibration.lidar.verdict import Outcome
from host.calibration.result import ReportPicture, Series
from host.messages import FloatArray

_BIAS_M = 0.005


def pictures(outcome: Outcome) -> tuple[ReportPicture, ...]:
    """Coverage, residuals by range and by bearing, the delay curve, before and after."""
    ranges, bearings = outcome.polar
    used = outcome.truths[outcome.used]
    rejected = outcome.truths[~outcome.used]
    delays_ms, rms_mm = 1e3 * outcome.curve.delays, 1e3 * np.sqrt(outcome.curve.costs)
    before, after = 1e3 * outcome.before[outcome.used], 1e3 * outcome.errors[outcome.used]
    return (
        ReportPicture(
            title="Coverage",
            axes=("x (ahead), m", "y (left), m"),
            series=(
                Series(used[:, 0], used[:, 1], "used", "measured"),
                Series(rejected[:, 0], rejected[:, 1], "rejected as wrong", "refused"),
            ),
            caption="True positions of teammates when the lidar saw them, in the robot frame. "
            "Good is all around, near and far.",
            equal=True,
        ),
        _residuals(outcome, ranges, "range", "m", _bias(outcome)),
        _residuals(outcome, np.degrees(bearings), "bearing", "deg", _BEARING_CAPTION),
        ReportPicture(
            title="Delay",
            axes=("delay, ms", "rms error, cut off at 100 mm, mm"),
            series=(Series(delays_ms, rms_mm, "", "fitted", "line"),),
            caption="How well the best mounting fits at each delay. Good is one narrow dip; "
            "where it is flat, the path does not separate the delay from a rotation of the lidar.",
        ),
        ReportPicture(
            title="Before and after",
            axes=("error in x, mm", "error in y, mm"),
            series=(
                Series(before[:, 0], before[:, 1], "before", "before"),
                Series(after[:, 0], after[:, 1], "fitted", "fitted"),
            ),
            caption="Where the lidar puts teammates in the robot frame, less where they were.",
            equal=True,
        ),
    )


_BEARING_CAPTION = (
    "A wave once around is a mounting that moved, or a body whose origin is beside the turret."
)


def _residuals(
    outcome: Outcome, x: FloatArray, name: str, unit: str, caption: str
) -> ReportPicture:
    along, across = outcome.along_across
    return ReportPicture(
        title=f"Residuals by {name}",
        axes=(f"{name}, {unit}", "error, mm"),
        series=(
            Series(x, 1e3 * along, "along the beam", "along"),
            Series(x, 1e3 * across, "across", "across"),
        ),
        caption=caption,
    )


def _bias(outcome: Outcome) -> str:
    """Whether turrets lie too far or too near all in all, as text."""
    along, _ = outcome.along_across
    bias = float(np.median(along)) if len(along) else 0.0
    if abs(bias) < _BIAS_M:
        return f"All in all turrets lie {1e3 * bias:+.1f} mm too far along the beam: no bias."
    return (
        f"Turrets lie {1e3 * abs(bias):.0f} mm too {'far' if bias > 0.0 else 'near'} along the "
        "beam: the fit of the circle is biased, or lidar.target_diameter_m is not the turret's."
    )
