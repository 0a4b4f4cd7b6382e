"""Paths of bodies in a CSV with named columns: time, x, y, heading; body where there are several.

For home-made trackers, and those without a reader of their own. Other columns, comments and what
stands above the names are ignored. A name may have its unit beside it, as x [mm] or x_mm; the other
units are said by whoever reads the file. A row with a blank number, with nan or with nothing but
zeros is one at which the body was lost.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.text_table import is_comment, number_of, read_rows, wrong_line

NUMBERS = ("time", "x", "y", "heading")
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}
_LOST = ("na", "n/a", "-", "--", "none", "null")  # for a number, beside a blank and nan
_MOST_ROWS_ABOVE, _SHOWN = 20, 80


@dataclass(frozen=True, slots=True)
class BodyPath:
    """Where a tracker saw one body: times (n,) s by the tracker's own clock, ascending; poses
    (n, 3): x, y (m) on the floor, heading (rad)."""

    name: str
    times: FloatArray
    poses: FloatArray


@dataclass(frozen=True, slots=True)
class Units:
    """What one of a file's units of time, length and angle is in s, m and rad."""

    time: float = 1.0
    length: float = 1.0
    angle: float = 1.0


def units_of(text: str) -> Units:
    """Units as written: "s,m,rad", "ms,mm,deg". Raises ValueError, as text, for others."""
    parts = [part.strip() for part in text.split(",")]
    tables = (_TIMES, _LENGTHS, _ANGLES)
    known = ",".join("|".join(table) for table in tables)
    if len(parts) != len(tables) or any(p not in t for p, t in zip(parts, tables, strict=True)):
        raise ValueError(f"{text!r} is not {known}, as s,mm,deg")
    return Units(*(table[part] for part, table in zip(parts, tables, strict=True)))


def read_paths(path: Path, units: Units) -> list[BodyPath]:
    """The path of each body. Raises UserError naming line and column of what is wrong."""
    rows, _ = read_rows(path, "give a CSV with the columns time, x, y, heading")
    lines = [(number, row) for number, row in enumerate(rows, 1) if not is_comment(row)]
    head = [_Heading.read(cell) for cell in _heading_row(lines, path)]
    names = [each.name for each in head]
    columns = [names.index(name) for name in NUMBERS]
    scale = [
        head[k].scale or said
        for k, said in zip(
            columns, (units.time, units.length, units.length, units.angle), strict=True
        )
    ]
    body = names.index("body") if "body" in names else None
    found: dict[str, list[list[float]]] = {}
    for number, row in lines:
        if len(row) < len(names) or any(cell.strip() for cell in row[len(names) :]):
            commas = ": do decimals stand after commas?" if len(row) > len(names) else ""
            raise wrong_line(path, number, f"it has {len(row)} of {len(names)} cells{commas}")
        values = [
            _number(row[k], path, number, name) for k, name in zip(columns, NUMBERS, strict=True)
        ]
        track = found.setdefault("" if body is None else row[body].strip(), [])
        if track and values[0] == track[-1][0]:
            raise wrong_line(
                path,
                number,
                f"its time ({row[columns[0]]}) is that of the line before",
                "if times were rounded, export them with more digits; else remove one of both",
            )
        if math.isnan(values[0]) or (track and values[0] <= track[-1][0]):
            raise wrong_line(
                path,
                number,
                f"its time ({row[columns[0]]}) does not come after the last",
                "sort the lines by time, with each time once for a body",
            )
        track.append(values)
    if not found:
        raise wrong_line(path, len(rows), "no line with numbers follows the column names")
    return [_path(name, np.array(track) * scale) for name, track in found.items()]


def _path(name: str, table: FloatArray) -> BodyPath:
    table = table[np.isfinite(table).all(axis=1) & np.any(table[:, 1:] != 0.0, axis=1)]
    return BodyPath(name, table[:, 0], table[:, 1:])


@dataclass(frozen=True, slots=True)
class _Heading:
    """The name of a column, in small letters, and its unit in s, m or rad; 0: it names none."""

    name: str
    scale: float = 0.0

    @classmethod
    def read(cls, cell: str) -> "_Heading":
        text = cell.strip().lower()
        found = re.fullmatch(r"(\w+?)\s*(?:[\[(]\s*(.*?)\s*[\])]|_(\w+))", text)
        if found and found[1] in NUMBERS:
            known = dict(zip(NUMBERS, (_TIMES, _LENGTHS, _LENGTHS, _ANGLES), strict=True))[found[1]]
            unit = found[2] if found[2] is not None else found[3]
            if unit in known:
                return cls(found[1], known[unit])
        return cls(text)


def _heading_row(lines: list[tuple[int, list[str]]], path: Path) -> list[str]:
    """The row that names the columns; it and those above are taken off `lines`."""
    for index, (_, row) in enumerate(lines[:_MOST_ROWS_ABOVE]):
        names = [_Heading.read(cell).name for cell in row]
        if set(NUMBERS) <= set(names):
            twice = next((name for name in (*NUMBERS, "body") if names.count(name) > 1), None)
            if twice:
                raise _unnamed(path, f"more than one column is called {twice}", row)
            del lines[: index + 1]
            return row
    first = max((row for _, row in lines[:_MOST_ROWS_ABOVE]), key=_named, default=[])
    names = [_Heading.read(cell).name for cell in first]
    absent = next(name for name in NUMBERS if name not in names)
    raise _unnamed(path, f"no column is called {absent}", first)


def _named(row: list[str]) -> int:
    """How many of the columns a row names."""
    return len({_Heading.read(cell).name for cell in row} & set(NUMBERS))


def _unnamed(path: Path, what: str, row: list[str]) -> UserError:
    names = ", ".join(cell.strip() for cell in row)
    return UserError(
        f"{path}: {what}",
        f"its line of names is: {names[:_SHOWN]}" if names else "it is empty",
        f"name the columns {','.join(NUMBERS)} (and body, where there are several), each with its "
        "unit if you like, as x [mm]",
    )


def _number(cell: str, path: Path, line: int, name: str) -> float:
    try:
        return math.nan if cell.strip().lower() in _LOST else number_of(cell)
    except ValueError:
        raise wrong_line(
            path,
            line,
            f"{name} is no number: {cell.strip()[:_SHOWN]!r}",
            "correct it, or leave it blank where the body was lost",
        ) from None
