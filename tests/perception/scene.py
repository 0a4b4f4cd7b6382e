"""Circles and walls seen by a lidar, ray by ray; exact geometry, no code of the simulation."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from host.geometry import Path, wrap
from host.messages import Displacement, Scan

Array = NDArray[np.float64]
Walls = list[tuple[tuple[float, float], tuple[float, float]]]  # from (x, y) to (x, y) m
SAMPLE_RATE_HZ = 5000.0
SAMPLES = 714  # of a turn at 7 Hz
TURN_S = SAMPLES / SAMPLE_RATE_HZ


@dataclass(frozen=True)
class Scene:
    """What stands in the world. circles: (x, y, radius) m."""

    circles: list[tuple[float, float, float]] = field(default_factory=list)
    walls: Walls = field(default_factory=list)

    def distances(self, origins: Array, directions: Array) -> Array:
        """How far (n,) m rays from (n, 2) along unit directions (n, 2) go; inf past everything."""
        nearest = np.full(len(origins), math.inf)
        for x, y, radius in self.circles:
            to_axis = np.array([x, y]) - origins
            along = np.sum(to_axis * directions, axis=1)
            chord = radius**2 - (np.sum(to_axis**2, axis=1) - along**2)
            hit = (chord > 0.0) & (along > 0.0)
            near = along - np.sqrt(np.maximum(chord, 0.0))
            nearest = np.where(hit, np.minimum(nearest, near), nearest)
        for begin, end in self.walls:
            wall = np.subtract(end, begin)
            to_begin = np.asarray(begin) - origins
            cross = directions[:, 0] * wall[1] - directions[:, 1] * wall[0]
            cross = np.where(np.abs(cross) < 1e-12, 1e-12, cross)
            way = (to_begin[:, 0] * wall[1] - to_begin[:, 1] * wall[0]) / cross
            place = (to_begin[:, 0] * directions[:, 1] - to_begin[:, 1] * directions[:, 0]) / cross
            hit = (way > 0.0) & (place >= 0.0) & (place <= 1.0)
            nearest = np.where(hit, np.minimum(nearest, way), nearest)
        return nearest


@dataclass(frozen=True)
class Drive:
    """A robot on an arc: speed (m/s) and turn rate (rad/s) are constant; at the origin at t = 0."""

    speed: float = 0.0
    turn_rate: float = 0.0

    def pose(self, times: Array) -> Array:
        """x, y, heading (n, 3)."""
        heading = self.turn_rate * times
        if self.turn_rate == 0.0:
            return np.stack((self.speed * times, 0.0 * times, heading), axis=1)
        radius = self.speed / self.turn_rate
        x, y = radius * np.sin(heading), radius * (1.0 - np.cos(heading))
        return np.stack((x, y, heading), axis=1)

    def path(self, end: float, step: float = 0.02) -> Path:
        """Its odometry, without any error, from 0 to `end` s."""
        path = Path()
        for displacement in self.displacements(end, step):
            path.append(displacement)
        return path

    def displacements(self, end: float, step: float = 0.02) -> list[Displacement]:
        """As `path`, one by one."""
        x, y, heading = self.pose(np.array([step]))[0]
        count = math.ceil(end / step - 1e-9)
        return [Displacement((k + 1) * step, step, x, y, heading) for k in range(count)]

    def to_robot(self, points: Array, time: float) -> Array:
        """Points (n, 2) of the world in the robot frame at `time`."""
        x, y, heading = self.pose(np.array([time]))[0]
        z = (points[:, 0] - x + 1j * (points[:, 1] - y)) * np.exp(-1j * heading)
        return np.stack((z.real, z.imag), axis=1)


STANDING = Drive()


def take_turn(
    scene: Scene,
    drive: Drive = STANDING,
    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0),
    first_angle: float = 0.0,
    start: float = 0.0,
    samples: int = SAMPLES,
) -> Scan:
    """A turn of an ideal lidar: clockwise from `first_angle` rad, rays from its axis, no noise."""
    times = start + np.arange(samples) / SAMPLE_RATE_HZ
    angles = first_angle - np.arange(samples) * 2.0 * math.pi / samples
    poses = drive.pose(times)
    x, y, turned = mounting
    axis = poses[:, 0] + 1j * poses[:, 1] + (x + 1j * y) * np.exp(1j * poses[:, 2])
    beam = np.exp(1j * (poses[:, 2] + turned + angles))
    distances = scene.distances(
        np.stack((axis.real, axis.imag), axis=1), np.stack((beam.real, beam.imag), axis=1)
    )
    ranges = np.where(np.isfinite(distances), distances, 0.0)
    return Scan(float(times[-1]), times, wrap(angles), ranges)
