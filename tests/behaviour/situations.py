"""What a robot may find itself in, made by hand."""

import numpy as np

from host.behaviour.interface import Situation
from host.messages import Estimate, FloatArray

NOTHING = np.zeros((0, 2))


def situation(
    obstacles: FloatArray = NOTHING,
    time: float = 0.0,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    age: float = 0.0,
    teammates: FloatArray | None = None,
) -> Situation:
    obstacles = np.asarray(obstacles, dtype=float).reshape(-1, 2)
    estimate = None
    if teammates is not None:
        count = len(teammates)
        estimate = Estimate(
            time,
            np.asarray(teammates, dtype=float),
            np.tile(1e-3 * np.eye(2), (count, 1, 1)),
            np.ones(count),
            np.zeros(count),
            np.arange(count),
        )
    return Situation(time, obstacles, np.full(len(obstacles), age), estimate, pose)


def wall(distance: float, bearing: float = 0.0) -> FloatArray:
    """Points of a straight wall 4 m long, its foot so far (m) away in a direction (rad)."""
    along = np.linspace(-2.0, 2.0, 401)
    c, s = np.cos(bearing), np.sin(bearing)
    return np.stack((distance * c - along * s, distance * s + along * c), axis=1)
