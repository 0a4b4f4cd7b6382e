"""A figure of a paper: its numbers, for a CSV file, and how it is drawn."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from host.calibration.report import diagram
from host.calibration.result import ReportPicture, Series
from host.errors import cannot_write
from host.messages import FloatArray
from host.sources.sensors import LIDAR_AND_CAMERA, LIDAR_ONLY

SHORT = {LIDAR_ONLY: "LO", LIDAR_AND_CAMERA: "LC"}  # as the thesis calls them

Cell = str | int | float


class PaperFigure(NamedTuple):
    """name: of its files. header: with units. picture: None where it is only a table."""

    name: str
    header: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    picture: ReportPicture | None = None


def label(filter_name: str, sensors: str) -> str:
    """What a curve is called: `phd LC`."""
    return f"{filter_name} {SHORT.get(sensors, sensors)}"


def line(x: FloatArray, y: FloatArray, name: str) -> Series:
    """A curve through points (n,), (n,)."""
    return Series(x=x, y=y, label=name, style="line")


def write(figure: PaperFigure, folder: Path, draw: bool) -> None:
    """Write NAME.csv into a folder and, where `draw`, NAME.svg and NAME.png.

    A cell that has no value is empty. Raises UserError where a file cannot be written.
    """
    stem = folder / figure.name
    try:
        with stem.with_name(f"{figure.name}.csv").open("w", newline="", encoding="utf-8") as file:
            lines = csv.writer(file, lineterminator="\n")
            lines.writerow(figure.header)
            lines.writerows([_text(cell) for cell in row] for row in figure.rows)
        if draw and figure.picture is not None:
            diagram.save(figure.picture, stem)
    except OSError as error:
        raise cannot_write(stem, error, "choose another folder") from error


def _text(cell: Cell) -> str:
    if isinstance(cell, float):
        return "" if math.isnan(cell) else f"{cell:.6g}"
    return str(cell)
