"""Text in the width of the terminal: named figures, and tables of any width."""

import math
import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

_NARROWEST = 20


def terminal_columns() -> int:
    """How wide the terminal is, or COLUMNS says; as if it were a narrow one where it is absurd."""
    return max(shutil.get_terminal_size().columns, _NARROWEST)


def columns(unknown: float = math.inf) -> float:
    """How wide the terminal is, or COLUMNS says; without both, `unknown`."""
    known = sys.stdout.isatty() or os.environ.get("COLUMNS", "")
    return terminal_columns() if known else unknown


def listing(figures: Mapping[str, Any]) -> str:
    """Figures one a line, their names aligned, in 80 columns or as many as there are."""
    most = int(min(columns(), 80)) - 1
    width = max(map(len, figures), default=0)
    return "\n".join(
        textwrap.fill(
            f"  {name:{width}}  {value}",
            most,
            subsequent_indent=" " * min(width + 4, most // 2),
            break_on_hyphens=False,
        )
        for name, value in figures.items()
    )


def parts(left: Sequence[str], cells: Sequence[Sequence[str]], columns: float) -> list[str]:
    """Lines of a table, in parts below each other that are as wide as the terminal allows.

    left (n,): what stands at the left of every part; cells (n, m): each as wide as its column. The
    first of both are headings. Where not even one column fits, each row is a paragraph.
    """
    if len(left[0]) + max(map(len, cells[0])) >= columns:
        return _paragraphs(left, cells, int(columns) - 1)
    lines, begin, count = [], 0, len(cells[0])
    while begin < count:
        end = begin + 1
        while end < count and len(left[0] + "".join(cells[0][begin : end + 1])) < columns:
            end += 1
        lines += [who + "".join(row[begin:end]) for who, row in zip(left, cells, strict=True)]
        begin = end
    return lines


def _paragraphs(left: Sequence[str], cells: Sequence[Sequence[str]], width: int) -> list[str]:
    lines = []
    for who, row in zip(left[1:], cells[1:], strict=True):
        named = [f"{name.strip()} {cell.strip()}" for name, cell in zip(cells[0], row, strict=True)]
        text = ", ".join(named)
        lines += [f"  {' '.join(who.split())}"[:width]]
        lines += textwrap.wrap(text, width, initial_indent="    ", subsequent_indent="    ")
    return lines
