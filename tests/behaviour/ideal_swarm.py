"""Robots that do what they are told and know each other's places: where formations lead."""

import math
from collections.abc import Callable

import numpy as np

from host.behaviour.interface import Behaviour, Situation
from host.geometry import to_frame, wrap
from host.messages import Estimate, FloatArray, IntArray
from tests.behaviour.situations import NOTHING

STEP_S = 0.1
FASTEST_MPS, FASTEST_RADPS = 0.24, 3.0
TURRET_M = 0.0325

# What a robot knows of whom at a time: places (n, 2) m and numbers (n,), out of the true ones.
Known = Callable[[float, int, FloatArray, IntArray], tuple[FloatArray, IntArray]]


def everything(
    time: float, robot: int, places: FloatArray, numbers: IntArray
) -> tuple[FloatArray, IntArray]:
    return places, numbers


def in_sight(
    time: float, robot: int, places: FloatArray, numbers: IntArray
) -> tuple[FloatArray, IntArray]:
    """Those that no nearer turret hides."""
    distances, bearings = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
    aside = np.abs(wrap(bearings[:, None] - bearings))
    hides = (distances[:, None] > distances) & (aside < TURRET_M / distances)
    seen = ~hides.any(axis=1)
    return places[seen], numbers[seen]


def scattered(count: int, seed: int, half_m: float = 1.6) -> FloatArray:
    """Poses (n, 3) at random, 0.5 m apart."""
    random = np.random.default_rng(seed)
    places: list[FloatArray] = []
    while len(places) < count:
        place = random.uniform(-half_m, half_m, 2)
        if all(np.hypot(*(place - other)) > 0.5 for other in places):
            places.append(place)
    return np.column_stack((places, random.uniform(-math.pi, math.pi, count)))


def formed(
    behaviours: list[Behaviour],
    poses: FloatArray,
    seconds: float,
    known: Known = everything,
    intruder: Callable[[float], tuple[float, float]] | None = None,
) -> FloatArray:
    """Poses (steps, n, 3). intruder: where one more robot is at a time; the last of the poses.

    Their odometry is exact, and its frame the room's.
    """
    poses = poses.copy()
    speeds = np.zeros(len(behaviours))
    history = []
    for step in range(round(seconds / STEP_S)):
        time = step * STEP_S
        if intruder is not None:
            poses[-1, :2] = intruder(time)
        commands = []
        for robot, behaviour in enumerate(behaviours):
            others = np.delete(np.arange(len(poses)), robot)
            places, labels = known(time, robot, to_frame(poses[others, :2], poses[robot]), others)
            count = len(places)
            estimate = Estimate(
                time,
                places,
                np.tile(1e-4 * np.eye(2), (count, 1, 1)),
                np.ones(count),
                np.zeros(count),
                labels,
            )
            x, y, heading = poses[robot].tolist()
            now = Situation(time, NOTHING, np.zeros(0), estimate, (x, y, heading))
            commands.append(behaviour.command(now))
        for robot, command in enumerate(commands):
            assert command is not None
            wanted = min(max(command.speed_mps, -FASTEST_MPS), FASTEST_MPS)
            speeds[robot] += min(max(wanted - speeds[robot], -0.15), 0.15)  # 1.5 m/s²
            rate = min(max(command.turn_rate_radps, -FASTEST_RADPS), FASTEST_RADPS)
            heading = poses[robot, 2] + 0.5 * STEP_S * rate
            poses[robot, 0] += STEP_S * speeds[robot] * math.cos(heading)
            poses[robot, 1] += STEP_S * speeds[robot] * math.sin(heading)
            poses[robot, 2] += STEP_S * rate
        history.append(poses.copy())
    return np.array(history)


def radii_and_gaps(places: FloatArray, centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) m of places (n, 2) from the centre, and the angles (n,) rad between them."""
    around = places - centre
    angles = np.sort(np.arctan2(around[:, 1], around[:, 0]))
    return np.hypot(*around.T), np.diff(angles, append=angles[0] + math.tau)


def nearest(history: FloatArray, robots: int) -> float:
    """How near any two of the first `robots` ever came, m."""
    places = history[:, :robots, :2]
    apart = np.hypot(*(places[:, :, None] - places[:, None]).transpose(3, 0, 1, 2))
    return float(apart[:, *np.triu_indices(robots, 1)].min())
