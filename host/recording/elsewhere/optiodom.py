"""OptiOdom recordings: wheel encoders of a differential drive beside OptiTrack's true path.

A session is a folder of `*_run-NN.csv` and one `*_metadata.csv`. A row of a run is time (s), x, y
(m), heading (rad), ticks of the right wheel, ticks of the left wheel. That order was found in the
data: in all runs the heading grows where the first tick column counts more than the second. The
`*_odo.csv` beside a run have the two columns the other way round. Ticks are counts (with sign) in
the interval that ends at the row's time. Runs were brought to OptiTrack's time by their authors.
Source: Sousa, Petry, Moreira & Costa (2021), repository sousarbarb/odometry-calibration.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from host.config import Wheels
from host.errors import UserError
from host.messages import FloatArray, IntArray

_RUN = re.compile(r"_run-\d+\.csv$")
_COLUMNS = 6
_MOST_TICKS = 1 << 31  # in an interval; more is damage
_HOLE = 1.9  # usual intervals: a longer one has lost ticks


@dataclass(frozen=True, slots=True)
class OptiodomRun:
    """One run: wheel ticks and the true path.

    times (n,) s; ticks (n, 2): left, right, counted from the start. truth_times (m,) s, truth
    (m, 3): x, y (m), heading (rad, not wrapped) of the tracked body. wheels: the geometry as its
    authors measured it by hand.
    """

    name: str
    wheels: Wheels
    times: FloatArray
    ticks: IntArray
    truth_times: FloatArray
    truth: FloatArray


def read_runs(place: str | Path) -> list[OptiodomRun]:
    """Read the runs of a session, of all sessions below a folder, or one `*_run-NN.csv`.

    Raises UserError that names the file, and the line, for what is missing or wrong.
    """
    place = Path(place)
    if place.is_dir():
        paths = sorted(path for path in place.rglob("*.csv") if _RUN.search(path.name))
    else:
        paths = [place] if place.is_file() and _RUN.search(place.name) else []
    if not paths:
        raise UserError(
            f"there are no OptiOdom runs at {place}",
            "no file there is called *_run-NN.csv" if place.exists() else "no such file or folder",
            "give a session's folder, a folder of sessions, or one *_run-NN.csv",
        )
    return [_run(path) for path in paths]


def _run(path: Path) -> OptiodomRun:
    wheels = _nominal(path)
    rows: list[list[float]] = []
    for number, line in enumerate(_lines(path), 1):
        if line.strip(" ,\t"):
            rows.append(_row(path, number, line, rows))
    if len(rows) < 2:
        raise _wrong(path, max(1, len(rows)), f"a run has two rows or more, this one {len(rows)}")
    table = np.array(rows)
    intervals = np.diff(table[:, 0])
    if np.any(holes := intervals > _HOLE * np.median(intervals)):
        first = int(np.argmax(holes))
        raise UserError(
            f"{path}: rows are missing after {table[first, 0]:.2f} s, for {intervals[first]:.2f} s",
            "the ticks that they counted are lost, so the path by the wheels breaks there",
            "save what is before and what is after as two runs",
        )
    seen = np.isfinite(table[:, 1:4]).all(axis=1)
    if np.count_nonzero(seen) < 2:
        raise _wrong(path, 1, "the columns of x, y and heading are empty")
    truth = table[seen, 1:4]
    truth[:, 2] = np.unwrap(truth[:, 2])
    ticks = np.cumsum(table[:, [5, 4]].astype(np.int64), axis=0)
    return OptiodomRun(path.stem, wheels, table[:, 0], ticks, table[seen, 0], truth)


def _row(path: Path, number: int, line: str, before: list[list[float]]) -> list[float]:
    """The numbers of one line; nan where a cell of x, y or heading is empty."""
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) != _COLUMNS:
        raise _wrong(path, number, f"expected {_COLUMNS} columns, found {len(cells)}")
    try:
        row = [float(cell) if cell else math.nan for cell in cells]
    except ValueError:
        raise _wrong(path, number, f"not numbers: {line.strip()!r}") from None
    whole = all(tick.is_integer() and abs(tick) < _MOST_TICKS for tick in row[4:])
    if not math.isfinite(row[0]) or not whole:
        raise _wrong(path, number, "time must be a number and ticks whole numbers")
    if before and row[0] <= before[-1][0]:
        raise _wrong(path, number, f"time goes from {before[-1][0]:.3f} to {row[0]:.3f} s")
    return row


def _nominal(run: Path) -> Wheels:
    """The geometry in the metadata beside a run."""
    session = _RUN.sub("", run.name)
    found = sorted(run.parent.glob("*_metadata.csv"))
    paths = [path for path in found if path.name == f"{session}_metadata.csv"] or found
    if len(paths) != 1:
        raise UserError(
            f"the geometry of {run} is not known",
            f"there are {len(paths)} files *_metadata.csv beside it"
            if paths
            else f"there is no {session}_metadata.csv beside it",
            f"copy {session}_metadata.csv of the data set into that folder",
        )
    entries: dict[str, tuple[int, list[str]]] = {}
    for number, line in enumerate(_lines(paths[0]), 1):
        key, *values = (cell.strip() for cell in line.split(","))
        entries[key] = number, values
    row, kind = entries.get("type", (1, ["diff"]))
    if kind[:1] != ["diff"]:
        raise _wrong(paths[0], row, f"the robot is of type {''.join(kind[:1])!r}, not 'diff'")
    (gear,), (resolution,) = (_numbers(paths[0], entries, key, 1) for key in ("ngear", "encRes"))
    (track,) = _numbers(paths[0], entries, "Li", 1)
    # Which of the diameters is the left one's is not said; in all sessions they are equal, so the
    # order of the runs' columns is as good as the other.
    right, left = _numbers(paths[0], entries, "Di", 2)
    counts = max(1, round(gear * resolution))
    # Counts are a whole number here. What rounding adds to them the radii carry, so that a tick
    # is as long as it was.
    longer = counts / (gear * resolution)
    try:
        return Wheels(
            left_radius_m=left / 2.0 * longer,
            right_radius_m=right / 2.0 * longer,
            track_m=track,
            counts_per_turn=counts,
        )
    except ValueError as error:
        raise _wrong(paths[0], 1, "no robot has such wheels") from error


def _numbers(
    path: Path, entries: dict[str, tuple[int, list[str]]], key: str, count: int
) -> list[float]:
    if key not in entries:
        raise UserError(
            f"{path} has no line {key!r}",
            "it has gear (ngear), counts a motor revolution (encRes), track (Li), diameters (Di)",
            "copy the metadata of the data set again",
        )
    number, cells = entries[key]
    try:
        values = [float(cell) for cell in cells[:count]]
    except ValueError:
        values = []
    if len(values) != count or not all(0.0 < value < math.inf for value in values):
        raise _wrong(path, number, f"{key} must be followed by {count} positive number(s)")
    return values


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not a text file"
        raise UserError(
            f"cannot read {path}", why or str(error), "copy it again from the data set"
        ) from error


def _wrong(path: Path, line: int, why: str) -> UserError:
    return UserError(
        f"{path}, line {line}: not an OptiOdom file", why, "copy it again from the data set"
    )
