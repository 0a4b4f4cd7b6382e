"""Robots that do not walk at random: one that stands at a wall, one that drives along a square.

As in the first two experiments of Belaroussi 2024, section 6.2.3.
"""

import math

import numpy as np

from host.messages import FloatArray
from host.simulation.world.scenarios import Scenario

_FROM_WALL_M = 0.35
_AHEAD_M = 0.7  # of the robot at the wall is the square's near side, in view of its camera
_ROTATION_RADPS = 3.0  # at a corner, on the spot
_CORNERS = np.array([[0.0, -0.5], [1.0, -0.5], [1.0, 0.5], [0.0, 0.5]])


def edge_pose(scenario: Scenario) -> tuple[FloatArray, float]:
    """Position (2,) m at the wall, and the heading (rad) to the middle."""
    return np.array([_FROM_WALL_M - (scenario.fence_m or scenario.side_m) / 2.0, 0.0]), 0.0


class SquarePath:
    """Straight sides at the scenario's speed, and a rotation on the spot at every corner."""

    def __init__(self, scenario: Scenario) -> None:
        near = edge_pose(scenario)[0] + (_AHEAD_M, 0.0)
        self._corners = near + scenario.square_m * _CORNERS
        self._straight_s = scenario.square_m / max(scenario.speed_mps, 1e-3)
        self._side_s = self._straight_s + 0.5 * math.pi / _ROTATION_RADPS

    def at(self, time: float) -> tuple[FloatArray, float]:
        """Position (2,) m and heading (rad, not wrapped) at `time` (s)."""
        side, since = divmod(time, self._side_s)
        begin, end = self._corners[int(side) % 4], self._corners[(int(side) + 1) % 4]
        share = min(since / self._straight_s, 1.0)
        rotated = _ROTATION_RADPS * max(since - self._straight_s, 0.0)
        return begin + share * (end - begin), 0.5 * math.pi * side + rotated
