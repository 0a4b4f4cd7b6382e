"""What lidar and encoders of one robot in the arena would measure, with noise and failures.

Random numbers are drawn one per sample, step or frame, from a generator of each purpose: what a
sensor measures does not depend on the pieces in which it is asked.
"""

import math
from collections.abc import Iterator

import numpy as np

from host.config import Lidar as LidarConfig
from host.config import Wheels
from host.geometry import wrap
from host.messages import BoolArray, FloatArray
from host.simulation.world.arena import ARENA_STEP_S, FORGET_STEPS, TURRET_RADIUS_M, Arena
from host.simulation.world.raycast import (
    Beams,
    BeamsOf,
    meet_boxes,
    meet_cylinders,
    meet_walls,
    x4_beams,
)
from host.simulation.world.scenarios import Scenario

RANGE_LIMITS_M = (0.12, 10.0)
# Standard deviations over still targets, measured on X4s; no figure beyond 6 m.
NOISE_RANGES_M = np.array([0.3, 0.75, 1.25, 1.75, 2.5, 5.0, 10.0])
NOISE_STDS_M = np.array([0.0007, 0.0014, 0.0017, 0.003, 0.005, 0.016, 0.04])
DARK_CELL_M = 0.05
DARK_RUN_CELLS = 8.0
_LONGEST_RUN = 1 << 20  # some 200 s of samples; next to none of what is rare would fill the memory


def robots_own(robot: int) -> str:
    """What makes the purpose of random numbers this robot's own; nothing for the first one."""
    return f" of robot {robot}" if robot else ""


class SimulatedLidar:
    """The lidar on one robot: ranges of samples taken one after another, as noisy as an X4's.

    Teammates and posts are cylinders of a turret's width; a teammate's turret stands at its
    robot's origin. Of furniture it meets legs and boxes.
    """

    def __init__(
        self,
        arena: Arena,
        observer: int,
        scenario: Scenario,
        config: LidarConfig,
        beams: BeamsOf = x4_beams,
    ) -> None:
        self._arena = arena
        self._observer = observer
        self._others = np.delete(np.arange(arena.count), observer)
        self._mounting = (config.x_m, config.y_m, config.heading_rad)
        self._standing = np.concatenate((arena.posts, arena.furniture.legs))
        self._radii = np.full(len(self._others) + len(self._standing), TURRET_RADIUS_M)
        self._radii[len(self._others) + len(arena.posts) :] = arena.furniture.leg_radii
        self._pillars = config.blind_sectors
        self._pillar_centres = np.array([[p.centre_rad] for p in self._pillars])
        self._pillar_halves = np.array([[0.5 * p.width_rad] for p in self._pillars])
        self._beams = beams
        self._scenario = scenario
        own = robots_own(observer)
        self._noise = scenario.generator("lidar range" + own)
        self._rim = scenario.generator("lidar rim" + own)
        self._dropouts = _runs(
            scenario.generator("lidar dropouts" + own), scenario.dropout_share, scenario.dropout_run
        )
        self._dropped: BoolArray = np.zeros(0, dtype=bool)
        self._dark = _dark_cells(scenario)
        random = scenario.generator("lidar interference")
        self._spin_hz = scenario.lidar_turn_hz + random.normal(0.0, 0.2, arena.count)
        self._spin_start = random.uniform(-math.pi, math.pi, arena.count)

    def ranges(self, times: FloatArray, raw_angles: FloatArray) -> FloatArray:
        """Ranges (k,) m, 0 without a return, at times (k,) s and raw angles (k,) rad, clockwise.

        Call with every sample once and in order. The range is that of the point on the beam from
        the lidar's axis, so the X4's angle correction gives its true bearing.
        """
        poses = self._arena.poses(times)
        own = poses[:, self._observer]
        beams = self._beams(raw_angles, own, self._mounting)
        axes = np.empty((len(times), len(self._radii), 2))
        axes[:, : len(self._others)] = poses[:, self._others, :2]
        axes[:, len(self._others) :] = self._standing
        hits = meet_cylinders(beams, axes, self._radii)
        flat, lost = self._flat(beams)
        on_flat = flat < hits.distances
        distances = np.where(on_flat, flat, hits.distances)
        null = on_flat & lost

        radii = self._radii[hits.index] if len(self._radii) else np.zeros(len(times))
        rim = hits.misses > radii - 1e-3 * self._scenario.edge_mrad * distances
        luck = self._rim.random(len(times))
        mixed = ~on_flat & rim & (luck < self._scenario.mixed_share)
        null |= ~on_flat & rim & ~mixed
        behind = np.minimum(flat - distances, 0.3)
        share = luck / max(self._scenario.mixed_share, 1e-9)
        distances = np.where(mixed, distances + share * behind, distances)

        ranges = beams.ranges(distances)
        null |= self._behind_pillar(beams, distances, own)
        null |= self._disturbed(times, beams, poses)
        null |= self._take_dropouts(len(times))
        ranges += self._range_noise(ranges)
        low, high = RANGE_LIMITS_M
        ranges[null | (ranges < low) | (ranges > high)] = 0.0
        return ranges

    def _range_noise(self, ranges: FloatArray) -> FloatArray:
        std = np.interp(ranges, NOISE_RANGES_M, NOISE_STDS_M)
        noise: FloatArray = self._scenario.range_noise * std * self._noise.standard_normal(len(std))
        return noise

    def _flat(self, beams: Beams) -> tuple[FloatArray, BoolArray]:
        """Distances (k,) m to the nearest wall or box, and which of these return nothing."""
        walls = meet_walls(beams, self._arena.half_side_m)
        cells = np.minimum((walls.places / DARK_CELL_M).astype(np.intp), len(self._dark) - 1)
        boxes = meet_boxes(beams, self._arena.furniture.boxes)
        on_box = boxes.distances < walls.distances
        cosines = np.where(on_box, boxes.incidence_cosines, walls.incidence_cosines)
        grazing = cosines < math.cos(math.radians(self._scenario.grazing_deg))
        lost: BoolArray = (self._dark[cells] & ~on_box) | grazing
        return np.where(on_box, boxes.distances, walls.distances), lost

    def _behind_pillar(self, beams: Beams, distances: FloatArray, own: FloatArray) -> BoolArray:
        if not self._pillars:
            return np.zeros(len(distances), dtype=bool)
        x, y = (beams.points(distances) - beams.centres).T
        bearings = np.arctan2(y, x) - own[:, 2]
        hidden: BoolArray = np.any(
            np.abs(wrap(bearings - self._pillar_centres)) < self._pillar_halves, axis=0
        )
        return hidden

    def _disturbed(self, times: FloatArray, beams: Beams, poses: FloatArray) -> BoolArray:
        """Where another X4 dazzles this one: each aims at the other (Perera 2021, section 3.2).

        Both spin at nearly the same rate, so nulls come and go with the slow beat of the two.
        """
        disturbed: BoolArray = np.zeros(len(times), dtype=bool)
        width = math.cos(math.radians(self._scenario.interference_deg))
        x = poses[:, self._others, 0] - beams.centres[:, :1]
        y = poses[:, self._others, 1] - beams.centres[:, 1:]
        distances = np.hypot(x, y)
        aimed = x * beams.directions[:, :1] + y * beams.directions[:, 1:] > width * distances
        sample, other = np.nonzero(aimed)
        if not len(sample):
            return disturbed
        robot = self._others[other]
        spun = 2.0 * math.pi * self._spin_hz[robot] * times[sample] + self._spin_start[robot]
        angle = poses[sample, robot, 2] - spun
        along = x[sample, other] * np.cos(angle) + y[sample, other] * np.sin(angle)
        back = -along > width * distances[sample, other]
        disturbed[sample[back]] = True
        return disturbed

    def _take_dropouts(self, count: int) -> BoolArray:
        while len(self._dropped) < count:
            self._dropped = np.concatenate((self._dropped, next(self._dropouts)))
        taken, self._dropped = self._dropped[:count], self._dropped[count:]
        return taken


def _runs(random: np.random.Generator, share: float, run: float) -> Iterator[BoolArray]:
    """Blocks of a two-state Markov chain that is true for `share` of the time, `run` at once."""
    if share == 0.0:
        while True:
            yield np.zeros(1024, dtype=bool)
    gap = max(run * (1.0 - share) / share, 1.0)
    while True:
        lengths = np.stack((random.geometric(1.0 / gap, 64), random.geometric(1.0 / run, 64)), 1)
        lengths = np.minimum(lengths, _LONGEST_RUN)
        yield np.repeat(np.tile([False, True], 64), lengths.ravel())


def _dark_cells(scenario: Scenario) -> BoolArray:
    """Which cells along the walls are too dark: the same chain, along the room's perimeter."""
    if scenario.dark_wall_share in (0.0, 1.0):
        return np.full(1, bool(scenario.dark_wall_share))
    chain = _runs(scenario.generator("dark walls"), scenario.dark_wall_share, DARK_RUN_CELLS)
    cells = math.ceil(4.0 * scenario.side_m / DARK_CELL_M)
    dark = np.zeros(0, dtype=bool)
    while len(dark) < cells:
        dark = np.concatenate((dark, next(chain)))
    return dark[:cells]


class WheelSlip:
    """The relative slip of a robot's wheels: it drifts and comes back to none."""

    def __init__(self, scenario: Scenario, robot: int) -> None:
        self._random = scenario.generator("wheel slip" + robots_own(robot))
        self._keep = math.exp(-ARENA_STEP_S / scenario.slip_seconds)
        self._kick = scenario.wheel_slip * math.sqrt(1.0 - self._keep**2)
        self._slip: FloatArray = scenario.wheel_slip * self._random.standard_normal(2)

    def next(self) -> FloatArray:
        """The slip (left, right) in the next step of the arena: a share of the way."""
        slip = self._slip
        self._slip = self._keep * slip + self._kick * self._random.standard_normal(2)
        return slip


class SimulatedEncoders:
    """The wheel encoders of one robot that walks: how far its wheels rotated, with slip."""

    def __init__(self, arena: Arena, observer: int, scenario: Scenario, wheels: Wheels) -> None:
        self._arena = arena
        self._observer = observer
        self._half_track = 0.5 * wheels.track_m
        radii = np.array([wheels.left_radius_m, wheels.right_radius_m])
        self._counts_per_m = wheels.counts_per_turn / (2.0 * math.pi * radii)
        self._slip = WheelSlip(scenario, observer)
        self._counts = [np.zeros(2)]  # at every step of the arena from `_first` on
        self._first = 0

    def ticks(self, time: float) -> tuple[int, int]:
        """Encoder counts (left, right) since time 0, at `time` (s) or the oldest not forgotten."""
        index = max(time / ARENA_STEP_S, self._first)
        before = int(index)
        self._extend(before + 1)
        begin, end = self._counts[before - self._first : before - self._first + 2]
        left, right = np.floor(begin + (index - before) * (end - begin))
        return int(left), int(right)

    def forget(self, before: float) -> None:
        """Forget counts of times before `before` (s), now or later."""
        old = min(int(before / ARENA_STEP_S) - self._first, len(self._counts) - 1)
        if old >= FORGET_STEPS:
            del self._counts[:old]
            self._first += old

    def _extend(self, step: int) -> None:
        """Count up to a step."""
        known = self._first + len(self._counts) - 1
        if step <= known:
            return
        self._arena.advance(step * ARENA_STEP_S)
        track = self._arena.track(self._observer, known)[: step - known + 1]
        rotation = np.diff(track[:, 2])
        middle = track[:-1, 2] + 0.5 * rotation
        travel = np.diff(track[:, 0]) * np.cos(middle) + np.diff(track[:, 1]) * np.sin(middle)
        sideways = self._half_track * rotation
        for wheels in np.stack((travel - sideways, travel + sideways), axis=1):
            counted = self._counts_per_m * wheels * (1.0 + self._slip.next())
            self._counts.append(self._counts[-1] + counted)
