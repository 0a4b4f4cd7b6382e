"""The true paths of bodies in a file of any tracker: another kind of file is a reader more here."""

import difflib
from pathlib import Path

import numpy as np

from host.drivers.natnet.protocol import Up, floor_poses
from host.errors import UserError
from host.messages import FloatArray
from host.recording.elsewhere.bag_poses import is_bag, read_bag_bodies
from host.recording.elsewhere.motive_csv import read_take
from host.recording.elsewhere.motive_table import is_motive
from host.recording.elsewhere.named_columns import BodyPath, Units, read_paths
from host.recording.elsewhere.posed_body import PosedBody
from host.recording.elsewhere.qualisys_tsv import is_qualisys, read_qualisys
from host.recording.elsewhere.text_table import read_rows
from host.recording.elsewhere.vicon_csv import is_vicon, read_vicon

_LEVEL_M = 0.1  # by more, what drives on a floor does not rise
_FORMS = "give an export of Motive, Vicon or QTM, a CSV with named columns, or a ROS bag"


def read_truth(path: Path, units: Units) -> list[BodyPath]:
    """The bodies in a ROS bag or an export of Motive, Vicon or QTM, which state their units, or in
    a CSV with named columns.

    Raises UserError naming what of the file cannot be read.
    """
    if is_bag(path):
        return _posed(read_bag_bodies(path))
    rows, _ = read_rows(path, _FORMS)
    if is_vicon(rows):
        return _posed(read_vicon(path))
    if is_qualisys(rows):
        return _posed(read_qualisys(path))
    if not is_motive(rows):
        return read_paths(path, units)
    take = read_take(path)
    return [
        _body_path(b.name, take.times[seen], b.positions[seen], b.quaternions[seen], "y")
        for b, seen in ((body, body.tracked) for body in take.bodies)
    ]


def _posed(bodies: list[PosedBody]) -> list[BodyPath]:
    return [_body_path(b.name, b.times, b.positions, b.quaternions, "z") for b in bodies]


def _body_path(
    name: str, times: FloatArray, positions: FloatArray, quaternions: FloatArray, usual: Up
) -> BodyPath:
    return BodyPath(name, times, floor_poses(positions, quaternions, _up(positions, usual)))


def _up(places: FloatArray, usual: Up) -> Up:
    """The usual axis, unless the robot moves along it and not along the other."""
    if not len(places):
        return usual
    _, y, z = np.ptp(places, axis=0)
    if usual == "y":
        return "z" if y > _LEVEL_M > z else "y"
    return "y" if z > _LEVEL_M > y else "z"


def body_of(paths: list[BodyPath], name: str, file: str) -> BodyPath:
    """The body called `name`; "": the only one. Raises UserError naming those there are."""
    found = [path for path in paths if path.name == name or (not name and len(paths) == 1)]
    if len(found) == 1:
        return found[0]
    names = [path.name for path in paths]
    near = difflib.get_close_matches(name, names, 1, 0.0) or ["BODY"]
    raise UserError(
        f"{file} has no body {name!r}" if name else f"which body of {file} is the robot?",
        f"its bodies: {', '.join(each or '(without a name)' for each in names) or 'none'}",
        f"name this robot's: --truth '{file}:{near[0]}'",
    )
