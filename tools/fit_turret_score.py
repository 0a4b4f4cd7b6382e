"""Fit the score of turret candidates: recorded rooms, with turrets cut into them.

    SWARMLOC_DATA=folder python -m tools.fit_turret_score

The first half of each recording is fitted to, the second half tested on. It prints what
`host/perception/turret_score.py` holds: weights and constant of a logistic model, in which turrets
and background weigh the same, so that its value is a log likelihood ratio; and the least scores,
which keep 98 % of the turrets in plain view or before a wall, 93 % of those half hidden and 97 %
of the cones, which are the only real ones.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from scipy.optimize import minimize

from host.config import Lidar
from host.geometry import Path
from host.messages import BoolArray, FloatArray, Scan
from host.perception.turret_fit import fit_circles
from host.perception.turret_score import FEATURES, HITS, features
from host.perception.turret_segments import place, returns, small_segments
from tests.perception.cut_turrets import (
    Case,
    before_a_wall,
    cases,
    half_hidden,
    in_plain_view,
    room,
    yard,
)

LIDAR = Lidar()
CONES = Lidar(target_diameter_m=0.19, max_range_m=6.0)
FOUND_M = 0.06
COUNTS = {in_plain_view: 800, before_a_wall: 400, half_hidden: 600}  # of turrets a recording
IMPORTANCE = {in_plain_view: 1.0, before_a_wall: 1.0, half_hidden: 0.5}
# By kind: what share is kept, and how many near a number of returns make it a figure.
KEPT = {1.0: (0.98, 20), 2.0: (0.93, 100), 3.0: (0.97, 8)}
ENOUGH = 2.0  # no candidate needs a score above this
RIDGE = 1e-3  # on weights of features scaled to unit std
# Of the turrets' returns: whose scores make the least score at each of HITS.
NEIGHBOURHOODS = ((2, 2), (3, 3), (4, 4), (5, 6), (7, 9), (10, 14), (14, 99))


@dataclass(frozen=True)
class Samples:
    """Segments: features (n, f), returns (n,), importance (n,), and of which kind (n,).

    kind: 0 background, 1 a turret in plain view or before a wall, 2 one half hidden,
    3 a cone.
    """

    table: FloatArray
    hits: FloatArray
    importance: FloatArray
    kind: FloatArray


def segments_of(scan: Scan, lidar: Lidar = LIDAR) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Features, returns and centres of the segments of a scan that are small enough."""
    points, returned = place(scan, lidar, Path())
    seen = returns(scan, points, returned, lidar.target_diameter_m)
    small = small_segments(seen, lidar)
    circles = fit_circles(seen, small, lidar)
    table = features(seen, small, circles, lidar.target_diameter_m)
    return table, small.sizes.astype(np.float64), circles.centres


def turret_segment(case: Case) -> tuple[FloatArray, float] | None:
    """Features and returns of the segment on the turret, None where it is in none."""
    table, hits, centres = segments_of(case.scan)
    off = np.hypot(*(centres - case.place).T)
    k = int(np.argmin(off)) if len(off) else 0
    return (table[k], float(hits[k])) if len(off) and off[k] < FOUND_M else None


def gather(scans: Sequence[Scan], seed: int) -> Samples:
    """Background and turrets of some revolutions of one recording."""
    rows: list[tuple[FloatArray, float, float, float]] = []
    background = [segments_of(scan)[:2] for scan in scans]
    total = sum(len(hits) for _, hits in background)
    for table, hits in background:
        rows += [(row, hit, 1000.0 / total, 0.0) for row, hit in zip(table, hits, strict=True)]
    for placing, count in COUNTS.items():
        try:
            found = [turret_segment(case) for case in cases(scans, placing, count, seed)]
        except ValueError:
            continue  # this recording has no place of the kind
        kind = 2.0 if placing is half_hidden else 1.0
        rows += [(*one, IMPORTANCE[placing], kind) for one in found if one]
    table, hits, importance, kind = zip(*rows, strict=True)
    return Samples(np.array(table), np.array(hits), np.array(importance), np.array(kind))


def gather_cones(scans: Sequence[Scan]) -> Samples:
    """The cones that stand straight ahead in the yards: real turrets, though of another width."""
    rows = []
    for scan in scans:
        table, hits, centres = segments_of(scan, CONES)
        ahead = np.flatnonzero(np.abs(np.arctan2(centres[:, 1], centres[:, 0])) < 0.09)
        rows += [(table[k], hits[k]) for k in ahead[np.argsort(-hits[ahead])][:1]]
    table, hits = (np.array(column) for column in zip(*rows, strict=True))
    return Samples(table, hits, np.full(len(hits), 2.0), np.full(len(hits), 3.0))


def together(parts: Sequence[Samples]) -> Samples:
    names = ("table", "hits", "importance", "kind")
    return Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def fit(samples: Samples) -> tuple[FloatArray, float]:
    """Weights (f,) and constant of the logistic model."""
    turret = samples.kind > 0.0
    weight = samples.importance.copy()
    for which in (turret, ~turret):
        weight[which] /= weight[which].sum()
    scale = samples.table.std(axis=0) + 1e-9
    table = np.column_stack((samples.table / scale, np.ones(len(turret))))
    sign = np.where(turret, 1.0, -1.0)

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        margin = sign * (table @ parameters)
        wrong = weight * sign / (1.0 + np.exp(np.minimum(margin, 500.0)))
        ridge = RIDGE * np.append(parameters[:-1], 0.0)
        value = weight @ np.logaddexp(0.0, -margin) + 0.5 * float(ridge @ parameters)
        return value, ridge - wrong @ table

    found = minimize(loss, np.zeros(table.shape[1]), jac=True, method="L-BFGS-B")
    return found.x[:-1] / scale, float(found.x[-1])


def least_scores(samples: Samples, score: FloatArray) -> FloatArray:
    """The least score at each of HITS that keeps the shares of turrets."""
    least = []
    for low, high in NEIGHBOURHOODS:
        near = (samples.hits >= low) & (samples.hits <= high)
        bounds = [
            float(np.quantile(score[near & (samples.kind == kind)], 1.0 - kept))
            for kind, (kept, enough) in KEPT.items()
            if np.count_nonzero(near & (samples.kind == kind)) > enough
        ]
        least.append(min(bounds, default=ENOUGH))
    return np.minimum(least, ENOUGH)


def report(name: str, samples: Samples, kept: BoolArray, revolutions: int) -> str:
    def share(kind: float) -> str:
        return f"{kept[samples.kind == kind].mean():7.1%}"

    false = np.count_nonzero(kept & (samples.kind == 0.0)) / revolutions
    return f"{name:8}{false:6.2f} candidates a revolution; kept {share(1.0)}, hidden {share(2.0)}"


def main() -> int:
    folder = os.environ.get("SWARMLOC_DATA")
    if not folder:
        print("SWARMLOC_DATA names no folder of recorded data")
        return 2
    rooms = File(folder) / "x4_rooms"
    recordings = {name: room(rooms / f"{name}.csv.gz") for name in ("office", "flat")}
    recordings["cones"] = yard(File(folder) / "x4_cones")[::2]
    parts = [gather(scans[: len(scans) // 2], seed=1) for scans in recordings.values()]
    known = together([*parts, gather_cones(recordings["cones"][::2])])
    weights, constant = fit(known)
    least = least_scores(known, known.table @ weights + constant)
    for name, weight in zip(FEATURES, weights, strict=True):
        print(f'    "{name}": {weight:.3f},')
    print(f"CONSTANT = {constant:.3f}\nLEAST_SCORES = np.array({np.round(least, 2).tolist()})")
    for name, scans in recordings.items():
        unseen = scans[len(scans) // 2 :]
        samples = gather(unseen, seed=2)
        score = samples.table @ weights + constant
        kept = score > np.interp(samples.hits, HITS, least)
        print(report(name, samples, kept, len(unseen)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
