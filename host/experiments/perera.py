"""The figures of Perera 2021 (7, 8, 9, 23, 24) for any observer of any source."""

from collections.abc import Iterator
from itertools import groupby
from typing import Literal

import numpy as np

from host.calibration.result import ReportPicture, Series
from host.evaluation.curves import nearest_errors, time_over, times_of, weight_sums
from host.evaluation.metrics import Instant
from host.experiments.paper_figure import SHORT, Cell, PaperFigure, label, line
from host.experiments.published import OVER_30CM, REAL_TEAMMATES, beside_published
from host.geometry import Path, to_parent
from host.sessions.offline.evaluating import Scored

_KEEP_ALL_S = float("inf")


def figures(scored: Scored) -> Iterator[PaperFigure]:
    """All of them; those that compare sensors once a filter, the others once a filter and sensors.

    Each robot's error is its distance from the nearest reported estimate while it is in range.
    """
    for name, group in groupby(scored.scores.items(), key=lambda item: item[0][0]):
        by_sensors = {sensors: found.instants for (_, sensors), found in group}
        yield _time_over(name, by_sensors)
        yield _weights(name, by_sensors)
        for sensors, instants in by_sensors.items():
            yield _errors(name, sensors, instants)
            yield _paths(name, sensors, instants, scored)
    yield _beside_published(scored)


def _time_over(name: str, by_sensors: dict[str, list[Instant]]) -> PaperFigure:
    """Figures 7 and 24: share of the time in range for which each robot's error is over 30 cm."""
    found = {sensors: nearest_errors(instants) for sensors, instants in by_sensors.items()}
    robots = next(iter(found.values())).robots
    shares = {sensors: time_over(each.errors) for sensors, each in found.items()}
    mean = np.mean(list(shares.values()), axis=0)
    order = np.argsort(-np.nan_to_num(mean, nan=-1.0), kind="stable")  # never in range: last
    columns = {f"share {sensors}": share[order] for sensors, share in shares.items()}
    if len(robots) == REAL_TEAMMATES:
        known = {s: np.array(v) for s, v in OVER_30CM.items() if s in shares}
        columns |= {f"published {sensors}": values for sensors, values in known.items()}
    rank = np.arange(1.0, len(robots) + 1.0)
    drawn = tuple(
        Series(x=rank, y=100.0 * values, label=_named(column), style=_style(column))
        for column, values in columns.items()
    )
    rows: list[list[Cell]] = [
        [int(robots[order[k]]), *(float(values[k]) for values in columns.values())]
        for k in range(len(robots))
    ]
    return PaperFigure(
        f"time_over_30cm_{name}",
        ("robot", *columns),
        rows,
        ReportPicture(
            title=f"{name}: time with an error over 30 cm (Perera 2021, figures 7 and 24)",
            axes=("robots, worst first", "% of the time in range"),
            series=drawn,
        ),
    )


def _named(column: str) -> str:
    kind, _, sensors = column.partition(" ")
    short = SHORT.get(sensors, sensors)
    return f"published {short}" if kind == "published" else short


def _style(column: str) -> Literal["points", "bars"]:
    return "points" if column.startswith("published") else "bars"


def _weights(name: str, by_sensors: dict[str, list[Instant]]) -> PaperFigure:
    """Figures 8 and 24: the sum of the reported weights over time."""
    rows: list[list[Cell]] = []
    series = []
    for sensors, instants in by_sensors.items():
        times, (weights, wanted) = times_of(instants), weight_sums(instants)
        rows += [[sensors, *map(float, each)] for each in zip(times, weights, wanted, strict=True)]
        series.append(line(times, weights, SHORT.get(sensors, sensors)))
    series.append(line(times, wanted, "robots in range"))  # the same with all sensors
    return PaperFigure(
        f"weights_{name}",
        ("sensors", "time s", "sum of weights", "robots in range"),
        rows,
        ReportPicture(
            title=f"{name}: number of robots estimated (Perera 2021, figures 8 and 24)",
            axes=("time (s)", "sum of the reported weights"),
            series=tuple(series),
        ),
    )


def _errors(name: str, sensors: str, instants: list[Instant]) -> PaperFigure:
    """Figure 23: each robot's error over time."""
    found = nearest_errors(instants)
    rows: list[list[Cell]] = [
        [float(time), *map(float, errors)]
        for time, errors in zip(found.times, found.errors, strict=True)
    ]
    return PaperFigure(
        f"errors_{name}_{sensors}",
        ("time s", *(f"robot {robot} m" for robot in found.robots)),
        rows,
        ReportPicture(
            title=f"{label(name, sensors)}: distance errors (Perera 2021, figure 23)",
            axes=("time (s)", "distance of the nearest estimate (m)"),
            series=tuple(
                line(found.times, found.errors[:, k], f"robot {robot}" if k < 6 else "")
                for k, robot in enumerate(found.robots)
            ),
        ),
    )


def _paths(name: str, sensors: str, instants: list[Instant], scored: Scored) -> PaperFigure:
    """Figure 9: where robots in range and estimates were, in the frame of the odometry's start.

    Both are carried there by the odometry, so its drift bends both alike.
    """
    path = Path(_KEEP_ALL_S)
    for step in scored.motion:
        path.append(step)
    rows: list[list[Cell]] = []
    for at, pose in zip(instants, path.poses(times_of(instants)), strict=True):
        time, truth = at.estimate.time, to_parent(at.truth.positions, pose)
        for robot, (x, y) in zip(at.truth.identities, truth, strict=True):
            rows.append([time, "robot", int(robot), float(x), float(y)])
        for weight, (x, y) in zip(
            at.estimate.weights, to_parent(at.estimate.positions, pose), strict=True
        ):
            rows.append([time, "estimate", float(weight), float(x), float(y)])
    return PaperFigure(
        f"paths_{name}_{sensors}",
        ("time s", "what", "number or weight", "x m", "y m"),
        rows,
        ReportPicture(
            title=f"{label(name, sensors)}: paths and estimates (Perera 2021, figure 9)",
            axes=("x (m), in the frame of the odometry's start", "y (m)"),
            series=(
                *(_path_of(rows, robot) for robot in nearest_errors(instants).robots),
                _estimates(rows),
            ),
            equal=True,
        ),
    )


def _path_of(rows: list[list[Cell]], robot: int) -> Series:
    points = np.array([row[3:] for row in rows if row[1] == "robot" and row[2] == robot])
    return Series(x=points[:, 0], y=points[:, 1], style="line")


def _estimates(rows: list[list[Cell]]) -> Series:
    points = np.array([row[3:] for row in rows if row[1] == "estimate"]).reshape(-1, 2)
    return Series(x=points[:, 0], y=points[:, 1], label="estimates")


def _beside_published(scored: Scored) -> PaperFigure:
    rows: list[list[Cell]] = [
        [name, sensors, *measure]
        for (name, sensors), found in scored.scores.items()
        for measure in beside_published(found.instants, sensors)
    ]
    header = ("filter", "sensors", "measure", "where", "ours", "published")
    return PaperFigure("beside_published", header, rows)
