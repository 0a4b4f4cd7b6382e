"""Recorded turns of an X4, packed again as the bytes that the lidar must have sent."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from host.drivers.x4.packets import (
    UNITS_PER_REVOLUTION,
    angle_correction,
    encode_packet,
    encode_revolution,
)

NEXT_TURN = encode_packet(np.array([0]), 0, 0, True)  # tells a decoder that a turn is complete


@dataclass(frozen=True)
class RecordedTurn:
    """As the vendor's driver gave it: clockwise angles (n,) rad, ranges (n,) m; and its bytes."""

    angles: NDArray[np.float64]
    ranges: NDArray[np.float64]
    stream: bytes


def recorded_turns(file: Path, limit: int | None = None) -> Iterator[RecordedTurn]:
    """Whole turns among the first `limit` of a CSV with time_stamp, angle (rad) and range (m)."""
    turns: dict[str, list[tuple[float, float]]] = {}
    with file.open() as lines:
        for row in csv.DictReader(lines):
            turns.setdefault(row["time_stamp"], []).append(
                (float(row["angle"]), float(row["range"]))
            )
    for points in list(turns.values())[:limit]:
        angles, ranges = np.array(points).T
        raw = np.degrees(angles - angle_correction(ranges)) * 64.0
        units = np.rint(np.unwrap(raw, period=UNITS_PER_REVOLUTION)).astype(int)
        steps = np.diff(units)
        if steps.min() < 30 or steps.max() > 60:
            continue  # the vendor's driver lost a packet there
        samples = np.rint(ranges * 4000.0).astype(int)
        yield RecordedTurn(
            angles, ranges, b"".join(encode_revolution(units % UNITS_PER_REVOLUTION, samples))
        )
