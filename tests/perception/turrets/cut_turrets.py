"""Turrets cut into recorded scans: what an X4 would have measured had one stood there.

The samples that meet the cylinder get its range, with the noise and the failures of the
simulation: rims that give nothing or a point behind, and nulls in runs of three.
"""

import gzip
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as File

import numpy as np

from host.drivers.x4.protocol import ScanDecoder
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, Scan
from host.simulation.world.raycast import Beams, meet_cylinders
from host.simulation.world.scenarios import Scenario
from host.simulation.world.sensors import NOISE_RANGES_M, NOISE_STDS_M
from tests.x4_turns import NEXT_TURN, recorded_turns

SENSOR = Scenario(name="cut")
SAMPLE_RATE_HZ = 5000.0
LONGEST_M = 16.38  # what a sample can hold
CLEAR_M = 0.15  # what is behind a turret in plain view is further by this
Random = np.random.Generator


@dataclass(frozen=True)
class Case:
    """A scan with a turret at `place` (x, y) m, of which `hits` samples returned."""

    scan: Scan
    place: FloatArray
    hits: int


def room(file: File) -> list[Scan]:
    """Revolutions of a room: scan, angle_rad (counter-clockwise), range_m, 0 for no return."""
    with gzip.open(file) as lines:
        table = np.loadtxt(lines, delimiter=",", skiprows=1)
    scans = []
    for rows in np.split(table, np.flatnonzero(np.diff(table[:, 0])) + 1):
        times = 1.0 + np.arange(len(rows)) / SAMPLE_RATE_HZ
        ranges = np.where(rows[:, 2] > LONGEST_M, 0.0, rows[:, 2])
        scans.append(Scan(float(times[-1]), times, wrap(rows[:, 1]), ranges))
    return scans


def yard(folder: File) -> list[Scan]:
    """Revolutions of the four recordings with cones, through bytes and decoder."""
    return [
        scan
        for file in sorted(folder.glob("*.csv"))
        for turn in recorded_turns(file)
        for scan in ScanDecoder().feed(turn.stream + NEXT_TURN, 0.0)
    ]


def cut(scan: Scan, places: Sequence[FloatArray], radius: float, random: Random) -> Case:
    """The scan with cylinders at `places`, of which the first is the case's turret."""
    count = len(scan.angles)
    ahead = np.stack((np.cos(scan.angles), np.sin(scan.angles)), axis=1)
    beams = Beams(np.zeros((count, 2)), np.zeros((count, 2)), ahead)
    hits = meet_cylinders(beams, np.broadcast_to(places, (count, len(places), 2)), radius)
    behind = np.where(scan.ranges > 0.0, scan.ranges, np.inf)
    on_it = hits.distances < behind
    distance = np.where(on_it, hits.distances, 0.0)
    rim = on_it & (hits.misses > radius - 1e-3 * SENSOR.edge_mrad * distance)
    luck = random.random(count)
    mixed = rim & (luck < SENSOR.mixed_share)
    distance += mixed * luck / SENSOR.mixed_share * np.minimum(behind - distance, 0.3)
    distance += np.interp(distance, NOISE_RANGES_M, NOISE_STDS_M) * random.standard_normal(count)
    lost = (rim & ~mixed) | _dropouts(count, random)
    ranges = np.where(on_it, np.where(lost, 0.0, np.round(distance, 3)), scan.ranges)
    of_first = on_it & ~lost & (hits.index == 0)
    return Case(replace(scan, ranges=ranges), np.asarray(places[0]), int(of_first.sum()))


def _dropouts(count: int, random: Random) -> BoolArray:
    gap = SENSOR.dropout_run * (1.0 / SENSOR.dropout_share - 1.0)
    lost: BoolArray = np.zeros(count, dtype=bool)
    at = int(random.geometric(1.0 / gap))
    while at < count:
        run = int(random.geometric(1.0 / SENSOR.dropout_run))
        lost[at : at + run] = True
        at += run + int(random.geometric(1.0 / gap))
    return lost


Placing = Callable[[Scan, float, Random], list[FloatArray] | None]


def cases(scans: Sequence[Scan], placing: Placing, count: int, seed: int) -> Iterator[Case]:
    """`count` turrets, one a scan, where `placing` finds room for them."""
    random = np.random.default_rng(seed)
    found = 0
    for k in range(40 * count):
        scan = scans[k % len(scans)]
        places = placing(scan, 0.0325, random)
        if places is not None:
            yield cut(scan, places, 0.0325, random)
            found += 1
        if found == count:
            return
    raise ValueError(f"room for {found} of {count} turrets")


def in_plain_view(
    scan: Scan, radius: float, random: Random, nearest: float = 0.25, farthest: float = 2.4
) -> list[FloatArray] | None:
    """Where nothing is nearer beside it, and what is behind it is CLEAR_M further."""
    for _ in range(100):
        place, distance = _anywhere(random, nearest, farthest)
        around = _around(scan, place, radius, spare=2.5)
        behind = scan.ranges[around]
        if len(behind) > 2 and np.all((behind == 0.0) | (behind > distance + CLEAR_M)):
            return [place]
    return None


def before_a_wall(scan: Scan, radius: float, random: Random) -> list[FloatArray] | None:
    """With 3 to 10 cm between its back and a straight piece of what was recorded."""
    for _ in range(200):
        k = int(random.integers(len(scan.ranges)))
        piece = (k + np.arange(-12, 13)) % len(scan.ranges)
        seen = piece[scan.ranges[piece] > 0.0]
        if len(seen) < 20 or scan.ranges[k] == 0.0:
            continue
        points = _points(scan)[seen]
        normal = np.linalg.svd(points - points.mean(axis=0))[2][1]
        rough = float(np.abs((points - points.mean(axis=0)) @ normal).max())
        at = _points(scan)[k]
        normal = normal if normal @ at > 0.0 else -normal
        if rough > 0.012 * max(1.0, scan.ranges[k] / 1.5) or normal @ at < 0.5 * scan.ranges[k]:
            continue
        place = at - normal * (random.uniform(0.03, 0.10) + radius)
        beside = scan.ranges[_around(scan, place, radius, spare=2.5)]
        reach = float(np.hypot(*place))
        if 0.3 < reach < 2.4 and np.all((beside == 0.0) | (beside > reach - radius)):
            return [place]
    return None


def half_hidden(scan: Scan, radius: float, random: Random) -> list[FloatArray] | None:
    """Behind another turret that covers 30 to 70 % of its width."""
    plain = in_plain_view(scan, radius, random, nearest=0.5)
    if plain is None:
        return None
    (place,) = plain
    distance, bearing = float(np.hypot(*place)), math.atan2(place[1], place[0])
    for _ in range(50):
        nearer = random.uniform(0.25, distance - CLEAR_M)
        side, covered = random.choice((-1.0, 1.0)), random.uniform(0.3, 0.7)
        half, before = math.asin(radius / distance), math.asin(radius / nearer)
        turned = bearing + side * (half - 2.0 * half * covered + before)
        other = nearer * np.array([math.cos(turned), math.sin(turned)])
        beside = scan.ranges[_around(scan, other, radius, spare=0.5)]
        if np.all((beside == 0.0) | (beside > nearer + 0.05)):
            return [place, other]
    return None


def _anywhere(random: Random, nearest: float, farthest: float) -> tuple[FloatArray, float]:
    distance, bearing = random.uniform(nearest, farthest), random.uniform(-math.pi, math.pi)
    return distance * np.array([math.cos(bearing), math.sin(bearing)]), float(distance)


def _points(scan: Scan) -> FloatArray:
    beams = np.stack((np.cos(scan.angles), np.sin(scan.angles)), axis=1)
    return np.asarray(scan.ranges[:, None] * beams)


def _around(scan: Scan, place: FloatArray, radius: float, spare: float) -> BoolArray:
    """Samples that meet a cylinder, and `spare` more on each side."""
    half = math.asin(min(radius / float(np.hypot(*place)), 0.99))
    off = np.abs(wrap(scan.angles - math.atan2(place[1], place[0])))
    return np.asarray(off < half + spare * math.tau / len(scan.angles))
