"""Rows of figures as an aligned table."""

import itertools
import math
import textwrap
from collections.abc import Sequence

from host.cli.terminal.layout import listing, parts
from host.evaluation.metrics import Row
from host.systems.catalogue import SystemRow

_BASELINE = "clairvoyant"
# Heading, width, decimals.
_FIGURES = {
    "gospa_m": ("GOSPA", 6, 3),
    "missed": ("missed", 6, 2),
    "false": ("false", 5, 2),
    "time_over_30cm": (">30 cm", 6, 1),
    "rmse_m": ("RMSE", 5, 3),
    "anees": ("ANEES", 5, 2),
    "localisation_m": ("position", 8, 3),
    "p67_m": ("p67", 5, 3),
    "stray": ("stray", 5, 2),
    "label_changes": ("labels", 6, 1),
    "update_ms_median": ("update", 6, 2),
}
_LEGEND = {
    "GOSPA": "m, errors of positions, missed and false reports in one figure",
    "missed": "teammates not reported, a scan",
    "false": "reports of nobody, a scan",
    ">30 cm": "%, time that a teammate's nearest report is further away",
    "position": "m, the part of GOSPA that errors of positions make",
    "RMSE, p67": "m, errors of reports matched to teammates: root mean square, 67th percentile",
    "ANEES": "1: covariances fit the errors; more: overconfident",
    "stray": "reports over 30 cm from every teammate, a scan, at any range",
    "labels": "changes of a teammate's label, a minute",
    "update": "ms, median, to predict and update",
    "ratio": "GOSPA over that of clairvoyant, the limit",
}


def table(rows: Sequence[Row], columns: float = math.inf) -> str:
    """The rows, one block a source; the last column is GOSPA over the clairvoyant filter's.

    columns: of the terminal; where it is narrow, the figures of a block stand below each other.
    """
    lines: list[str] = []
    for source, block in itertools.groupby(rows, key=lambda row: row.source):
        lines += [*_block(source, list(block), columns), ""]
    return "\n".join([*lines, listing(_LEGEND)])


def _block(source: str, rows: Sequence[Row], columns: float) -> list[str]:
    """Who stands at the left of every part; parts are as wide as the terminal allows."""
    best = {(row.observer, row.sensors): row.gospa_m for row in rows if row.filter == _BASELINE}
    names = [("observer", "filter", "sensors"), *((r.observer, r.filter, r.sensors) for r in rows)]
    wide = max(12, *(len(row.filter) for row in rows))
    left = [f"  {observer:8} {name:{wide}} {sensors:12}" for observer, name, sensors in names]
    figures = [
        [f" {name:>{width}}" for name, width, _ in _FIGURES.values()] + ["  ratio"],
        *(_cells(row, best.get((row.observer, row.sensors), math.nan)) for row in rows),
    ]
    return [f"{source}   {rows[-1].seconds:.0f} s scored", *parts(left, figures, columns)]


def _cells(row: Row, limit: float) -> list[str]:
    """The figures of a row, each as wide as its column; limit: GOSPA of the clairvoyant filter."""
    cells = []
    for name, (_, width, decimals) in _FIGURES.items():
        value = getattr(row, name) * (100.0 if name == "time_over_30cm" else 1.0)
        cells.append(f" {_number(value, decimals):>{width}}")
    ratio = row.gospa_m / limit if limit else math.nan  # 0 where nobody was to be found
    return [*cells, f" {_number(ratio, 2):>6}"]


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def systems_table(rows: Sequence[SystemRow], columns: float = math.inf) -> str:
    """Each system on each source: its figures by name, or why there are none."""
    lines: list[str] = []
    wide = max(len(row.variant) for row in rows)
    for source, block in itertools.groupby(rows, key=lambda row: row.source):
        lines.append(source)
        for row in block:
            figures = "  ".join(f"{name} {value:.4g}" for name, value in row.figures.items())
            line = f"  {row.system:17} {row.variant:{wide}} {row.why or figures}"
            most = int(min(columns - 1, len(line)))
            lines += textwrap.wrap(line, most, subsequent_indent="    ")
    return "\n".join(lines)
