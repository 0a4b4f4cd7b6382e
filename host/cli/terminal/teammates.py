"""What is known of the teammates as rows of a table and as a count, for a person at a terminal."""

import math
from collections.abc import Callable

import numpy as np

from host.evaluation.truth_scoring import RANGE_M, errors_m
from host.messages import Estimate, FloatArray, Named, Now

Paint = Callable[[str, str], str]  # a text in a style
_COLUMNS = "{:>3} {:>7} {:>7} {:>7} {:>11} {:>8} {:>6} {:>5}"
HEADING = _COLUMNS.format(
    "no", "x m", "y m", "dist m", "bearing deg", "sigma mm", "weight", "age s"
)
_ERROR, _ROBOT, _TURNED = " {:>9}", " {:>6}", " {:>12}"
_OLD_S = 1.0
_SURE = 0.9  # a name that is less probable has a question mark


def table(now: Now, width: int, paint: Paint) -> list[str]:
    """A heading and a row for each estimate; who it is and where it heads, where names are known.

    Headings of the robots are left out where the table would be wider than `width` columns.
    """
    errors = None if now.truth is None else errors_m(now.estimate, now.truth)
    heading = HEADING + (_ERROR.format("error mm") if errors is not None else "")
    if now.names:
        heading += _ROBOT.format("robot")
    turned = _TURNED.format("heading deg")
    wide = bool(now.names) and len(heading + turned) <= width
    lines = [paint(heading + turned * wide, "dim")]
    for k in np.argsort(now.estimate.labels, kind="stable").tolist():
        row = _row(now.estimate, k, paint) + (
            _error(errors[k], paint) if errors is not None else ""
        )
        named = now.names.get(int(now.estimate.labels[k]))
        lines.append(row if named is None else row + _named(named, wide))
    return lines if len(lines) > 1 else [*lines, "  no teammate in sight"]


def _row(estimate: Estimate, k: int, paint: Paint) -> str:
    x, y = (float(value) for value in estimate.positions[k])
    sigma_mm = 1000.0 * math.sqrt(0.5 * float(np.trace(estimate.covariances[k])))
    age = float(estimate.ages[k])
    row = _COLUMNS.format(
        int(estimate.labels[k]),
        f"{x:+.3f}",
        f"{y:+.3f}",
        f"{math.hypot(x, y):.3f}",
        f"{math.degrees(math.atan2(y, x)):+.1f}",
        f"{sigma_mm:.0f}",
        f"{estimate.weights[k]:.2f}",
        f"{age:.1f}",
    )
    return paint(row, "dim" if age > _OLD_S else "")


def _error(error_m: float, paint: Paint) -> str:
    if math.isnan(error_m):
        return paint(_ERROR.format("false"), "red")
    return _ERROR.format(f"{1000.0 * error_m:.0f}")


def _named(named: Named, with_heading: bool) -> str:
    text = _ROBOT.format(_number(named))
    return text + _TURNED.format(f"{math.degrees(named.heading):+.0f}") * with_heading


def _number(named: Named) -> str:
    return f"{named.identity}{'' if named.probability > _SURE else '?'}"


def tally(now: Now) -> str:
    """How many there are, and who of them is known; beside the truth where that is known."""
    estimate, truth = now.estimate, now.truth
    count = len(estimate.positions)
    words = f"{count} teammate{'' if count == 1 else 's'}"
    named = [now.names[label] for label in estimate.labels.tolist() if label in now.names]
    if named:
        by_number = sorted(named, key=lambda each: each.identity)
        words += f" (robot {', '.join(map(_number, by_number))})"
    if len(estimate.obstacles):
        known = len(estimate.obstacles)
        words += f", {known} obstacle{'' if known == 1 else 's'}"
    if truth is None:
        return words
    near, truly = (_in_range(each.positions) for each in (estimate, truth))
    words += f"; within {RANGE_M:.1f} m: {near} estimated, {truly} true"
    errors = errors_m(estimate, truth)
    if not np.all(np.isnan(errors)):
        words += f"; mean error {1000.0 * np.nanmean(errors):.0f} mm"
    return words


def _in_range(positions: FloatArray) -> int:
    return int(np.sum(np.linalg.norm(positions, axis=1) <= RANGE_M))
