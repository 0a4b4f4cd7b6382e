"""The messages of a recording as tables, one a kind, that spreadsheets and pandas read.

Times in s by the recording's clock, lengths in m, angles in rad; numbers with every digit. A scan
has a row for each sample; bearings, estimates, truth and bodies have one for each thing in them.
"""

import contextlib
import csv
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np

from host.errors import UserError, cannot_write
from host.messages import (
    Bearings,
    Bodies,
    DeviceIdentity,
    Displacement,
    Estimate,
    Health,
    Message,
    Names,
    Positions,
    Scan,
    TeammateOdometry,
    Truth,
)

Rows = Iterable[Iterable[Any]]
_COVARIANCE = ("xx_m2", "xy_m2", "yy_m2")
_MOTION = (
    *("time_s", "interval_s", "dx_m", "dy_m", "dpsi_rad"),
    *("translation_variance_m2", "heading_variance_rad2"),
)


def _scan(scan: Scan) -> Rows:
    samples = zip(scan.times.tolist(), scan.angles.tolist(), scan.ranges.tolist(), strict=True)
    return ((scan.time, *sample) for sample in samples)


def _positions(found: Positions) -> Rows:
    return ((found.time, *row) for row in _with_covariance(found.positions, found.covariances))


def _bearings(seen: Bearings) -> Rows:
    for k, (bearing, variance) in enumerate(
        zip(seen.bearings.tolist(), seen.variances.tolist(), strict=True)
    ):
        distance = "" if seen.ranges is None else float(seen.ranges[k])
        yield seen.time, seen.camera, bearing, variance, distance, *seen.origin


def _displacement(step: Displacement) -> Rows:
    yield *_motion(step), *(step.ticks or ("", ""))


def _teammate_odometry(heard: TeammateOdometry) -> Rows:
    yield *_motion(heard), heard.identity, heard.restarted


def _motion(step: Displacement | TeammateOdometry) -> tuple[float, ...]:
    moved = step.dx, step.dy, step.dpsi, step.translation_variance, step.heading_variance
    return step.time, step.interval, *moved


def _names(names: Names) -> Rows:
    columns = names.labels, names.identities, names.probabilities, names.headings
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return ((names.time, *row) for row in rows)


def _estimate(estimate: Estimate) -> Rows:
    places = _with_covariance(estimate.positions, estimate.covariances)
    rest = (estimate.labels.tolist(), estimate.weights.tolist(), estimate.ages.tolist())
    for label, weight, age, place in zip(*rest, places, strict=True):
        yield estimate.time, label, *place, weight, age


def _obstacles(estimate: Estimate) -> Rows:
    places = _with_covariance(estimate.obstacles, estimate.obstacle_covariances)
    return ((estimate.time, *place) for place in places)


def _truth(truth: Truth) -> Rows:
    for identity, position in zip(truth.identities.tolist(), truth.positions, strict=True):
        yield truth.time, identity, *position.tolist()


def _bodies(bodies: Bodies) -> Rows:
    for identity, pose in zip(bodies.identities.tolist(), bodies.poses, strict=True):
        yield bodies.time, identity, *pose.tolist()


def _health(health: Health) -> Rows:
    yield health.time, health.device, health.ok, health.reason, json.dumps(health.counts)


def _identity(identity: DeviceIdentity) -> Rows:
    yield identity.time, identity.device, json.dumps(identity.values)


def _with_covariance(positions: Any, covariances: Any) -> Iterator[list[float]]:
    upper = np.reshape(covariances, (-1, 4))[:, [0, 1, 3]]
    yield from np.column_stack((np.reshape(positions, (-1, 2)), upper)).tolist()


# By file: the kind of message, the columns, and the rows of a message.
_TABLES: dict[str, tuple[type[Message], tuple[str, ...], Callable[[Any], Rows]]] = {
    "scan": (Scan, ("time_s", "sample_s", "angle_rad", "range_m"), _scan),
    "positions": (Positions, ("time_s", "x_m", "y_m", *_COVARIANCE), _positions),
    "bearings": (
        Bearings,
        (
            *("time_s", "camera", "bearing_rad", "variance_rad2", "range_m"),
            "origin_x_m",
            "origin_y_m",
        ),
        _bearings,
    ),
    "displacement": (Displacement, (*_MOTION, "left_ticks", "right_ticks"), _displacement),
    "teammate_odometry": (
        TeammateOdometry,
        (*_MOTION, "identity", "restarted"),
        _teammate_odometry,
    ),
    "names": (Names, ("time_s", "label", "identity", "probability", "heading_rad"), _names),
    "estimate": (
        Estimate,
        ("time_s", "label", "x_m", "y_m", *_COVARIANCE, "weight", "age_s"),
        _estimate,
    ),
    "obstacles": (Estimate, ("time_s", "x_m", "y_m", *_COVARIANCE), _obstacles),
    "truth": (Truth, ("time_s", "identity", "x_m", "y_m"), _truth),
    "bodies": (Bodies, ("time_s", "identity", "x_m", "y_m", "heading_rad"), _bodies),
    "health": (Health, ("time_s", "device", "ok", "reason", "counts"), _health),
    "identity": (DeviceIdentity, ("time_s", "device", "values"), _identity),
}


class Tables:
    """A new folder of tables; a file appears with its first row. rows: how many there are, by file.

    Raises UserError where the folder exists or cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.rows: dict[str, int] = {}
        self._folder = folder
        self._files = contextlib.ExitStack()
        self._writers: dict[str, Any] = {}
        with self._writing():
            folder.mkdir(parents=True)

    def write(self, message: Message) -> None:
        """Append a message to its table. Raises UserError where that fails."""
        for name, (kind, columns, rows_of) in _TABLES.items():
            if not isinstance(message, kind):
                continue
            with self._writing():
                for row in rows_of(message):
                    self._writer(name, columns).writerow(row)
                    self.rows[name] = self.rows.get(name, 0) + 1

    def _writer(self, name: str, columns: tuple[str, ...]) -> Any:
        if name not in self._writers:
            path = self._folder / f"{name}.csv"
            file = self._files.enter_context(path.open("x", newline="", encoding="utf-8"))
            self._writers[name] = csv.writer(file)
            self._writers[name].writerow(columns)
        return self._writers[name]

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except FileExistsError as error:
            raise UserError(
                f"{self._folder} exists already", "nothing is overwritten", "name another folder"
            ) from error
        except OSError as error:
            next_step = "check the folder and the free space on its disk"
            raise cannot_write(f"into {self._folder}", error, next_step) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._writing():
            self._files.close()
