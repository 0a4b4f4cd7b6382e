"""What earlier fits left uncertain, kept beside robot.toml and carried into later fits.

A mounting is fitted against the tracked body, whose own pose on the robot the wheels' fit has
found. Its error is that of everything mounted relative to it, however well the lidar measures. The
covariances stand in `ROBOT.covariance.json` beside `ROBOT.toml`, with the values that they are of:
once a value is changed by hand, its covariance no longer counts.
"""

import dataclasses
import json
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from host.calibration.result import Calibration
from host.config import RobotConfig
from host.errors import UserError, cannot_write
from host.messages import FloatArray

BODY = ("mocap.x_m", "mocap.y_m", "mocap.heading_rad")
LIDAR = ("lidar.x_m", "lidar.y_m", "lidar.heading_rad")
_SCHEMA, _VERSION = "swarmloc.covariance", 1
_ROUNDED = 1e-5  # relative: robot.toml has six digits


@dataclass(frozen=True, slots=True)
class Entry:
    """Of one fit: keys of robot.toml (k,), their values (k,) and covariance (k, k), in SI units."""

    keys: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray


class Chain:
    """The entries of all fits so far, by the kind of calibration."""

    def __init__(self, entries: dict[str, Entry] | None = None) -> None:
        self.entries = dict(entries or {})

    def take(self, calibration: Calibration) -> None:
        """Put the covariance of a fit in the place of earlier ones of its values."""
        if calibration.joint is not None and np.isfinite(calibration.joint[1]).all():
            keys, covariance = calibration.joint
            settings = calibration.new_settings()
            values = np.array([settings[key] for key in keys])
            for kind in [k for k, entry in self.entries.items() if set(entry.keys) <= set(keys)]:
                del self.entries[kind]
            self.entries[calibration.kind] = Entry(keys, values, covariance)

    def covariance(self, config: RobotConfig, keys: Sequence[str]) -> FloatArray:
        """Of `keys` (k, k); zero where no fit has found them, or not as they are in `config`."""
        values = np.array([operator.attrgetter(key)(config) for key in keys])
        for entry in self.entries.values():
            if set(keys) <= set(entry.keys):
                at = [entry.keys.index(key) for key in keys]
                if np.allclose(values, entry.values[at], rtol=_ROUNDED, atol=1e-9):
                    return np.asarray(entry.covariance[np.ix_(at, at)])
        return np.zeros((len(keys), len(keys)))


def carried(slopes: FloatArray, base: FloatArray) -> FloatArray:
    """Covariance (k, k) of values with derivatives `slopes` (k, 3) by the pose of their base."""
    return np.asarray(slopes @ base @ slopes.T)


def by_base(place: FloatArray, base: FloatArray) -> FloatArray:
    """Derivatives (3, 3) of a mounting (x, y, heading) at `place` (2,) by a base's at `base` (2,).

    All that is fixed to the base moves with it: rotating it moves what is apart from it.
    """
    x, y = place - base
    return np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])


def file_of(robot: Path) -> Path:
    """Where the covariances of a robot.toml are kept."""
    return robot.with_suffix(".covariance.json")


def load(robot: Path | None) -> Chain:
    """What is kept beside a robot.toml; nothing where nothing is. Raises UserError for damage."""
    if robot is None or not file_of(robot).is_file():
        return Chain()
    path = file_of(robot)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if (content["schema"], content["version"]) != (_SCHEMA, _VERSION):
            raise ValueError("it is of another version")
        return Chain({kind: _entry(part) for kind, part in content["fits"].items()})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(
            f"cannot use {path}",
            f"it does not hold what a calibration wrote: {error}",
            "remove it, and calibrate again beginning with the wheels",
        ) from error


def _entry(part: dict[str, Any]) -> Entry:
    keys = tuple(map(str, part["keys"]))
    values, covariance = np.array(part["values"], float), np.array(part["covariance"], float)
    if values.shape != (len(keys),) or covariance.shape != (len(keys), len(keys)):
        raise ValueError("its tables differ in size")
    return Entry(keys, values, covariance)


def save(robot: Path, chain: Chain) -> None:
    """Keep a chain beside a robot.toml. Raises UserError where that fails."""
    fits = {kind: dataclasses.asdict(entry) for kind, entry in chain.entries.items()}
    content = {"schema": _SCHEMA, "version": _VERSION, "fits": fits}
    path = file_of(robot)
    try:
        text = json.dumps(content, indent=1, default=np.ndarray.tolist)
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise cannot_write(path, error, "check its folder") from error
