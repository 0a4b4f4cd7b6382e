"""The random walk of Perera 2021 (chapter 5) and Belaroussi 2024 (appendix A.1), by the lidar."""

import math

import numpy as np

from host.behaviour.interface import Command, Situation

SPEED_MPS = 0.3
TURN_RATE_RADPS = 2.4
TURN_SECONDS = (0.2, 0.8)
AHEAD_M = 0.55  # to a surface from the robot's centre: before safety stops it
SIDE = math.radians(40.0)  # half of what a side looks at: 80 deg to the left, and to the right
_SAME_WAY_S = 1.0  # so soon after a rotation the next one goes the same way round


class RandomWalk:
    """Straight on until something is ahead, then away from it for a random 0.2 to 0.8 s.

    What is on the left is turned away from to the right; what is on both sides, either way.
    """

    def __init__(self, seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)
        self._until, self._sign = -math.inf, 1.0

    def command(self, now: Situation) -> Command:
        """Never done."""
        if now.time >= self._until:
            self._look_ahead(now)
        if now.time < self._until:
            return Command(0.0, self._sign * TURN_RATE_RADPS)
        return Command(SPEED_MPS, 0.0)

    def _look_ahead(self, now: Situation) -> None:
        left = now.nearest(SIDE, SIDE) < AHEAD_M
        right = now.nearest(-SIDE, SIDE) < AHEAD_M
        if not (left or right):
            return
        if now.time - self._until > _SAME_WAY_S:
            either = float(self._random.choice((-1.0, 1.0)))
            self._sign = either if left and right else -1.0 if left else 1.0
        self._until = now.time + float(self._random.uniform(*TURN_SECONDS))
