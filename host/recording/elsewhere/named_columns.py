"""Paths of bodies in a CSV with named columns: time, x, y, heading; body where there are several.

For Vicon, Qualisys and home-made trackers. Other columns are ignored, and so are lines that begin
with #. The file does not say its units: whoever reads it does. A row with a blank number, or with
nan, is one at which the body was lost.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.text_table import number_of, read_rows

NUMBERS = ("time", "x", "y", "heading")
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0}


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
    """Units as written: "s,m,rad", "ms,mm,deg". Raises ValueError, in words, for others."""
    parts = [part.strip() for part in text.split(",")]
    tables = (_TIMES, _LENGTHS, _ANGLES)
    known = ",".join("|".join(table) for table in tables)
    if len(parts) != len(tables) or any(p not in t for p, t in zip(parts, tables, strict=True)):
        raise ValueError(f"{text!r} is not {known}, as s,mm,deg")
    return Units(*(table[part] for part, table in zip(parts, tables, strict=True)))


def read_paths(path: Path, units: Units) -> list[BodyPath]:
    """The path of each body. Raises UserError naming line and column of what is wrong."""
    rows, _ = read_rows(path, "give a CSV with the columns time, x, y, heading")
    lines = [
        (number, row)
        for number, row in enumerate(rows, 1)
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
    ]
    names = [cell.strip().lower() for cell in lines[0][1]] if lines else []
    columns = [_column(name, names, path) for name in NUMBERS]
    body = names.index("body") if "body" in names else None
    found: dict[str, list[list[float]]] = {}
    for number, row in lines[1:]:
        if len(row) < len(names):
            raise _wrong(path, number, f"it has {len(row)} of {len(names)} cells")
        values = [
            _number(row[k], path, number, name) for k, name in zip(columns, NUMBERS, strict=True)
        ]
        track = found.setdefault("" if body is None else row[body].strip(), [])
        if math.isnan(values[0]) or (track and values[0] <= track[-1][0]):
            raise _wrong(path, number, f"its time ({row[columns[0]]}) does not come after the last")
        track.append(values)
    scale = units.time, units.length, units.length, units.angle
    paths = []
    for name, track in found.items():
        table = np.array(track) * scale
        table = table[np.isfinite(table).all(axis=1)]
        paths.append(BodyPath(name, table[:, 0], table[:, 1:]))
    if not paths:
        raise _wrong(path, len(rows), "no line with numbers follows the column names")
    return paths


def _column(name: str, names: list[str], path: Path) -> int:
    if names.count(name) != 1:
        raise UserError(
            f"{path}: {'no' if name not in names else 'more than one'} column is called {name}",
            f"its first line names {', '.join(names) or 'nothing'}",
            f"name the columns in the first line: {','.join(NUMBERS)} (and body, where there are "
            "several)",
        )
    return names.index(name)


def _number(cell: str, path: Path, line: int, name: str) -> float:
    try:
        return number_of(cell)
    except ValueError:
        raise _wrong(path, line, f"{name} is no number: {cell.strip()!r}") from None


def _wrong(path: Path, line: int, why: str) -> UserError:
    return UserError(
        f"{path}, line {line} cannot be read", why, "correct the line, or export the file again"
    )
