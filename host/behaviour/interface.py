"""The interface of behaviours: from the present estimates to a speed and a turn rate."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from host.geometry import wrap
from host.messages import BoolArray, Estimate, FloatArray

Pose = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Command:
    """How to drive: m/s, forward positive, and rad/s, counter-clockwise positive."""

    speed_mps: float
    turn_rate_radps: float


STILL = Command(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Situation:
    """The inputs of a behaviour at `time` (s), all in the robot frame of that moment.

    obstacles (n, 2) m: what the lidar saw around the robot, the nearest in each direction, walls
    and teammates' turrets alike; where nothing came back it is filled in (`Obstacles`). ages (n,)
    s: how long ago. estimate: the teammates, with ages; None before there is one. pose: x, y (m)
    and heading (rad, not wrapped) by the wheels since the start. speed_mps, turn_rate_radps: by
    the wheels, too.
    """

    time: float
    obstacles: FloatArray
    ages: FloatArray
    estimate: Estimate | None
    pose: Pose
    speed_mps: float = 0.0
    turn_rate_radps: float = 0.0

    @property
    def teammates(self) -> FloatArray:
        """Estimated positions of the teammates now: (k, 2) m."""
        return np.zeros((0, 2)) if self.estimate is None else self.estimate.positions

    def nearest(self, bearing: float, half_width: float) -> float:
        """Distance (m) to the nearest object within `half_width` of a bearing (rad); inf: none.

        From the robot's centre to a wall's or a turret's surface, or a teammate's middle.
        """
        things = np.concatenate((self.obstacles, self.teammates))
        distances = np.hypot(*things.T)[_within(things, bearing, half_width)]
        return float(distances.min(initial=np.inf))


def _within(points: FloatArray, bearing: float, half_width: float) -> BoolArray:
    off = wrap(np.arctan2(points[:, 1], points[:, 0]) - bearing)
    return np.asarray(np.abs(off) <= half_width)


class Behaviour(Protocol):
    """Any object with this method, which is called at a fixed rate (PERIOD_S of `safety`)."""

    def command(self, now: Situation) -> Command | None:
        """The command now; None: it is done, and the robot stops."""
