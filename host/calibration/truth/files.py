"""The true paths of bodies in a file of any tracker: another kind of file is a reader more here."""

from pathlib import Path

import numpy as np

from host.drivers.natnet.protocol import Up, floor_poses
from host.errors import UserError
from host.recording.elsewhere.motive_csv import TakeBody, read_take
from host.recording.elsewhere.named_columns import BodyPath, Units, read_paths
from host.recording.elsewhere.text_table import read_rows

_LEVEL_M = 0.1  # by more, what drives on a floor does not rise


def read_truth(path: Path, units: Units) -> list[BodyPath]:
    """The bodies in a Motive export (which states its units) or in a CSV with named columns.

    Raises UserError naming what of the file cannot be read.
    """
    rows, _ = read_rows(path, "give a CSV export of Motive, or a CSV with named columns")
    if not any(rows) or rows[0][:1] != ["Format Version"]:
        return read_paths(path, units)
    take = read_take(path)
    return [_body_path(body, take.times) for body in take.bodies]


def _body_path(body: TakeBody, times: np.ndarray) -> BodyPath:
    seen = body.tracked
    poses = floor_poses(body.positions[seen], body.quaternions[seen], _up(body))
    return BodyPath(body.name, times[seen], poses)


def _up(body: TakeBody) -> Up:
    """Motive exports with y up unless set otherwise: the axis along which a robot does not move."""
    places = body.positions[body.tracked]
    if not len(places):
        return "y"
    _, y, z = np.ptp(places, axis=0)
    return "z" if y > _LEVEL_M > z else "y"


def body_of(paths: list[BodyPath], name: str, file: str) -> BodyPath:
    """The body called `name`; "": the only one. Raises UserError naming those there are."""
    found = [path for path in paths if path.name == name or (not name and len(paths) == 1)]
    if len(found) == 1:
        return found[0]
    known = ", ".join(path.name or "(without a name)" for path in paths) or "none"
    raise UserError(
        f"{file} has no body {name!r}" if name else f"which body of {file} is the robot?",
        f"its bodies: {known}",
        f"name this robot's: --truth '{file}:{paths[0].name if paths else 'BODY'}'",
    )
