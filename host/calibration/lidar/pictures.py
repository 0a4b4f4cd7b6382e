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
    x_before, y_before = 1e3 * outcome.before[outcome.used].T
    x_after, y_after = 1e3 * outcome.errors[outcome.used].T
    return (
        ReportPicture(
            title="Coverage",
            x_label="x (ahead), m",
            y_label="y (left), m",
            series=(
                Series(x=used[:, 0], y=used[:, 1], label="used", role="measured"),
                Series(
                    x=rejected[:, 0], y=rejected[:, 1], label="rejected as wrong", role="refused"
                ),
            ),
            caption="True positions of teammates when the lidar saw them, in the robot frame. "
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
                    x=1e3 * outcome.curve.delays,
                    y=1e3 * np.sqrt(outcome.curve.costs),
                    role="fitted",
                    style="line",
                ),
            ),
            caption="How well the best mounting fits at each delay. Good is one narrow dip; "
            "where it is flat, the path does not separate the delay from a rotation of the lidar.",
        ),
        ReportPicture(
            title="Before and after",
            x_label="error in x, mm",
            y_label="error in y, mm",
            series=(
                Series(x=x_before, y=y_before, label="before", role="before"),
                Series(x=x_after, y=y_after, label="fitted", role="fitted"),
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
        x_label=f"{name}, {unit}",
        y_label="error, mm",
        series=(
            Series(x=x, y=1e3 * along, label="along the beam", role="along"),
            Series(x=x, y=1e3 * across, label="across", role="across"),
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
