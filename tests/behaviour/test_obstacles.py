"""What the lidar sees, with gaps closed and what was seen shortly before."""

import math

import numpy as np
import pytest

from host.behaviour.obstacles import Obstacles, closed
from host.config import Lidar
from host.geometry import SECTORS, Path
from host.messages import Displacement, FloatArray, Scan

LIDAR = Lidar()
ANGLES = np.linspace(-math.pi, math.pi, 720, endpoint=False)
CENTRES = (np.arange(SECTORS) + 0.5) * 2.0 * math.pi / SECTORS - math.pi


def scan(time: float, ranges: FloatArray) -> Scan:
    return Scan(time, time - 0.14 * (1.0 - np.arange(720) / 720), ANGLES, ranges)


def room(x: float = 0.0, half: float = 1.5) -> FloatArray:
    """Ranges in a square room from a place on its x axis."""
    c, s = np.cos(ANGLES), np.sin(ANGLES)
    with np.errstate(divide="ignore"):
        return np.minimum((np.copysign(half, c) - x) / c, np.copysign(half, s) / s)


def standing(time: float, dx: float = 0.0) -> Path:
    path = Path()
    path.append(Displacement(time, 0.02, dx, 0.0, 0.0))
    return path


def test_a_gap_in_a_straight_wall_is_closed_along_the_wall() -> None:
    distance = 0.5 / np.cos(CENTRES)
    ranges = np.where(np.abs(CENTRES) < 1.2, distance, 0.9)
    dark = ranges.copy()
    dark[np.abs(CENTRES) < 0.9] = math.inf
    assert closed(dark) == pytest.approx(ranges, rel=0.01)


def test_a_gap_over_the_end_of_the_circle_is_closed_too_and_a_wide_one_by_an_arc() -> None:
    ranges = np.full(SECTORS, 2.0)
    ranges[:20] = ranges[-20:] = math.inf
    # The chord of 41 sectors of a circle of 2 m lies 2 cos(20.5 deg) away in its middle.
    assert closed(ranges)[0] == pytest.approx(2.0 * math.cos(math.radians(20.5)), abs=0.01)
    ranges[:] = math.inf
    ranges[10:60] = np.linspace(1.0, 0.6, 50)
    assert closed(ranges)[200] == pytest.approx(0.6)
    assert np.isinf(closed(np.full(SECTORS, math.inf))).all()


def test_what_was_seen_before_stays_in_place_while_the_robot_drives_and_is_blinded() -> None:
    obstacles, path = Obstacles(LIDAR), Path()
    turret = room()
    turret[355:366] = 0.8  # straight ahead
    path.append(Displacement(1.0, 0.02, 0.0, 0.0, 0.0))
    obstacles.add(scan(1.0, turret), path)
    path.append(Displacement(1.14, 0.14, 0.03, 0.0, 0.0))
    blinded = room(0.03)
    blinded[340:381] = 0.0
    obstacles.add(scan(1.14, blinded), path)
    points, ages = obstacles.seen_from(path.poses(np.array([1.14]))[0], 1.14)
    ahead = np.abs(np.arctan2(points[:, 1], points[:, 0])) < math.radians(2.0)
    assert np.hypot(*points[ahead].T).min() == pytest.approx(0.77, abs=0.02)
    assert ages[ahead].max() == pytest.approx(0.21, abs=0.05)
    # Four blind revolutions later it is forgotten: the gap is closed by what is beside it.
    for k in range(1, 5):
        obstacles.add(scan(1.14 + 0.14 * k, blinded), path)
    points, _ = obstacles.seen_from(path.poses(np.array([1.7]))[0], 1.7)
    ahead = np.abs(np.arctan2(points[:, 1], points[:, 0])) < math.radians(2.0)
    assert np.hypot(*points[ahead].T).min() > 1.2


def test_a_revolution_without_any_return_leaves_what_was_known() -> None:
    obstacles = Obstacles(LIDAR)
    path = standing(1.0)
    obstacles.add(scan(1.0, room()), path)
    obstacles.add(scan(1.14, np.zeros(720)), path)
    points, _ = obstacles.seen_from(np.zeros(3), 1.14)
    assert len(points) == SECTORS
    assert np.hypot(*points.T).min() == pytest.approx(1.5, abs=0.02)
