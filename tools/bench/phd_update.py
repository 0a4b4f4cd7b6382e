"""The GM-PHD filter beside Stone Soup's: the same scans, alternating, in one process.

The scene: n targets on a slow random walk in a square of 1.8 m² a target (20 in 6x6 m), the
observer standing in its middle; every scan (7 Hz) detects each with probability 0.9 and a noise
of 5 cm, amid false alarms of constant density: 5 a scan at n = 20, so n / 4. Both filters know
just that. Stone Soup's is the GM-PHD of its gallery (tools/stone_soup.py), plain and with KD-trees.

Times are CPU times of one scan: predict, update and estimate; ours also `update` alone. They were
taken alternating with Stone Soup's (`interleaved`) and then, over more scans, by ourselves
(`alone`). GOSPA is the mean over the interleaved scans. What Stone Soup leaves
out: occlusion, blind sectors, detection by place, kinds of things, bearings, memory.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from host.config import FilterSettings, Lidar, PmbSettings
from host.estimator.phd import PhdFilter
from host.evaluation.metrics import gospa
from host.messages import Displacement, FloatArray, Positions
from tools.stone_soup import GmPhd, Model, constant_walk

RATE_HZ = 7.0
AREA_PER_TARGET_M2 = 36.0 / 20.0
DETECTION_PROBABILITY = 0.9
NOISE_M = 0.05
CLUTTER_PER_M2 = 5.0 / 36.0
MOTION_M = 0.06  # std per axis after 1 s
BIRTH_PER_M2 = 0.002  # a scan
SURVIVAL_S = 30.0
PRUNE_WEIGHT = 1e-3  # less costs Stone Soup time and gains it nothing
WARM_UP = 4  # scans that do not count

# Scans taken alternating, by number of targets: the last cost Stone Soup seconds each.
SCANS = {4: 104, 20: 64, 100: 14, 500: 6}
SCANS_ALONE = 300

LEAST_RATIO = 100.0
RATIO_AT = (20, 500)
MOST_UPDATE_MS, UPDATE_AT = 0.2, 20
MOST_GROWTH, GROWTH_FROM_TO = 7.0, (100, 500)

# Ours for this sensor: it sees everything in its range alike, and only teammates.
LIDAR = Lidar(
    target_diameter_m=0.011,
    min_range_m=0.0,
    max_range_m=12.0,
    detection_probability=DETECTION_PROBABILITY,
    half_range_m=999.0,
    clutter_per_m2=CLUTTER_PER_M2,
    blind_sectors=(),
)
FILTER = FilterSettings(
    survival_range_m=50.0,
    survival_s=SURVIVAL_S,
    pmb=PmbSettings(speed_mps=MOTION_M, appear_per_m2_s=BIRTH_PER_M2 * RATE_HZ, obstacle_share=0.0),
)


@dataclass(frozen=True)
class Scene:
    """A square of `side` m with targets, and what a scan of it gives."""

    targets: int
    seed: int

    @property
    def side(self) -> float:
        return float(np.sqrt(AREA_PER_TARGET_M2 * self.targets))

    def scans(self) -> Iterator[tuple[float, FloatArray, FloatArray]]:
        """Endless: time (s), true positions (n, 2) and readings (m, 2), in m."""
        random = np.random.default_rng(self.seed)
        half = self.side / 2.0
        truth = random.uniform(-half, half, (self.targets, 2))
        step = MOTION_M / np.sqrt(RATE_HZ)
        scan = 0
        while True:
            scan += 1
            truth = truth + random.normal(0.0, step, truth.shape)
            truth = np.where(np.abs(truth) > half, np.sign(truth) * self.side - truth, truth)
            seen = truth[random.random(len(truth)) < DETECTION_PROBABILITY]
            clutter = random.poisson(CLUTTER_PER_M2 * self.side**2)
            readings = np.concatenate(
                (
                    seen + random.normal(0.0, NOISE_M, seen.shape),
                    random.uniform(-half, half, (clutter, 2)),
                )
            )
            yield scan / RATE_HZ, truth, random.permutation(readings)


class Ours:
    """Our filter; a step gives the estimates (k, 2) and the CPU seconds of all and of `update`."""

    def __init__(self) -> None:
        self._filter = PhdFilter(FILTER, LIDAR)

    def step(self, now: float, readings: FloatArray) -> tuple[FloatArray, float, float]:
        noise = np.tile(NOISE_M**2 * np.eye(2), (len(readings), 1, 1))
        motion = Displacement(now, 1.0 / RATE_HZ, 0.0, 0.0, 0.0)
        measured = Positions(now, readings, noise)
        begin = time.process_time()
        self._filter.predict(motion)
        predicted = time.process_time()
        self._filter.update(measured)
        updated = time.process_time()
        positions = self._filter.estimate().positions
        return positions, time.process_time() - begin, updated - predicted


def walking(scene: Scene) -> Model:
    """The scene as it is."""
    return Model(
        constant_walk(MOTION_M**2),
        (0, 1),
        NOISE_M,
        DETECTION_PROBABILITY,
        CLUTTER_PER_M2,
        float(np.exp(-1.0 / RATE_HZ / SURVIVAL_S)),
        BIRTH_PER_M2 * scene.side**2,
        (scene.side / 2.0) ** 2 * np.eye(2),
        PRUNE_WEIGHT,
    )


@dataclass(frozen=True)
class Row:
    """Figures at one number of targets; times in ms of CPU, ratios of medians."""

    targets: int
    scans: int
    ours_ms: float
    ours_alone_ms: float
    ours_alone_ms_min: float
    ours_alone_ms_p99: float
    update_ms: float
    update_alone_ms: float
    update_alone_ms_min: float
    update_alone_ms_p99: float
    stone_soup_ms: float
    stone_soup_ms_p99: float
    stone_soup_trees_ms: float
    stone_soup_trees_ms_p99: float
    ratio: float
    ratio_trees: float
    gospa_m: float
    stone_soup_gospa_m: float
    stone_soup_trees_gospa_m: float


def measure(scene: Scene, scans: int, alone: int) -> Row:
    """All three over `scans` scans, alternating, then ours over `alone` more."""
    ours = Ours()
    model = walking(scene)
    plain, trees = GmPhd(model, trees=False), GmPhd(model, trees=True)
    stream = scene.scans()
    times, scores = [], []
    for index in range(scans):
        now, truth, readings = next(stream)
        found, whole, update = ours.step(now, readings)
        found_plain, plain_spent = plain.step(now, readings)
        found_trees, trees_spent = trees.step(now, readings)
        if index >= WARM_UP:
            times.append((whole, update, plain_spent, trees_spent))
            everyone = (found, found_plain, found_trees)
            scores.append([gospa(truth, positions).distance for positions in everyone])
    own = []
    for _ in range(alone):
        now, _, readings = next(stream)
        own.append(ours.step(now, readings)[1:])
    ms = 1000.0 * np.array(times)
    own_ms = 1000.0 * np.array(own)
    whole, update, stone, stone_trees = np.median(ms, axis=0).tolist()
    p99 = np.percentile(ms, 99.0, axis=0).tolist()
    own_median, own_min = np.median(own_ms, axis=0).tolist(), np.min(own_ms, axis=0).tolist()
    own_p99 = np.percentile(own_ms, 99.0, axis=0).tolist()
    score = np.mean(scores, axis=0).tolist()
    return Row(
        targets=scene.targets,
        scans=scans,
        ours_ms=whole,
        ours_alone_ms=own_median[0],
        ours_alone_ms_min=own_min[0],
        ours_alone_ms_p99=own_p99[0],
        update_ms=update,
        update_alone_ms=own_median[1],
        update_alone_ms_min=own_min[1],
        update_alone_ms_p99=own_p99[1],
        stone_soup_ms=stone,
        stone_soup_ms_p99=p99[2],
        stone_soup_trees_ms=stone_trees,
        stone_soup_trees_ms_p99=p99[3],
        ratio=stone / whole,
        ratio_trees=stone_trees / whole,
        gospa_m=score[0],
        stone_soup_gospa_m=score[1],
        stone_soup_trees_gospa_m=score[2],
    )


def unit_us(repeats: int = 20_000) -> float:
    """The machine's unit: µs of one numpy addition of 40 numbers."""
    numbers = np.arange(40.0)
    begin = time.process_time()
    for _ in range(repeats):
        numbers + numbers
    return (time.process_time() - begin) / repeats * 1e6


COLUMNS: dict[str, Callable[[Row], str]] = {
    "n": lambda r: f"{r.targets}",
    "scans": lambda r: f"{r.scans}",
    "ours ms": lambda r: f"{r.ours_ms:.3f}",
    "update": lambda r: f"{r.update_ms:.3f}",
    "alone": lambda r: f"{r.ours_alone_ms:.3f}",
    "p99": lambda r: f"{r.ours_alone_ms_p99:.3f}",
    "update ": lambda r: f"{r.update_alone_ms:.3f}",
    "min": lambda r: f"{r.update_alone_ms_min:.3f}",
    "p99 ": lambda r: f"{r.update_alone_ms_p99:.3f}",
    "StoneSoup": lambda r: f"{r.stone_soup_ms:.1f}",
    "p99  ": lambda r: f"{r.stone_soup_ms_p99:.1f}",
    "trees": lambda r: f"{r.stone_soup_trees_ms:.1f}",
    "ratio": lambda r: f"{r.ratio:.0f}",
    "(trees)": lambda r: f"{r.ratio_trees:.0f}",
    "GOSPA m": lambda r: f"{r.gospa_m:.3f}",
    "theirs": lambda r: f"{r.stone_soup_gospa_m:.3f}",
    "trees ": lambda r: f"{r.stone_soup_trees_gospa_m:.3f}",
}


def failures(rows: dict[int, Row]) -> list[str]:
    """The floors that were missed, as text."""
    missed = []
    for n in RATIO_AT:
        if n in rows and rows[n].ratio < LEAST_RATIO:
            missed.append(f"ratio at n = {n}: {rows[n].ratio:.0f}, less than {LEAST_RATIO:.0f}")
    for n, row in rows.items():
        if row.gospa_m > row.stone_soup_gospa_m:
            missed.append(f"GOSPA at n = {n} is worse than Stone Soup's")
    begin, end = GROWTH_FROM_TO
    if begin in rows and end in rows:
        growth = rows[end].ours_alone_ms / rows[begin].ours_alone_ms
        if growth > MOST_GROWTH:
            missed.append(f"cost from n = {begin} to {end} grows {growth:.1f} times")
    return missed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--targets", type=int, nargs="+", default=list(SCANS), choices=list(SCANS), metavar="N"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    unit = unit_us()
    print(f"one numpy addition of 40 numbers: {unit:.2f} us; times are CPU ms a scan, medians")
    print(f"{'':10}{'- interleaved --':>16}{'------- ours alone ------':>36}")
    print("".join(f"{name:>9}" for name in COLUMNS))
    rows: dict[int, Row] = {}
    for n in arguments.targets:
        rows[n] = measure(Scene(n, arguments.seed), SCANS[n], SCANS_ALONE)
        print("".join(f"{show(rows[n]):>9}" for show in COLUMNS.values()), flush=True)
    slope = None
    if len(rows) > 1:
        slope, base = np.polyfit(list(rows), [row.ours_alone_ms for row in rows.values()], 1)
        print(f"ours: {base:.3f} ms + {1000 * slope:.2f} us a target")
    if arguments.json:
        figures = {
            "numpy_addition_us": unit,
            "us_per_target": None if slope is None else 1000.0 * slope,
            "rows": [asdict(row) for row in rows.values()],
        }
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n")
    if UPDATE_AT in rows:
        took = rows[UPDATE_AT].update_alone_ms
        word = "above" if took > MOST_UPDATE_MS else "within"
        # Not a failure: it is the machine of the moment that is measured, the ratios are not.
        print(f"update at n = {UPDATE_AT}: {took:.3f} ms, {word} the wanted {MOST_UPDATE_MS} ms")
    missed = failures(rows)
    for line in missed:
        print(f"below the floor: {line}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
