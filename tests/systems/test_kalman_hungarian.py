"""Belaroussi's system: his ways to find robots in a scan, and what a delay does to them."""

import math
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from host.experiments.results_folder import ResultsFolder
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario
from host.systems.catalogue import score_systems
from host.systems.kalman_hungarian.lidar_detection import clusters, detect


def arc(x: float, y: float, radius: float = 0.0325, count: int = 6) -> np.ndarray:
    """The side of a cylinder that faces the origin."""
    back = math.atan2(-y, -x)
    angles = back + np.linspace(-1.0, 1.0, count)
    return np.column_stack((x + radius * np.cos(angles), y + radius * np.sin(angles)))


WALL = np.column_stack((np.full(40, 2.0), np.linspace(-1.0, 1.0, 40)))


def test_what_is_as_small_as_a_lidar_is_a_cluster_and_a_wall_is_none() -> None:
    (found,) = clusters(np.concatenate((WALL, arc(1.0, 0.3), [[0.5, -0.5]])))
    assert np.hypot(*(found - (1.0, 0.3))) < 0.0325
    assert len(clusters(arc(1.0, 0.0, radius=0.06))) == 0
    assert len(clusters(np.zeros((0, 2)))) == 0


def test_a_box_takes_the_cluster_in_its_middle_at_any_distance() -> None:
    scan = np.concatenate((arc(1.0, 0.0), arc(4.0, 0.6, count=3)))
    camera = np.array([[1.0, 0.12]])  # late: the robot has moved on, the other is in the middle
    (partial,) = detect("partial", scan, camera)
    assert partial[0] > 3.9
    (full,) = detect("full", scan, camera)
    assert np.hypot(*(full - camera[0])) < 0.15
    assert len(detect("full", scan, np.array([[1.0, 0.5]]))) == 0
    assert len(detect("partial", scan, np.array([[-1.0, 0.5]]))) == 0


def test_the_first_experiment_stays_in_view_and_inside_of_the_fence() -> None:
    arena = Arena(parse_scenario("belaroussi1:seed=3"))
    poses = arena.poses(np.linspace(0.0, 60.0, 200))
    watcher, other = poses[:, 0], poses[:, 1]
    assert np.ptp(watcher, axis=0) == pytest.approx(np.zeros(3))
    bearings = np.arctan2(*(other - watcher)[:, 1::-1].T)
    assert np.abs(np.degrees(bearings)).max() < 0.5 * 95.0
    assert np.abs(other[:, :2]).max() < 1.5
    travelled = np.hypot(*np.diff(other[:, :2], axis=0).T).sum()
    assert travelled > 0.8 * 0.3 * 60.0


def test_furniture_is_outside_of_the_fence_and_robots_inside() -> None:
    arena = Arena(parse_scenario("belaroussi3:seed=3"))
    assert np.abs(arena.furniture.legs).max(axis=1).min() > 1.5
    poses = arena.poses(np.linspace(0.0, 30.0, 100))
    assert np.abs(poses[..., :2]).max() < 1.5


def test_delay_ruins_what_looks_where_the_camera_looked(tmp_path: Path) -> None:
    rows = list(score_systems(["belaroussi3:seed=1,seconds=12"], ["kalman_hungarian"]))
    found = {row.variant: row.figures for row in rows}
    for how in ("camera", "lidar full", "fused full"):
        late, in_time = found[f"{how}, late"], found[f"{how}, compensated"]
        assert in_time["p67_m"] < late["p67_m"], how
    folder = ResultsFolder(tmp_path, datetime(2026, 1, 1), {})
    folder.draw = False
    folder.take_systems(rows)
    (measures,) = folder.path.glob("belaroussi3*_late/rmse_and_p67.csv")
    written = {line.split(",")[0]: line.split(",") for line in measures.read_text().splitlines()}
    assert len(written) == 1 + len(rows) / 2
    assert float(written["camera"][3]) == pytest.approx(found["camera, late"]["rmse_m"], rel=1e-3)
