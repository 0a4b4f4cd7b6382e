"""Motive's CSV exports, formats 1.2 to 1.25: takes of rigid bodies and markers.

The columns of a body or a marker are those with the same type, name and ID above them; how the
rows of the file are found stands in `motive_table`.
"""

import math
import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from host.errors import UserError
from host.messages import BoolArray, FloatArray, IntArray
from host.recording.elsewhere.motive_table import UNITS_M, Table, no_column, read_table
from host.recording.elsewhere.text_table import number_of

_NORM_TOLERANCE = 0.02  # of a quaternion; it is rounded, but not by this much
_ERRORS = ("mean marker error", "error per marker")


@dataclass(frozen=True, slots=True)
class TakeBody:
    """One rigid body, or a bone of a skeleton, in the take's n frames; nan where not tracked.

    positions (n, 3) m and quaternions (n, 4) x, y, z, w in Motive's axes; errors (n,) m: mean of
    its markers, nan where not exported; tracked (n,).
    """

    name: str
    identity: str
    positions: FloatArray
    quaternions: FloatArray
    errors: FloatArray
    tracked: BoolArray


@dataclass(frozen=True, slots=True)
class TakeMarker:
    """One marker. kind: "Marker" as it was measured, "Rigid Body Marker" as the body's fit has it.

    positions (n, 3) m, nan where not seen; qualities (n,) 0 to 1, nan where not exported.
    """

    kind: str
    name: str
    identity: str
    positions: FloatArray
    qualities: FloatArray


@dataclass(frozen=True, slots=True)
class MotiveTake:
    """A whole export. header: the first line's names and values. start: of the capture, in the
    local time of Motive's computer; None where it is written in another way.

    frames (n,): their numbers; times (n,) s since the start; rate_hz: of the exported frames.
    """

    header: dict[str, str]
    start: datetime | None
    rate_hz: float
    frames: IntArray
    times: FloatArray
    bodies: tuple[TakeBody, ...]
    markers: tuple[TakeMarker, ...]


def read_take(path: Path) -> MotiveTake:
    """Read an export. Raises UserError naming line or column of what is missing or not understood.

    Every cell is read; a column of an unknown kind is an error, not left out.
    """
    table = read_table(path)
    unit = UNITS_M[table.header["Length Units"]]
    bodies, markers = _things(table, unit, path)
    return MotiveTake(
        header=table.header,
        start=_start(table.header.get("Capture Start Time", "")),
        rate_hz=_rate(table.header, path),
        frames=table.frames,
        times=table.times,
        bodies=tuple(bodies),
        markers=tuple(markers),
    )


def _rate(header: dict[str, str], path: Path) -> float:
    for name in ("Export Frame Rate", "Capture Frame Rate"):
        try:
            rate = number_of(header.get(name, ""))
        except ValueError:
            continue
        if 0.0 < rate < math.inf:
            return rate
    raise UserError(
        f"{path}, line 1: no frame rate", "Export Frame Rate is missing", "export the take again"
    )


def _start(text: str) -> datetime | None:
    """2024-04-10 03.35.10.906 PM, or without AM and PM where the computer's language has none."""
    found = re.fullmatch(
        r"(\d{4})-(\d\d)-(\d\d) (\d\d)\.(\d\d)\.(\d\d)\.(\d{3})\s*(AM|PM)?", text, re.IGNORECASE
    )
    if not found:
        return None
    year, month, day, hour, minute, second, milli = map(int, found.groups()[:7])
    half = (found[8] or "").upper()
    if half:
        hour = hour % 12 + 12 * (half == "PM")
    try:
        return datetime(year, month, day, hour, minute, second, 1000 * milli)
    except ValueError:
        return None


def _things(table: Table, unit: float, path: Path) -> tuple[list[TakeBody], list[TakeMarker]]:
    """Bodies and markers: of columns that have type, name and ID in common."""
    groups: dict[tuple[str, str, str], dict[tuple[str, str], int]] = {}
    for index, column in enumerate(table.columns):
        group = groups.setdefault((column.kind, column.name, column.identity), {})
        if (column.quantity, column.axis.upper()) in group:
            raise UserError(
                f"{path}: {column.kind} {column.name} has {column.quantity} {column.axis} twice",
                "",
                "give bodies and markers different names in Motive, and export again",
            )
        group[column.quantity, column.axis.upper()] = index
    bodies: list[TakeBody] = []
    markers: list[TakeMarker] = []
    for (kind, name, identity), group in groups.items():
        taken = _Group(kind, name, group, table.values, path)
        positions = taken.take("position", "XYZ") * unit
        if any(quantity == "rotation" for quantity, _ in group) or kind in ("Rigid Body", "Bone"):
            quaternions = _quaternions(taken, table.header["Rotation Type"])
            _check_norms(quaternions, taken, table, path)
            errors = taken.take_optional(_ERRORS) * unit
            tracked: BoolArray = np.asarray(
                np.isfinite(positions).all(axis=1) & np.isfinite(quaternions).all(axis=1)
            )
            bodies.append(TakeBody(name, identity, positions, quaternions, errors, tracked))
        else:
            qualities = taken.take_optional(("marker quality",))
            markers.append(TakeMarker(kind, name, identity, positions, qualities))
        taken.check_nothing_left()
    return bodies, markers


class _Group:
    """The columns of one body or marker, handed out once each."""

    def __init__(
        self,
        kind: str,
        name: str,
        group: dict[tuple[str, str], int],
        values: FloatArray,
        path: Path,
    ) -> None:
        self.title = f"{kind} {name}"
        self._left = dict(group)
        self._values = values
        self._path = path

    def take(self, quantity: str, axes: str) -> FloatArray:
        """(n, axes). Raises UserError naming the column that is missing."""
        for axis in axes:
            if (quantity, axis) not in self._left:
                name = f"{quantity.capitalize()} {axis} of {self.title}"
                raise no_column(self._path, name)
        return self._values[:, [self._left.pop((quantity, axis)) for axis in axes]]

    def take_optional(self, quantities: tuple[str, ...]) -> FloatArray:
        """(n,) of the first of the quantities that there is; nan without one."""
        for quantity in quantities:
            if (quantity, "") in self._left:
                return self._values[:, self._left.pop((quantity, ""))]
        return np.full(len(self._values), np.nan)

    def check_nothing_left(self) -> None:
        """Raise UserError where a column was not taken."""
        for quantity, axis in self._left:
            raise UserError(
                f"{self._path}: the column {quantity} {axis} of {self.title} is not understood",
                "",
                "export the take again with rigid bodies and markers only",
            )


def _check_norms(quaternions: FloatArray, group: "_Group", table: Table, path: Path) -> None:
    """Make nan of quaternions that are all zero, as they are where tracking was lost.

    Raises UserError where one has another length than 1.
    """
    norms = np.linalg.norm(quaternions, axis=1)
    quaternions[norms == 0.0] = np.nan
    wrong = np.flatnonzero((norms > 0.0) & (np.abs(norms - 1.0) > _NORM_TOLERANCE))
    if len(wrong):
        raise UserError(
            f"{path}, frame {table.frames[wrong[0]]}: the rotation of {group.title} is none",
            f"its quaternion has the length {norms[wrong[0]]:.3g}, not 1",
            "the file is damaged: export it again",
        )


def _quaternions(group: _Group, rotation: str) -> FloatArray:
    """(n, 4) x, y, z, w; nan where any of the angles or components is blank.

    Euler angles are in degrees, about axes that rotate with the body (intrinsic), in the
    order of the rotation type.
    """
    if rotation == "Quaternion":
        found = group.take("rotation", "XYZW")
        found[np.isnan(found).any(axis=1)] = np.nan
        return found
    angles = group.take("rotation", rotation)
    known = np.isfinite(angles).all(axis=1)
    quaternions = np.full((len(angles), 4), np.nan)
    if known.any():
        quaternions[known] = Rotation.from_euler(rotation, angles[known], degrees=True).as_quat()
    return quaternions
