"""Sensors that fail, put into what was recorded or simulated: settings of any source.

    arena4:seconds=60,camera_false=5,lidar_garbage=0.2     today.mcap:camera_dead=20-40

They follow Belaroussi 2024, section 6.2.8 (a camera that reports many robots that are not there,
a lidar that finds robots where there are none); a camera that is dead for a while comes on top.
"""

import math
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from host.errors import UserError
from host.geometry import wrap
from host.messages import Bearings, Displacement, FloatArray, Measurement, Scan

_GARBAGE_RANGE_M = (0.12, 10.0)  # what an X4 can report
_FALSE_RANGE_M = (0.3, 3.0)  # of a false robot, where the camera reports ranges
_FALSE_RANGE_STD = 0.1  # of the range
_FALSE_STD_RAD = math.radians(5.0)  # of a bearing, in a picture that shows nobody else
_MOST_FALSE = 100.0


@dataclass(frozen=True, slots=True)
class Faults:
    """What is wrong with the sensors; by default nothing.

    camera_false: expected number of false robots in a picture all around (an image pair).
    lidar_garbage: share of the lidar's samples that have a random range instead of their own.
    camera_dead: from when to when there are no pictures, s from the beginning.
    """

    camera_false: float = 0.0
    lidar_garbage: float = 0.0
    camera_dead: tuple[float, float] = (0.0, 0.0)

    def applied(
        self, messages: Iterable[Measurement | Displacement], seed: int
    ) -> list[Measurement | Displacement]:
        """The messages as the faulty sensors would have given them; the same for the same seed."""
        return list(self._applied(messages, seed))

    def _applied(
        self, messages: Iterable[Measurement | Displacement], seed: int
    ) -> Iterator[Measurement | Displacement]:
        camera, lidar = _generator(seed, "false robots"), _generator(seed, "lidar garbage")
        begin = math.nan
        for message in messages:
            begin = message.time if math.isnan(begin) else begin
            if isinstance(message, Scan) and self.lidar_garbage:
                yield _garbled(message, self.lidar_garbage, lidar)
            elif isinstance(message, Bearings):
                if not self.camera_dead[0] <= message.time - begin < self.camera_dead[1]:
                    yield _crowded(message, self.camera_false, camera)
            else:
                yield message


NONE = Faults()
_NAMES = tuple(field.name for field in fields(Faults))


def split(source: str) -> tuple[str, Faults]:
    """A source without its faults, and these. Raises UserError for a value that cannot be."""
    name, colon, given = source.rpartition(":")
    if not colon:
        return source, NONE
    kept: list[str] = []
    values: dict[str, Any] = {}
    for setting in given.split(","):
        key, _, value = (part.strip() for part in setting.partition("="))
        if key not in _NAMES:
            kept.append(setting)
        elif key in values:
            raise UserError(f"{source!r} sets {key} twice", "", "keep one of the two")
        else:
            values[key] = _value(key, value, source)
    if not values:
        return source, NONE
    rest = f"{name}:{','.join(kept)}" if kept else name
    return rest, replace(NONE, **values)


def _value(key: str, text: str, source: str) -> float | tuple[float, float]:
    what, example, most = {
        "camera_false": (f"a number from 0 to {_MOST_FALSE:g}", "5", _MOST_FALSE),
        "lidar_garbage": ("a share from 0 to 1", "0.2", 1.0),
        "camera_dead": ("from when to when, in s", "20-40", math.inf),
    }[key]
    numbers = [_number(part) for part in text.split("-")] if key == "camera_dead" else []
    value = _number(text)
    if len(numbers) == 2 and 0.0 <= numbers[0] < numbers[1] < most:
        return numbers[0], numbers[1]
    if not numbers and 0.0 <= value <= most:
        return value
    raise UserError(
        f"{source!r}: {key} cannot be {text!r}", f"it is {what}", f"write it as in {key}={example}"
    )


def _number(text: str) -> float:
    """nan, which is in no bounds, where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _generator(seed: int, purpose: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(purpose.encode())])


def _garbled(scan: Scan, share: float, random: np.random.Generator) -> Scan:
    hit = random.random(len(scan.ranges)) < share
    garbage = random.uniform(*_GARBAGE_RANGE_M, len(scan.ranges))
    return replace(scan, ranges=np.where(hit, garbage, scan.ranges))


def _crowded(seen: Bearings, expected: float, random: np.random.Generator) -> Bearings:
    """With false robots anywhere in view, as uncertain as the readings that there are."""
    centre, half_width = seen.view
    count = random.poisson(expected * half_width / math.pi)
    if not count:
        return seen
    false = wrap(random.uniform(centre - half_width, centre + half_width, count))
    variance = np.median(seen.variances) if len(seen.variances) else _FALSE_STD_RAD**2
    crowded = replace(
        seen,
        bearings=np.concatenate((seen.bearings, false)),
        variances=np.concatenate((seen.variances, np.full(count, variance))),
        pixels=None,
    )
    if seen.identities is not None:
        nobody = np.full(count, -1, dtype=np.int64)
        crowded = replace(crowded, identities=np.concatenate((seen.identities, nobody)))
    return _with_ranges(crowded, seen, random.uniform(*_FALSE_RANGE_M, count))


def _with_ranges(crowded: Bearings, seen: Bearings, ranges: FloatArray) -> Bearings:
    if seen.ranges is None or seen.range_variances is None:
        return crowded
    variances = (_FALSE_RANGE_STD * ranges) ** 2
    return replace(
        crowded,
        ranges=np.concatenate((seen.ranges, ranges)),
        range_variances=np.concatenate((seen.range_variances, variances)),
    )
