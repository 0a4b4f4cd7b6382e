"""6DOF exports of Qualisys' QTM as TSV: bodies' poses by frame.

Lines of a name and its value (NO_OF_FRAMES, FREQUENCY, DATA_INCLUDED, BODY_NAMES, ...), then the
columns' names, for each body X, Y, Z (mm), Roll, Pitch, Yaw (deg), Residual and the rotation matrix
Rot[0] to Rot[8], column by column; perhaps Frame and Time before them. A body that was lost has
blanks, or zeros. Source: QTM's manual, "Motion data (.tsv)", docs.qualisys.com, and an
export in shiplab/dt_cv on GitHub, whose Rot is that of its angles.
"""

import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.posed_body import PosedBody, posed_body
from host.recording.elsewhere.text_table import number_of, read_rows, wrong_line

_PLACE, _ANGLES = ("X", "Y", "Z"), ("Roll", "Pitch", "Yaw")
_MATRIX = tuple(f"Rot[{k}]" for k in range(9))
_MM = 1e-3
_MOST_ROWS_ABOVE = 20
_LARGEST = 1.1  # of a rotation's numbers
_NEXT = "export the 6DOF data of the bodies in QTM, as TSV with the header and column names"


def is_qualisys(rows: list[list[str]]) -> bool:
    """Whether the rows of a file are those of an export of QTM."""
    return any(row[:1] == ["DATA_INCLUDED"] for row in rows[:_MOST_ROWS_ABOVE])


def read_qualisys(path: Path) -> list[PosedBody]:
    """The bodies. Raises UserError naming the line that cannot be read, or what is missing."""
    rows, _ = read_rows(path, _NEXT)
    cells = [[cell.strip() for cell in row] for row in rows]
    at = next((k for k, row in enumerate(cells) if _begins_bodies(row)), len(rows))
    header = {row[0]: [cell for cell in row[1:] if cell] for row in cells[:at] if row}
    names = header.get("BODY_NAMES", [])
    if not names or at == len(rows):
        raise UserError(f"{path} has no poses of bodies", "it is an export of QTM", _NEXT)
    columns, bodies = _columns(cells[at], names)
    if len(bodies) != len(names):
        raise wrong_line(path, at + 1, f"it names X, Y, Z of {len(bodies)} of {len(names)} bodies")
    table = _numbers(path, rows, at + 1, len(columns))
    times = _times(path, table, columns, header)
    ends = [*bodies[1:], len(columns)]
    return [
        _body(path, name, times, dict(zip(columns[first:end], table[:, first:end].T, strict=True)))
        for name, first, end in zip(names, bodies, ends, strict=True)
    ]


def _begins_bodies(row: list[str]) -> bool:
    """Whether a row names the columns: X alone, or after a body's name."""
    return any(cell == "X" or cell.endswith(" X") for cell in row)


def _columns(row: list[str], names: list[str]) -> tuple[list[str], list[int]]:
    """The columns' names without those of the bodies, and where each body's begin."""
    width = max(k for k, cell in enumerate(row) if cell) + 1
    columns = [
        next((cell.removeprefix(f"{name} ") for name in names if cell.startswith(f"{name} ")), cell)
        for cell in row[:width]
        if cell not in names or cell in _PLACE
    ]
    return columns, [k for k, name in enumerate(columns) if name == "X"]


def _numbers(path: Path, rows: list[list[str]], first: int, width: int) -> FloatArray:
    """The rows (n, width); nan where blank."""
    table = []
    for line, row in enumerate(rows[first:], first + 1):
        if not any(cell.strip() for cell in row):
            continue
        if any(cell.strip() for cell in row[width:]) or len(row) < width - 1:
            raise wrong_line(path, line, f"it has {len(row)} cells, the columns' names {width}")
        try:
            table.append([number_of(cell) for cell in [*row, ""][:width]])
        except ValueError:
            raise wrong_line(path, line, "it holds something that is no number") from None
    return np.array(table).reshape(-1, width)


def _times(
    path: Path, table: FloatArray, columns: list[str], header: dict[str, list[str]]
) -> FloatArray:
    """s: the column Time, or frames by the frequency."""
    if "Time" in columns:
        return table[:, columns.index("Time")]
    frames = table[:, columns.index("Frame")] if "Frame" in columns else np.arange(len(table)) + 1.0
    try:
        rate = number_of(header.get("FREQUENCY", [""])[0])
    except (IndexError, ValueError):
        rate = math.nan
    if not 0.0 < rate < math.inf:
        raise UserError(
            f"{path}: the times of its frames are not known",
            f"it has no column Time, and FREQUENCY is {' '.join(header.get('FREQUENCY', ['']))!r}",
            "export it again with the times",
        )
    return np.asarray((frames - 1.0) / rate)


def _body(path: Path, name: str, times: FloatArray, columns: dict[str, FloatArray]) -> PosedBody:
    positions = _MM * np.stack(
        [columns.get(axis, np.full(len(times), math.nan)) for axis in _PLACE], 1
    )
    if set(_MATRIX) <= set(columns):
        matrices = np.stack([columns[k] for k in _MATRIX], axis=1).reshape(-1, 3, 3)
        seen = np.asarray((np.abs(matrices) < _LARGEST).all(axis=(1, 2)))
        seen[seen] = np.linalg.det(matrices[seen]) > 0.5
        rotations = Rotation.from_matrix(np.swapaxes(matrices[seen], 1, 2)) if seen.any() else None
    elif set(_ANGLES) <= set(columns):
        angles = np.stack([columns[k] for k in _ANGLES], axis=1)
        moved = positions.any(axis=1) | angles.any(axis=1)
        seen = np.asarray(np.isfinite(angles).all(axis=1) & moved)
        rotations = Rotation.from_euler("XYZ", angles[seen], degrees=True) if seen.any() else None
    else:
        raise UserError(f"{path}: body {name} has no rotation", "Rot and Yaw are missing", _NEXT)
    quaternions = np.full((len(times), 4), math.nan)
    if rotations is not None:
        quaternions[seen] = rotations.as_quat()
    return posed_body(name, times, positions, quaternions)
