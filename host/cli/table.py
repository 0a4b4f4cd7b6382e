"""Rows of figures as an aligned table."""

import itertools
import math
from collections.abc import Sequence

from host.evaluation.metrics import Row
from host.systems.catalogue import SystemRow

_BASELINE = "clairvoyant"
# Heading with the unit, width, decimals.
_FIGURES = {
    "gospa_m": ("GOSPA m", 7, 3),
    "localisation_m": ("loc. m", 6, 3),
    "missed": ("missed", 6, 2),
    "false": ("false", 5, 2),
    "stray": ("stray", 5, 2),
    "time_over_30cm": (">30cm%", 6, 1),
    "rmse_m": ("RMSE m", 6, 3),
    "p67_m": ("p67 m", 5, 3),
    "label_changes": ("label", 5, 1),
    "anees": ("ANEES", 5, 2),
    "update_ms_median": ("ms", 5, 2),
}
_LEGEND = """\
missed, false: per scan. stray: estimates over 30 cm from every teammate, per scan, at any range.
>30cm: teammates whose nearest estimate is further. label: its changes per teammate and
minute. ANEES: 1 is consistent, more is overconfident. ms: one predict and update. ratio: of GOSPA
to clairvoyant's."""


def table(rows: Sequence[Row]) -> str:
    """The rows, one block a source; the last column is GOSPA over the clairvoyant filter's."""
    lines: list[str] = []
    for source, block in itertools.groupby(rows, key=lambda row: row.source):
        lines += [*_block(source, list(block)), ""]
    return "\n".join([*lines, _LEGEND])


def _block(source: str, rows: Sequence[Row]) -> list[str]:
    best = {(row.observer, row.sensors): row.gospa_m for row in rows if row.filter == _BASELINE}
    wide = max(12, *(len(row.filter) for row in rows))
    heading = f"  {'observer':8} {'filter':{wide}} {'sensors':12}"
    heading += "".join(f" {name:>{width}}" for name, width, _ in _FIGURES.values())
    lines = [f"{source}   {rows[-1].seconds:.0f} s scored", heading + "  ratio"]
    for row in rows:
        line = f"  {row.observer:8} {row.filter:{wide}} {row.sensors:12}"
        for name, (_, width, decimals) in _FIGURES.items():
            value = getattr(row, name) * (100.0 if name == "time_over_30cm" else 1.0)
            line += f" {_number(value, decimals):>{width}}"
        limit = best.get((row.observer, row.sensors), math.nan)
        ratio = row.gospa_m / limit if limit else math.nan  # 0 where nobody was to be found
        lines.append(f"{line} {_number(ratio, 2):>6}")
    return lines


def _number(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}" if math.isfinite(value) else "-"


def systems_table(rows: Sequence[SystemRow]) -> str:
    """Each system on each source: its figures by name, or why there are none."""
    lines: list[str] = []
    for source, block in itertools.groupby(rows, key=lambda row: row.source):
        lines.append(source)
        for row in block:
            figures = "  ".join(f"{name} {value:.4g}" for name, value in row.figures.items())
            lines.append(f"  {row.system:17} {row.variant:17} {row.why or figures}")
    return "\n".join(lines)
