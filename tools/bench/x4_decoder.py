"""X4 decoding beside two public drivers: the same stream, in 512-byte chunks, in one process.

What the others leave out:
- PyLidar3 1.6 rounds angles to whole degrees and averages what falls into one, missing returns
  as 0 among them; interpolates between corrected end angles over LSN steps; drops the start
  packets and whatever straddles two reads; keeps no times; counts nothing.
- lds2d 0.7.0 has exact angles and re-synchronises, but truncates ranges to whole mm, keeps no
  times, breaks revolutions at 0 deg, and counts nothing.
Both deliver Python objects a point; ours arrays a revolution, with times, counter-clockwise.

PyLidar3 asks its port for 6000 bytes at a time (its default; with 512 it would be several times
slower), which a port waits for; lds2d takes what its transport returns. Both are given an object
that returns the stream and then raises EOFError. Sleeps are replaced.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import lds2d
import lds2d.drivers.ydlidar
import numpy as np
import PyLidar3

from host.drivers.x4.packets import UNITS_PER_REVOLUTION, encode_revolution
from host.drivers.x4.protocol import ScanDecoder

CHUNK = 512
FLOOR_PYLIDAR3 = 3.0
FLOOR_LDS2D = 5.0


def make_stream(revolutions: int, seed: int) -> tuple[bytes, int]:
    """Bytes of revolutions of 560-620 points, a third without return, and how many points."""
    random = np.random.default_rng(seed)
    packets: list[bytes] = []
    points = 0
    for _ in range(revolutions):
        n = int(random.integers(560, 621))
        angles = np.rint(346.6 * 64 + np.arange(n) * UNITS_PER_REVOLUTION / n).astype(int)
        samples = 4 * random.integers(120, 9000, n) * (random.random(n) > 1 / 3)
        packets += encode_revolution(angles % UNITS_PER_REVOLUTION, samples, 5000.0 / n)
        points += n
    return b"".join(packets), points


class FakePort:
    """Hands out a stream, at most `limit` bytes a read, and raises EOFError at its end."""

    def __init__(self, stream: bytes, limit: int) -> None:
        self._stream = stream
        self._limit = limit
        self._position = 0

    def read(self, size: int) -> bytes:
        if self._position >= len(self._stream):
            raise EOFError
        begin, self._position = self._position, self._position + min(size, self._limit)
        return self._stream[begin : self._position]

    def write(self, data: bytes) -> int:
        return len(data)

    def close(self) -> None:
        pass

    def reset_input_buffer(self) -> None:
        pass

    def setDTR(self, level: int) -> None:  # noqa: N802 (PyLidar3 calls it so)
        pass


def run_ours(stream: bytes) -> int:
    decoder = ScanDecoder()
    points = 0
    for begin in range(0, len(stream), CHUNK):
        for scan in decoder.feed(stream[begin : begin + CHUNK], begin / 11_300):
            points += len(scan.ranges)
    return points


def run_pylidar3(stream: bytes) -> int:
    PyLidar3.sleep = lambda seconds: None
    lidar = PyLidar3.YdLidarX4("none")
    lidar._s = FakePort(
        bytes(7) + stream, lidar.chunk_size
    )  # it reads away the 7 bytes of the scan reply
    lidar._is_connected = True
    points = 0
    try:
        for scan in lidar.StartScanning():
            points += len(scan)
    except EOFError:
        pass
    return points


def run_lds2d(stream: bytes) -> int:
    lidar = lds2d.Lidar.open("YDLIDAR-X4", transport=FakePort(stream, CHUNK))
    points = 0
    try:
        for scan in lidar.scans():
            points += len(scan.points)
    except EOFError:
        pass
    return points


def seconds(
    runs: dict[str, Callable[[bytes], int]], stream: bytes, repeats: int
) -> dict[str, float]:
    """Least CPU time of `repeats` runs of each, alternately, so that all see the same machine."""
    best = dict.fromkeys(runs, float("inf"))
    for _ in range(repeats):
        for name, run in runs.items():
            begin = time.process_time()
            run(stream)
            best[name] = min(best[name], time.process_time() - begin)
    return best


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--revolutions", type=int, default=600, help="revolutions of the lidar in the stream"
    )
    parser.add_argument("--repeats", type=int, default=5, help="the fastest of so many runs counts")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    stream, points = make_stream(arguments.revolutions, arguments.seed)
    runs = {"swarmloc": run_ours, "PyLidar3 1.6": run_pylidar3, "lds2d 0.7.0": run_lds2d}
    spent = seconds(runs, stream, arguments.repeats)
    rows = [
        {
            "decoder": name,
            "points_per_s": points / cpu,
            "cpu_s_per_mb": cpu / len(stream) * 1e6,
            "swarmloc_is_faster_by": cpu / spent["swarmloc"],
        }
        for name, cpu in spent.items()
    ]
    print(f"{len(stream) / 1e6:.2f} MB, {points} points, chunks of {CHUNK} bytes")
    print(f"{'decoder':14}{'Mpoints/s':>10}{'CPU s/MB':>10}{'ratio':>8}")
    for row in rows:
        print(
            f"{row['decoder']:14}{row['points_per_s'] / 1e6:10.2f}{row['cpu_s_per_mb']:10.4f}"
            f"{row['swarmloc_is_faster_by']:8.1f}"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2) + "\n")
    floors = {"PyLidar3 1.6": FLOOR_PYLIDAR3, "lds2d 0.7.0": FLOOR_LDS2D}
    missed = [name for name, floor in floors.items() if spent[name] < floor * spent["swarmloc"]]
    for name in missed:
        print(f"below the floor: {floors[name]:.0f} times the speed of {name}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
