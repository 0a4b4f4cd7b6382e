"""The rows of Motive's CSV exports, formats 1.2 to 1.25: what each column holds, and the numbers.

The first line holds names and values alternately. Then come rows that say of each column what it is
(type, name, ID, from 1.25 also the parent, kind of quantity, and the axis in the row that begins
with "Frame"), and one row a frame. Cells are blank where something was not seen. Rows are found by
their labels; 1.21 and before label none, but keeps their order.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from host.errors import UserError
from host.messages import FloatArray, IntArray
from host.recording.elsewhere.text_table import is_comment, number_of, read_rows

FORMATS = ("1.2", "1.20", "1.21", "1.22", "1.23", "1.24", "1.25")
UNITS_M = {"Meters": 1.0, "Centimeters": 0.01, "Millimeters": 0.001}
_ORDERS = {"".join(order) for order in itertools.permutations("XYZ")}
_KNOWN = {
    "Rotation Type": {"Quaternion", *_ORDERS},
    "Length Units": set(UNITS_M),
    "Coordinate Space": {"Global"},
}
_LABELS = ("type", "name", "id", "parent")
_MOST_ROWS_ABOVE = 12


@dataclass(frozen=True, slots=True)
class Column:
    """What one column holds: of which thing, which quantity (in lower case), along which axis."""

    kind: str
    name: str
    identity: str
    quantity: str
    axis: str


@dataclass(frozen=True, slots=True)
class Table:
    """An export. header: the first line's names and values. frames (n,): their numbers; times (n,)
    s since the start; values (n, columns), nan where blank."""

    header: dict[str, str]
    columns: list[Column]
    frames: IntArray
    times: FloatArray
    values: FloatArray


def is_motive(rows: list[list[str]]) -> bool:
    """Whether the rows of a file are those of an export of Motive, of whichever format."""
    return bool(rows) and rows[_begin(rows)][:1] == ["Format Version"]


def _begin(rows: list[list[str]]) -> int:
    """Index of the first row that is neither blank nor a comment; 0 where all are."""
    return next((k for k, row in enumerate(rows) if not is_comment(row)), 0)


def read_table(path: Path) -> Table:
    """Read every cell of an export. Raises UserError naming line or column of what is wrong."""
    rows, ended = read_rows(path, "give the path of a CSV export of Motive")
    begin = _begin(rows)
    header = _header(rows[begin] if rows else [], path)
    first = _frame_row(rows, path)
    rows = _without_blank_columns(rows, begin + 1, first)
    columns, start = _columns(rows[begin + 1 : first + 1], path)
    numbers = _numbers(rows, first, start, path)
    _check_whole(header, numbers, path)
    if not ended:  # Motive ends every line, so the last number may be cut
        raise _cut(path, len(rows), "the line is not ended")
    frames, times = numbers[:, 0].astype(np.int64), numbers[:, 1].copy()
    return Table(header, columns, frames, times, numbers[:, start:])


def _without_blank_columns(rows: list[list[str]], begin: int, last: int) -> list[list[str]]:
    """The rows without cells that spreadsheets append: right of all that rows begin to last name.

    Rows with anything there are left as they are.
    """
    named = [k for row in rows[begin : last + 1] for k, cell in enumerate(row) if cell.strip()]
    width = max(named, default=0) + 1
    return [row if any(cell.strip() for cell in row[width:]) else row[:width] for row in rows]


def _header(row: list[str], path: Path) -> dict[str, str]:
    """The first line's names and values, checked as far as reading on depends on them."""
    header = {name.strip(): value.strip() for name, value in zip(row[::2], row[1::2], strict=False)}
    version = header.get("Format Version", "").replace(",", ".")
    if not version:
        raise UserError(
            f"{path}, line 1: no export of Motive",
            "it does not begin with Format Version",
            "export the take as CSV with Motive",
        )
    if version not in FORMATS:
        raise UserError(
            f"{path}, line 1: format {version} is not understood",
            f"known are {FORMATS[0]} to {FORMATS[-1]}",
            "export the take again with a Motive that writes one of those",
        )
    for name, values in _KNOWN.items():
        if header.get(name) not in values:
            raise UserError(
                f"{path}, line 1: {name} is {header.get(name) or 'missing'}",
                f"known are {', '.join(sorted(values))}",
                "export the take again with one of those",
            )
    return header


def _frame_row(rows: list[list[str]], path: Path) -> int:
    """Index of the row that begins with Frame."""
    for index, row in enumerate(rows[:_MOST_ROWS_ABOVE]):
        if row and row[0].strip() == "Frame":
            return index
    raise UserError(
        f"{path}: no row of column names",
        f"none of the first {_MOST_ROWS_ABOVE} lines begins with Frame",
        "export the take again with the header and column names ticked",
    )


def _columns(rows: list[list[str]], path: Path) -> tuple[list[Column], int]:
    """What the columns hold, and how many come before them (frame, time, perhaps a timecode).

    rows: those between the first line and the frames.
    """
    about = [row for row in rows[:-1] if any(cell.strip() for cell in row)]
    axes = rows[-1]
    if len(axes) < 2 or not axes[1].strip().startswith("Time"):
        raise no_column(path, "Time")
    start = next((k for k in range(2, len(axes)) if axes[k].strip() != "TimeCode"), len(axes))
    labelled = {row[1].strip().lower(): row for row in about if len(row) > 1}
    kinds = about[-1] if about else []
    if "type" not in labelled:  # as 1.21 has it
        labelled = dict(zip(_LABELS, about[:-1], strict=False))
    for label in _LABELS[:3]:
        if label not in labelled:
            raise UserError(
                f"{path}: the row with the {label} of each column is missing",
                "",
                "export it again with the header ticked",
            )
    described = [labelled["type"], labelled["name"], labelled["id"], kinds, axes]
    if any(len(row) != len(axes) for row in described):
        raise UserError(
            f"{path}: the rows above the frames differ in length",
            f"the row of column names has {len(axes)} cells",
            "the file is damaged: export it again",
        )
    columns = [
        Column(kind.strip(), name.strip(), identity.strip(), what.strip().lower(), axis.strip())
        for kind, name, identity, what, axis in zip(
            *(row[start:] for row in described), strict=True
        )
    ]
    return columns, start


def _numbers(rows: list[list[str]], first: int, start: int, path: Path) -> FloatArray:
    """The frames' cells (n, columns), nan where blank and for a timecode."""
    width = len(rows[first])
    numbers = np.full((len(rows) - first - 1, width), np.nan)
    count = 0
    for line, row in enumerate(rows[first + 1 :], first + 2):
        if not any(cell.strip() for cell in row):
            continue
        if _begins_section(row):
            raise UserError(
                f"{path}, line {line}: another section begins",
                "several exports, or one in parts, stand in one file",
                "save each as a file of its own, and take the one that covers the drive",
            )
        if len(row) != width:
            commas = ", as if decimals stood after commas" if len(row) > 1.5 * width else ""
            raise _cut(path, line, f"{len(row)} of {width} cells{commas}")
        cells = row if start == 2 else [*row[:2], *[""] * (start - 2), *row[start:]]
        try:
            numbers[count] = [number_of(cell) for cell in cells]
        except ValueError:
            raise _no_number(path, line, cells) from None
        count += 1
    return numbers[:count]


def _begins_section(row: list[str]) -> bool:
    """Whether a row is one of those above the frames, once more."""
    frame, time = row[0].strip(), "".join(row[1:2]).strip()
    return frame in ("Format Version", "Frame") or not (frame or time[:1].isdigit())


def _cut(path: Path, line: int, why: str) -> UserError:
    return UserError(
        f"{path}, line {line} is cut: {why}", "", "the file is not whole: copy or export it again"
    )


def _no_number(path: Path, line: int, cells: list[str]) -> UserError:
    for column, cell in enumerate(cells, 1):
        try:
            number_of(cell)
        except ValueError:
            what = f"{path}, line {line}, column {column}: {cell!r} is no number"
            return UserError(what, "", "the file is damaged: export it again")
    return UserError(f"{path}, line {line}: no numbers")


def _check_whole(header: dict[str, str], numbers: FloatArray, path: Path) -> None:
    """Frames as many as the header says, in order of time."""
    promised = header.get("Total Exported Frames", "")
    if promised.isdigit() and int(promised) != len(numbers):
        raise UserError(
            f"{path} holds {len(numbers)} frames, but should hold {promised}",
            "Total Exported Frames in line 1 says so",
            "the file is not whole: copy or export it again; if you split it, write the number of "
            "frames there",
        )
    order = numbers[:, :2]
    if not np.isfinite(order).all() or np.any(np.diff(order, axis=0) <= 0.0):
        raise UserError(
            f"{path}: its frames are not in order",
            "a frame's number or time is missing or goes back",
            "the file is damaged: export it again",
        )


def no_column(path: Path, name: str) -> UserError:
    """The error for a column that is not there."""
    return UserError(
        f"{path}: the column {name} is missing",
        "",
        "export it again with Motive, with all columns of its bodies",
    )
