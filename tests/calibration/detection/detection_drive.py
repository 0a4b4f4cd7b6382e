"""Drives that detection is calibrated from, and counts of them that owe nothing to the fit."""

import functools

import numpy as np

from host.calibration.gathered import Gathered
from host.config import RobotConfig
from host.geometry import to_parent, wrap
from host.messages import Bodies, FloatArray, Scan
from host.perception.turrets import turrets
from host.simulation.offline import Simulation
from host.simulation.world.arena import Arena
from host.simulation.world.camera import SimulatedCamera
from host.simulation.world.scenarios import parse_scenario

RADIUS_M = 0.0325
GATE_M = 0.12
GRID_M = 0.1


def bodies(arena: Arena, seconds: float, rate_hz: float = 50.0) -> list[Bodies]:
    """What perfect motion capture has of an arena: the observer is body 1."""
    times = np.arange(0.0, seconds, 1.0 / rate_hz)
    numbers = np.arange(1, arena.count + 1)
    return [
        Bodies(float(time), numbers, poses)
        for time, poses in zip(times, arena.poses(times), strict=True)
    ]


@functools.cache
def lidar_drive(text: str, config: RobotConfig | None = None) -> Gathered:
    """A simulated robot's scans and displacements, with perfect motion capture."""
    config = config or RobotConfig()
    scenario = parse_scenario(text)
    gathered = Gathered(config)
    for message in Simulation(scenario, config).messages():
        if not isinstance(message, Bodies):
            gathered.take(message)
    gathered.bearings.clear()
    gathered.bodies = bodies(Arena(scenario), scenario.seconds)
    return gathered


def scans_only(gathered: Gathered, config: RobotConfig) -> Gathered:
    """The same drive, taken under another configuration."""
    again = Gathered(config)
    again.scans, again.bodies = gathered.scans, gathered.bodies
    return again


@functools.cache
def camera_drive(text: str, config: RobotConfig | None = None) -> Gathered:
    """The cameras of the same, at 10 Hz, without the rest of the robot."""
    scenario = parse_scenario(text)
    arena = Arena(scenario)
    gathered = Gathered(config or RobotConfig())
    camera = SimulatedCamera(arena, 0, scenario)
    times = np.arange(1, int(10 * scenario.seconds)) / 10.0
    gathered.bearings = [camera.bearings(float(time)) for time in times]
    gathered.bodies = bodies(arena, scenario.seconds)
    return gathered


class Count:
    """A drive of the lidar, counted candidate by candidate with the simulation's own knowledge.

    distances (n,) m and seen (n,): of teammates in plain view. false: candidates within the range
    used that are neither teammate nor post. area_m2: in view, summed over the turns.
    """

    def __init__(self, text: str) -> None:
        gathered, scenario = lidar_drive(text), parse_scenario(text)
        lidar = gathered.config.lidar
        arena = Arena(scenario)
        path = gathered.path()
        finder = lidar.model_copy(update={"max_range_m": 12.0})
        rows: list[tuple[float, bool]] = []
        self.false, self.area_m2 = 0, 0.0
        for turn, scan in enumerate(gathered.scans):
            found = turrets.find(scan, finder, path)
            lags = np.zeros(0) if found.lags is None else found.lags
            (now,) = arena.poses(np.array([scan.time]))
            then = arena.poses(scan.time - lags)[:, 1:, :2]
            floor = to_parent(found.positions, now[0])
            away = np.hypot(*np.moveaxis(floor[:, None] - then, 2, 0)).min(axis=1)
            post = np.hypot(*np.moveaxis(floor[:, None] - arena.posts, 2, 0))
            used = np.hypot(*found.positions.T) <= lidar.max_range_m
            self.false += int(np.sum(used & (away > GATE_M) & (post > GATE_M).all(axis=1)))
            if turn % 5 == 0:
                self.area_m2 += 5.0 * area(scan, lidar.max_range_m)
            rows += _views(scan, floor, arena, [b.centre_rad for b in lidar.blind_sectors])
        self.distances = np.array([row[0] for row in rows])
        self.seen = np.array([row[1] for row in rows])


def area(scan: Scan, reach_m: float) -> float:
    """Floor (m²) in view: points of a grid between two returns that are 3 deg apart or less."""
    x, y = np.mgrid[-reach_m:reach_m:GRID_M, -reach_m:reach_m:GRID_M].reshape(2, -1) + GRID_M / 2
    distance, bearing = np.hypot(x, y), np.arctan2(y, x)
    got = scan.ranges > 0.0
    order = np.argsort(scan.angles[got])
    angles, ranges = scan.angles[got][order], scan.ranges[got][order]
    after = np.searchsorted(angles, bearing) % len(angles)
    gap = (angles[after] - angles[after - 1]) % (2.0 * np.pi)
    nearer = distance < np.minimum(reach_m, 0.5 * (ranges[after] + ranges[after - 1]))
    return GRID_M**2 * float(np.sum(nearer & (gap < np.radians(3.0))))


def _views(
    scan: Scan, floor: FloatArray, arena: Arena, blind: list[float]
) -> list[tuple[float, bool]]:
    """Teammates in plain view in the middle of the turn: distance, and if a candidate is there.

    Where the robot turns, when each was crossed matters; such turns are left out.
    """
    start, middle, end = arena.poses(np.array([scan.times[0], scan.time - 0.07, scan.time]))
    if abs(end[0, 2] - start[0, 2]) > 0.05:
        return []
    things = np.concatenate((middle[1:, :2], arena.posts)) - middle[0, :2]
    distance = np.hypot(*things.T)
    bearing = np.arctan2(*things.T[::-1]) - middle[0, 2]
    rows = []
    for j in range(arena.count - 1):
        half = RADIUS_M / distance + 0.05
        nearer = distance < distance[j] - 0.2
        hidden = nearer & (np.abs(wrap(bearing - bearing[j])) < half + half[j])
        dark = min(abs(float(wrap(bearing[j] - b))) for b in blind) < 0.0524 + half[j]
        if not hidden.any() and not dark:
            off = np.hypot(*(floor - middle[1 + j, :2]).T)
            rows.append((float(distance[j]), bool(off.min(initial=9.0) < GATE_M)))
    return rows
