"""Simulated motion capture: every robot's body, with noise."""

import math

import numpy as np

from host.config import Mocap
from host.geometry import to_parent
from host.messages import Bodies, FloatArray
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import Scenario


def pivots_of(scenario: Scenario, observer: int) -> FloatArray:
    """Where on its robot each body's pivot is, (robots, 2) m: x forward, y to the left.

    That of the observer's own body is on its origin here: `Mocap` has it.
    """
    angles = scenario.generator("pivots").uniform(0.0, math.tau, scenario.robots)
    found = scenario.pivot_m * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    found[observer] = 0.0
    return np.asarray(found)


class MotionCapture:
    """The bodies of all robots. Robot k is body k + 1.

    The observer's own body lies on it as `mounting` says; a teammate's pivot is above its turret,
    or `Scenario.pivot_m` beside it.
    """

    def __init__(self, arena: Arena, observer: int, scenario: Scenario, mounting: Mocap) -> None:
        self._arena = arena
        self._observer = observer
        self._mounting = mounting
        self._pivots = pivots_of(scenario, observer)
        self._std = np.array([1e-3 * scenario.mocap_noise_mm] * 2 + [0.0])
        self._std[2] = math.radians(scenario.mocap_noise_deg)
        self._random = scenario.generator("motion capture")

    def bodies(self, time: float) -> Bodies:
        """The frame exposed at `time` (s); call once a frame, in order."""
        (poses,) = self._arena.poses(np.array([time]))
        poses = poses.copy()
        poses[:, :2] = to_parent(self._pivots, poses)
        place = np.array([[self._mounting.x_m, self._mounting.y_m]])
        poses[self._observer, :2] = to_parent(place, poses[self._observer])[0]
        poses[self._observer, 2] += self._mounting.heading_rad
        poses += self._std * self._random.standard_normal(poses.shape)
        return Bodies(time, np.arange(1, len(poses) + 1), poses)
