"""CSV exports of Vicon's Tracker (Objects) and Nexus (Segments): the bodies' global poses.

Above the rows stand the kind of block, the frame rate, the names (a body's first column says
`Global Angle NAME:NAME` or `SUBJECT:SEGMENT`), `Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ,...`, and the
units. A blank line ends a block; those of markers or devices are left out. Rotations are Euler
angles or helical (axis times angle), which the file does not say: both are the same heading RZ of a
body whose z-axis is upright. With RW they are quaternions. Source of the form: Vicon's guide to
Tracker 4.1, "Exporting data to CSV", and exports that others read (AG6GR/Vicon_CSV on GitHub).
"""

import math
from pathlib import Path

import numpy as np

from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.posed_body import PosedBody, posed_body
from host.recording.elsewhere.text_table import number_of, read_rows, wrong_line

_KINDS = ("objects", "segments")
_OTHER_KINDS = ("trajectories", "devices", "joints", "model outputs")
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "deg": math.pi / 180.0, "rad": 1.0, "": 1.0}
_PLACE, _ANGLES, _QUATERNION = ("TX", "TY", "TZ"), ("RX", "RY", "RZ"), ("RX", "RY", "RZ", "RW")
_UPRIGHT_RAD = math.radians(20.0)
_HEAD = 5  # rows above the numbers

_NEXT = "export the objects of Tracker, or the segments of Nexus, with their global poses"


def is_vicon(rows: list[list[str]]) -> bool:
    """Whether the rows of a file are such an export's."""
    first = next((row[0] for row in rows if row), "").strip().lower()
    return first in (*_KINDS, *_OTHER_KINDS)


def read_vicon(path: Path) -> list[PosedBody]:
    """The bodies of all blocks. Raises UserError naming the line that cannot be read."""
    rows, _ = read_rows(path, _NEXT)
    found: list[PosedBody] = []
    begins = [k for k, row in enumerate(rows) if row and row[0].strip().lower() in _KINDS]
    for begin in begins:
        found += _block(path, rows, begin)
    if not found:
        raise UserError(f"{path} has no poses of bodies", "it is an export of Vicon", _NEXT)
    return found


def _block(path: Path, rows: list[list[str]], begin: int) -> list[PosedBody]:
    head = [[cell.strip() for cell in row] for row in rows[begin : begin + _HEAD]]
    if len(head) < _HEAD or head[3][:1] != ["Frame"]:
        raise wrong_line(path, begin + 4, "the columns' names do not begin with Frame")
    try:
        rate = number_of(head[1][0])
    except (IndexError, ValueError):
        rate = math.nan
    if not 0.0 < rate < math.inf:
        raise wrong_line(path, begin + 2, "the frame rate is missing", _NEXT)
    table = _numbers(path, rows, begin + _HEAD, len(head[3]))
    scale = np.array([_UNITS.get(cell, math.nan) for cell in _filled(head[4], len(head[3]))])
    begins = [k for k, cell in enumerate(_filled(head[2], len(head[3]))) if cell]
    if not begins:
        raise wrong_line(path, begin + 3, "the bodies' names are missing", _NEXT)
    ends = [*begins[1:], len(head[3])]
    return [
        _body(path, head[2][first], table[:, 0] / rate, dict(zip(names, columns, strict=True)))
        for first, end in zip(begins, ends, strict=True)
        if set(_PLACE) <= set(names := head[3][first:end])
        for columns in [(table[:, first:end] * scale[first:end]).T]
    ]


def _numbers(path: Path, rows: list[list[str]], first: int, width: int) -> FloatArray:
    """The rows (n, width) up to a blank line; nan where blank."""
    table = []
    for line, row in enumerate(rows[first:], first + 1):
        if not any(cell.strip() for cell in row):
            break
        try:
            table.append([number_of(cell) for cell in _filled(row, width)])
        except ValueError:
            raise wrong_line(path, line, f"it holds no numbers: {','.join(row)[:80]!r}") from None
    return np.array(table).reshape(-1, width)


def _filled(row: list[str], width: int) -> list[str]:
    """A row of `width` cells: spreadsheets leave out blank ones at the end."""
    return [*row, *[""] * (width - len(row))][:width]


def _body(path: Path, title: str, times: FloatArray, columns: dict[str, FloatArray]) -> PosedBody:
    name = title.removeprefix("Global Angle ")
    subject, _, segment = name.partition(":")
    name = subject if segment in ("", subject) else name
    positions = np.stack([columns[axis] for axis in _PLACE], axis=1)
    positions[~positions.any(axis=1)] = math.nan  # zeros: the body was lost
    wanted = _QUATERNION if "RW" in columns else _ANGLES
    if not set(wanted) <= set(columns):
        raise UserError(f"{path}: body {name} has no rotation", "RX, RY, RZ are missing", _NEXT)
    rotation = np.stack([columns[axis] for axis in wanted], axis=1)
    if "RW" in columns:
        return posed_body(name, times, positions, rotation)
    leaning = np.hypot(rotation[:, 0], rotation[:, 1])
    if np.isfinite(leaning).any() and np.nanmedian(leaning) > _UPRIGHT_RAD:
        raise UserError(
            f"{path}: body {name} does not stand upright",
            f"RX and RY are {math.degrees(np.nanmedian(leaning)):.0f} deg from zero",
            "let the object's z-axis point up in Vicon, with z up, and export again",
        )
    half = np.where(np.isfinite(rotation[:, 2]), 0.5 * rotation[:, 2], math.nan)
    level = np.zeros((len(half), 2))
    return posed_body(name, times, positions, np.column_stack((level, np.sin(half), np.cos(half))))
