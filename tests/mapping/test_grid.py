"""The occupancy grid and the mapper, against rooms that are drawn by hand."""

import math

import numpy as np
import pytest

from host.config import Lidar
from host.mapping.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from host.mapping.mapper import Mapper
from host.messages import Displacement, FloatArray, Scan

ALL = np.ones(1, dtype=bool)


def test_a_beam_frees_the_cells_before_it_ends_and_takes_the_one_it_meets() -> None:
    grid = OccupancyGrid(cell_m=0.1)
    grid.add(np.array([[0.05, 0.05]]), np.array([[0.85, 0.05]]), ALL)
    assert grid.occupied == pytest.approx(np.array([[0.85, 0.05]]))
    assert np.sort(grid.free[:, 0]) == pytest.approx(np.arange(0.05, 0.8, 0.1))
    assert grid.free[:, 1] == pytest.approx(0.05)


def test_what_is_met_and_taken_out_leaves_free_space() -> None:
    grid = OccupancyGrid(cell_m=0.1)
    for _ in range(3):
        grid.add(np.array([[0.05, 0.05]]), np.array([[0.85, 0.05]]), ~ALL)
    assert len(grid.occupied) == 0
    assert grid.free[:, 0].max() > 0.7


def test_what_has_left_is_forgotten() -> None:
    grid = OccupancyGrid(cell_m=0.1)
    for end in (0.45, *[0.95] * 5):
        grid.add(np.array([[0.05, 0.05]]), np.array([[end, 0.05]]), ALL)
    assert grid.occupied[:, 0] == pytest.approx(np.array([0.95]))


def test_the_picture_has_y_upwards() -> None:
    grid = OccupancyGrid(cell_m=0.1)
    grid.add(np.array([[0.05, 0.05]]), np.array([[0.05, 0.25]]), ALL)
    grid.add(np.array([[0.05, 0.05]]), np.array([[0.15, 0.05]]), ALL)
    picture = grid.picture()
    assert picture.tolist() == [[OCCUPIED, UNKNOWN], [FREE, UNKNOWN], [FREE, OCCUPIED]]


def room(pose: FloatArray, teammate: FloatArray) -> FloatArray:
    """Ranges (360,) in a square room of 4 m with one box, from `pose`, and of a round teammate."""
    angles = pose[2] + np.radians(np.arange(-180, 180))
    ways = np.column_stack((np.cos(angles), np.sin(angles)))
    with np.errstate(divide="ignore"):
        walls = np.where(ways > 0, (2.0 - pose[:2]) / ways, (-2.0 - pose[:2]) / ways).min(axis=1)
    ranges = walls
    for middle, radius in ((np.array([1.0, 1.4]), 0.2), (teammate, 0.04)):
        to = middle - pose[:2]
        along = ways @ to
        under = radius**2 - (ways[:, 0] * to[1] - ways[:, 1] * to[0]) ** 2
        meets = (under > 0) & (along > 0)
        ranges = np.where(meets, np.minimum(ranges, along - np.sqrt(np.maximum(under, 0))), ranges)
    return ranges


def test_a_teammate_that_stands_is_in_the_one_map_and_not_in_the_other() -> None:
    mapper = Mapper(Lidar(), cell_m=0.05)
    teammate = np.array([0.5, -0.8])
    pose = np.zeros(3)
    for k in range(24):
        time = 0.15 * (k + 1)
        step = np.array([0.03, 0.0, 0.04])  # true; the odometry is 2 % too long
        mapper.move(Displacement(time, 0.15, 1.02 * step[0], 0.0, step[2]))
        c, s = math.cos(pose[2]), math.sin(pose[2])
        pose = pose + np.array([c * step[0], s * step[0], step[2]])
        ranges, angles = room(pose, teammate), np.radians(np.arange(-180, 180))
        to = teammate - pose[:2]
        c, s = math.cos(pose[2]), math.sin(pose[2])
        seen = np.array([[c * to[0] + s * to[1], c * to[1] - s * to[0]]])
        mapper.take(Scan(time, np.full(360, time), angles, ranges), seen)
    # The map begins at the first scan.
    begin = np.array([0.03, 0.0])
    shown = mapper.whole.occupied + begin
    at_teammate = np.hypot(*(shown - teammate).T) < 0.1
    assert at_teammate.any()
    cleared = mapper.cleared.occupied + begin
    assert not (np.hypot(*(cleared - teammate).T) < 0.1).any()
    others = np.abs(shown).max(axis=1) > 1.85
    box = np.hypot(*(shown - (1.0, 1.4)).T) < 0.3
    assert np.all(others | box | at_teammate)
    assert box.sum() > 5
