"""Robots that do not walk at random, each on its own.

A pair that drives side by side; and, as in the first two experiments of Belaroussi 2024, section
6.2.3, one that stands at a wall, and one that drives along a square.
"""

import math

import numpy as np

from host.errors import UserError
from host.messages import FloatArray
from host.simulation.world.scenarios import Scenario

PAIR = 1  # the walker that is two robots
_FROM_WALL_M = 0.35
_AHEAD_M = 0.7  # of the robot at the wall is the square's near side, in view of its camera
_ROTATION_RADPS = 3.0  # at a corner, on the spot
_CORNERS = np.array([[0.0, -0.5], [1.0, -0.5], [1.0, 0.5], [0.0, 0.5]])


def walkers_of(scenario: Scenario) -> int:
    """How many bodies walk: the robots, a pair as one. Raises UserError where it has no two."""
    if not scenario.pair_m:
        return scenario.robots
    if scenario.robots < PAIR + 2:
        raise UserError(
            f"no pair among {scenario.robots} robots",
            "robots 1 and 2 are the pair, beside robot 0, which observes",
            "ask for at least 3 robots, or leave pair_m out",
        )
    return scenario.robots - 1


def edge_pose(scenario: Scenario) -> tuple[FloatArray, float]:
    """Position (2,) m at the wall, and the heading (rad) to the middle."""
    return np.array([_FROM_WALL_M - (scenario.fence_m or scenario.side_m) / 2.0, 0.0]), 0.0


class SquarePath:
    """Straight sides at the scenario's speed, and a rotation on the spot at every corner."""

    def __init__(self, scenario: Scenario) -> None:
        """Raises UserError where robot 1 cannot drive along it."""
        room = (scenario.fence_m or scenario.side_m) - _FROM_WALL_M - _AHEAD_M
        if scenario.robots < 2 or scenario.pair_m or scenario.stacks == "all":
            raise _no_square(scenario, "robot 1 is not there, one of a pair or on its own stack")
        if scenario.square_m > room:
            raise _no_square(scenario, f"there are {room:.1f} m ahead of the robot at the wall")
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


def _no_square(scenario: Scenario, why: str) -> UserError:
    return UserError(
        f"robot 1 cannot drive along a square of {scenario.square_m} m",
        why,
        "leave square_m out, or write it as in arena4:square_m=1.2",
    )
