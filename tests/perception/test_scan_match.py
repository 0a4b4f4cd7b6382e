"""Matching of two scans: points carried by a known motion are brought back by it."""

import math

import numpy as np
import pytest

from host.geometry import to_frame
from host.messages import FloatArray
from host.perception.scan_match import Surroundings

STEP_M = 0.02


def room(width: float, depth: float) -> FloatArray:
    """Walls of a room around (0.3, 0.2), as points 2 cm apart."""
    x = np.arange(-width / 2, width / 2, STEP_M)
    y = np.arange(-depth / 2, depth / 2, STEP_M)
    walls = [np.column_stack((x, np.full(len(x), side * depth / 2))) for side in (-1, 1)]
    walls += [np.column_stack((np.full(len(y), side * width / 2), y)) for side in (-1, 1)]
    return np.concatenate(walls) + np.array([0.3, 0.2])


@pytest.mark.parametrize(
    "motion", [(0.3, 0.0, 0.0), (0.1, -0.05, 0.3), (-0.2, 0.0, -0.4), (0.0, 0.0, 0.0)]
)
def test_a_motion_is_found_from_rest(motion: tuple[float, float, float]) -> None:
    walls = room(3.0, 2.2)
    later = to_frame(walls, np.array(motion))
    before = Surroundings(walls)
    found = before.match(later, np.zeros(3))
    assert found == pytest.approx(motion, abs=2e-3)
    assert before.misfit(later, found) < 0.01
    if math.hypot(*motion[:2]) > 0.1:
        assert before.misfit(later, np.zeros(3)) > 0.3


def test_noise_averages_out() -> None:
    random = np.random.default_rng(1)
    walls, motion = room(3.0, 2.2), np.array([0.2, 0.0, 0.2])
    later = to_frame(walls, motion) + 0.005 * random.standard_normal(walls.shape)
    before = Surroundings(walls + 0.005 * random.standard_normal(walls.shape))
    assert before.match(later, np.zeros(3)) == pytest.approx(motion, abs=3e-3)


def test_along_a_corridor_a_motion_stays_as_it_was() -> None:
    walls = room(8.0, 1.5)
    corridor = walls[np.abs(walls[:, 0] - 0.3) < 3.0]  # its ends are out of reach
    before = Surroundings(corridor)
    found = before.match(corridor, np.array([0.2, 0.05, 0.1]))
    assert found[1:] == pytest.approx((0.0, 0.0), abs=5e-3)
    assert found[0] == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize("degrees", [0, 30, -70, 180])
def test_a_rotation_in_place_is_found_to_ten_degrees(degrees: float) -> None:
    walls = np.concatenate((room(3.0, 2.2), [[0.9, 0.9]] * 90))
    later = to_frame(walls, np.array([0.0, 0.0, math.radians(degrees)]))
    found = Surroundings(walls).rotation(later)
    assert math.degrees(found[2]) % 360 == pytest.approx(degrees % 360, abs=5.1)


def test_where_a_room_looks_alike_from_all_sides_it_did_not_rotate() -> None:
    square = room(3.0, 3.0) - np.array([0.3, 0.2])
    assert Surroundings(square).rotation(square)[2] == 0.0
