"""A calibration's numbers as people and programs read them: console table and JSON."""

import dataclasses
import math
import textwrap
from typing import Any

from host.calibration.result import Calibration, Check, Fitted, distinct

_COLUMNS = 80


def value_and_sigma(row: Fitted) -> str:
    """As "2.981 ± 0.021 deg": two digits of the sigma, and as many of the value as it allows."""
    value, sigma = row.value * row.scale, row.sigma * row.scale
    if not (math.isfinite(sigma) and sigma > 0.0):
        return row.shown(row.value)
    decimals = _decimals(sigma)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f} {row.unit}".rstrip()


def value_alike(row: Fitted, value: float) -> str:
    """Another value of the same row, with as many digits and no unit."""
    if not math.isfinite(value):
        return "–"
    if not (math.isfinite(row.sigma) and row.sigma > 0.0):
        return f"{value * row.scale:.4g}"
    return f"{value * row.scale:.{_decimals(row.sigma * row.scale)}f}"


def _decimals(sigma: float) -> int:
    return min(max(1 - math.floor(math.log10(sigma)), 0), 9)


def fitted_cells(row: Fitted) -> tuple[str, str, str, str]:
    """Value and sigma, the largest sigma that will do, what was before, and the verdict.

    The verdict is "ok", "fails", or "" where nothing is asked of the row.
    """
    bound = "–" if row.limit is None else f"{row.limit * row.scale:.3g} {row.unit}".rstrip()
    before = "" if row.before is None else value_alike(row, row.before)
    verdict = "fails" if row.failure else "ok" if row.limit is not None else ""
    return value_and_sigma(row), bound, before, verdict


def check_cells(check: Check) -> tuple[str, str, str]:
    """What a check found, what it needs (on which side of its bound), and "ok" or "fails"."""
    found, needed = "–", ""
    if math.isfinite(check.value):
        plain = f"{round(check.value, 9):.4g}"  # rounding errors of zero are 0
        value = plain if check.passed else distinct(check.value, check.threshold)
        found = f"{value} {check.unit}".rstrip()
    if math.isfinite(check.threshold):
        side = "≥" if check.side == "at least" else "≤"
        needed = f"{side} {check.threshold:.4g} {check.unit}".rstrip()
    return found, needed, "ok" if check.passed else "fails"


def as_text(calibration: Calibration, columns: float = _COLUMNS) -> str:
    """The console's table, 80 columns wide or fewer; the verdict comes last."""
    most = int(min(columns, _COLUMNS))
    head = ("value ± sigma", "sigma at most", "before", "")
    lines = [_row(f"{calibration.kind} calibration", *head, most)]
    lines += [_row(row.name, *fitted_cells(row), most) for row in calibration.fitted]
    if calibration.checks:
        lines += ["", _row("checks", "found", "needed", "", "", most)]
        for check in calibration.checks:
            found, needed, verdict = check_cells(check)
            lines.append(_row(check.name, found, needed, "", verdict, most))
    unbounded = dict.fromkeys(row.unbounded for row in calibration.fitted if row.unbounded)
    notes = [f"sigma at most –: {'; '.join(unbounded)}"] if unbounded else []
    notes += [f"residuals: {calibration.residuals}"] if calibration.residuals else []
    notes += [f"beware: {warning}" for warning in calibration.warnings]
    for note in notes:
        lines += ["", textwrap.fill(note, most)]
    return "\n".join([*lines, "", _conclusion(calibration, most)])


def _row(name: str, value: str, bound: str, before: str, word: str, most: int) -> str:
    """One line; a name too long for its column has a line of its own.

    Where the terminal is narrower than the table every name has, with the rest below it.
    """
    if most < _COLUMNS:
        cells = "  ".join(cell for cell in (value, bound, before, word) if cell)
        below = textwrap.wrap(cells, most, initial_indent="  ", subsequent_indent="    ")
        return "\n".join([*textwrap.wrap(name, most), *below])
    rest = f"{value:>22} {bound:>13} {before:>9}  {word}".rstrip()
    if len(name) <= 26:
        return f"{name:26} {rest}"
    return "\n".join([*textwrap.wrap(name, _COLUMNS), f"{'':26} {rest}"])


def _conclusion(calibration: Calibration, most: int) -> str:
    failures = calibration.failures
    if not failures:
        return "passed"
    points = (
        textwrap.fill(failure, most, initial_indent="- ", subsequent_indent="  ")
        for failure in failures
    )
    return "\n".join(["refused:", *points])


def as_json(calibration: Calibration, source: str, date: str) -> dict[str, Any]:
    """The same figures for programs: SI units, null where there is no number."""
    return {
        "kind": calibration.kind,
        "source": source,
        "date": date,
        "passed": not calibration.failures,
        "failures": calibration.failures,
        "fitted": [
            {
                **_json(dataclasses.asdict(row)),
                "shown": value_and_sigma(row),
                "passed": not row.failure,
            }
            for row in calibration.fitted
        ],
        "checks": [
            {**_json(dataclasses.asdict(check)), "passed": check.passed}
            for check in calibration.checks
        ],
        "residuals": calibration.residuals,
        "warnings": list(calibration.warnings),
        "settings": _json(calibration.new_settings()),
        "figures": _json(calibration.figures),
    }


def _json(value: Any) -> Any:
    """A value as JSON has it: plain numbers, lists and dicts; what is not finite is null."""
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _json(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_json(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
