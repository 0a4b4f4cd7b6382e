"""Fit the score of turret candidates: recorded rooms with turrets cut into them, simulated ones.

    SWARMLOC_DATA=folder python -m tools.fit_turret_score

It prints what `host/perception/turrets/score.py` holds: weights and constant of a logistic model,
in which turrets and background weigh the same, so that its value is a log likelihood ratio; and
the least score, which keeps 98.5 % of the turrets in plain view or close before a wall. For each
recorded room it prints, too, how a model does there that was fitted to all the others: so many
candidates are to be expected in a room that nobody has recorded. It takes some two minutes.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from host.config import Lidar
from host.geometry import Path, to_frame
from host.messages import BoolArray, FloatArray, Scan
from host.perception.turrets.fit import fit_circles
from host.perception.turrets.score import FEATURES, features
from host.perception.turrets.segments import place, returns, small_segments
from host.simulation.offline import OBSERVER
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario
from tests.perception.turrets.cut_turrets import (
    before_a_wall,
    cases,
    half_hidden,
    in_plain_view,
    room,
    yard,
)
from tools.bench.turrets import decode, record

LIDAR = Lidar()
CONES = Lidar(target_diameter_m=0.19, max_range_m=6.0)
FOUND_M = 0.06
PLACINGS = {"plain": in_plain_view, "wall": before_a_wall, "hidden": half_hidden}
CUT = 1200  # turrets of each kind into a recording
SIMULATED = (
    "swarm20:seconds=40,seed=41",
    "swarm20:seconds=40,seed=42",
    "arena4:seconds=40,seed=43",
    "arena4:seconds=40,seed=44,posts=12",
)
# How much all segments of a kind weigh in the fit, in each room that has them.
TURRETS = {"plain": 1.0, "wall": 1.0, "hidden": 0.5, "cone": 0.7, "simulated": 0.75}
BACKGROUND = {"background": 1.0, "wide background": 0.5, "simulated background": 0.05}
KEPT = 0.985  # of the turrets in plain view or before a wall
RIDGE = 1e-3  # on weights of features scaled to unit std

Names = NDArray[np.str_]


@dataclass(frozen=True)
class Segments:
    """Segments: features (n, f), the room where each was seen and its kind (n,)."""

    table: FloatArray
    room: Names
    kind: Names

    @property
    def is_turret(self) -> BoolArray:
        return np.isin(self.kind, list(TURRETS))

    @property
    def weights(self) -> FloatArray:
        """Turrets and background together weigh 1 each."""
        weights = np.zeros(len(self.kind))
        for kind, weight in (TURRETS | BACKGROUND).items():
            for name in np.unique(self.room):
                chosen = (self.kind == kind) & (self.room == name)
                weights[chosen] = weight / max(np.count_nonzero(chosen), 1)
        for which in (self.is_turret, ~self.is_turret):
            weights[which] /= weights[which].sum()
        return weights

    def of(self, chosen: BoolArray) -> "Segments":
        return Segments(self.table[chosen], self.room[chosen], self.kind[chosen])


Row = tuple[FloatArray, str, str]


def measure(scan: Scan, lidar: Lidar = LIDAR, path: Path | None = None) -> tuple[FloatArray, ...]:
    """Features, centres, returns and times of the segments of a scan that are small enough."""
    points, returned = place(scan, lidar, path or Path())
    seen = returns(scan, points, returned, lidar.target_diameter_m)
    small = small_segments(seen, lidar)
    circles = fit_circles(seen, small, lidar)
    table = features(seen, small, circles, lidar.target_diameter_m)
    return table, circles.centres, small.sizes.astype(np.float64), seen.times[small.first]


def recorded(name: str, scans: Sequence[Scan]) -> Iterator[Row]:
    """Background of a recording without turrets, and turrets cut into it."""
    for scan in scans:
        for row in measure(scan)[0]:
            yield row, name, "background"
    for kind, placing in PLACINGS.items():
        try:
            placed = list(cases(scans, placing, CUT, seed=11))
        except ValueError:
            continue  # this recording has no place of the kind
        for case in placed:
            table, centres, *_ = measure(case.scan)
            off = np.hypot(*(centres - case.place).T)
            if len(off) and off.min() < FOUND_M:
                yield table[np.argmin(off)], name, kind


def cones(name: str, scans: Sequence[Scan]) -> Iterator[Row]:
    """The cones straight ahead in the yards: real turrets, though of another width."""
    for scan in scans:
        table, centres, hits, _ = measure(scan, CONES)
        ahead = np.abs(np.arctan2(centres[:, 1], centres[:, 0])) < 0.09
        cone = int(np.argmax(np.where(ahead, hits, 0.0))) if ahead.any() else -1
        for k, row in enumerate(table):
            yield row, name, "cone" if k == cone else "wide background"


def simulated(text: str) -> Iterator[Row]:
    """Teammates and posts of a scenario, and what else is seen there."""
    scenario = parse_scenario(text)
    chunks, path, arena = record(scenario)
    for scan in decode(chunks):
        if not path.end >= scan.time > scan.times[0] > 0.0:
            continue
        table, centres, _, times = measure(scan, LIDAR, path)
        for row, centre, when in zip(table, centres, times, strict=True):
            nearest = np.hypot(*(things(arena, float(when), scan.time) - centre).T).min()
            kind = "simulated" if nearest < FOUND_M else "simulated background"
            yield row, scenario.name, kind


def things(arena: Arena, when: float, end: float) -> FloatArray:
    """Where teammates and posts (n, 2) were at time `when`, in the robot frame at `end`."""
    then, now = arena.poses(np.array([when, end]))
    others = np.delete(then[:, :2], OBSERVER, axis=0)
    return to_frame(np.concatenate((others, arena.posts)), now[OBSERVER])


def gather(folder: File) -> tuple[Segments, dict[str, int]]:
    """All segments, and the number of revolutions of each recorded room."""
    recordings = {name: room(folder / "x4_rooms" / f"{name}.csv.gz") for name in ("office", "flat")}
    recordings["cones"] = yard(folder / "x4_cones")
    rows = [row for name, scans in recordings.items() for row in recorded(name, scans)]
    rows += cones("cones", recordings["cones"])
    rows += [row for text in SIMULATED for row in simulated(text)]
    table, rooms, kinds = zip(*rows, strict=True)
    revolutions = {name: len(scans) for name, scans in recordings.items()}
    return Segments(np.array(table), np.array(rooms), np.array(kinds)), revolutions


def fit(segments: Segments) -> tuple[FloatArray, float, float]:
    """Weights (f,) and constant of the logistic model, and the least score of a candidate."""
    scale = segments.table.std(axis=0) + 1e-9
    table = np.column_stack((segments.table / scale, np.ones(len(segments.kind))))
    sign = np.where(segments.is_turret, 1.0, -1.0)
    weight = segments.weights

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        margin = sign * (table @ parameters)
        wrong = weight * sign / (1.0 + np.exp(np.minimum(margin, 500.0)))
        ridge = RIDGE * np.append(parameters[:-1], 0.0)
        value = weight @ np.logaddexp(0.0, -margin) + 0.5 * float(ridge @ parameters)
        return value, ridge - wrong @ table

    found = minimize(loss, np.zeros(table.shape[1]), jac=True, method="L-BFGS-B").x
    plain = np.isin(segments.kind, ("plain", "wall"))
    least = np.quantile((table @ found)[plain], 1.0 - KEPT)
    return found[:-1] / scale, float(found[-1]), float(least)


def report(segments: Segments, kept: BoolArray, revolutions: int) -> str:
    """Candidates a revolution where no turret is, and how many of the turrets are kept."""
    false = np.count_nonzero(kept & (segments.kind == "background")) / revolutions
    shares = [
        f"{kind} {kept[segments.kind == kind].mean():.1%}"
        for kind in ("plain", "wall", "hidden", "cone")
        if np.any(segments.kind == kind)
    ]
    return f"{false:5.2f} candidates a revolution; kept: {', '.join(shares)}"


def main() -> int:
    folder = os.environ.get("SWARMLOC_DATA")
    if not folder:
        print("SWARMLOC_DATA names no folder of recorded data")
        return 2
    segments, revolutions = gather(File(folder))
    weights, constant, least = fit(segments)
    for name, weight in zip(FEATURES, weights, strict=True):
        print(f'    "{name}": {weight:.3f},')
    print(f"CONSTANT = {constant:.3f}\nLEAST_SCORE = {least:.2f}")
    for name, count in revolutions.items():
        here = segments.room == name
        others = fit(segments.of(~here))
        for fitted, words in ((others, "fitted to others"), ((weights, constant, least), "to all")):
            kept = segments.of(here).table @ fitted[0] + fitted[1] > fitted[2]
            print(f"{name:7}{words:17}{report(segments.of(here), kept, count)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
