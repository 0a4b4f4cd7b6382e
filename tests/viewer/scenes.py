"""Made scenes for a viewer: a robot that stands or turns, and what it knows."""

from collections.abc import Sequence

import numpy as np

from host.config import RobotConfig
from host.messages import Bearings, Displacement, Estimate, Health, Now, Positions, Scan, Truth
from host.viewer.scene import Scene


def an_estimate(time: float, *places: tuple[float, float], sigma: float = 0.03) -> Estimate:
    n = len(places)
    return Estimate(
        time,
        np.array(places, dtype=float).reshape(-1, 2),
        np.tile(sigma**2 * np.eye(2), (n, 1, 1)),
        np.full(n, 0.9),
        np.linspace(0.1, 0.4, n),
        np.arange(1, n + 1),
    )


def now(time: float, *places: tuple[float, float], truth: bool = False, sigma: float = 0.03) -> Now:
    known = Truth(time, np.arange(len(places)), np.array(places).reshape(-1, 2)) if truth else None
    return Now(an_estimate(time, *places, sigma=sigma), time - 0.1, known)


def a_scene(pictures: Sequence[str] = ()) -> Scene:
    return Scene(RobotConfig(), "phd", pictures)


def a_step(time: float, dx: float = 0.0, dpsi: float = 0.0) -> Displacement:
    return Displacement(time, 0.1, dx, 0.0, dpsi)


def a_scan(time: float, *places: tuple[float, float]) -> Scan:
    """Of places in the lidar's frame; the default lidar is mounted without an offset."""
    x, y = np.array(places, dtype=float).T
    n = len(places)
    return Scan(time, np.full(n, time), np.arctan2(y, x), np.hypot(x, y))


def candidates(time: float, *places: tuple[float, float]) -> Positions:
    return Positions(time, np.array(places), np.tile(np.eye(2), (len(places), 1, 1)))


def bearings(time: float, *directions: float) -> Bearings:
    n = len(directions)
    return Bearings(time, np.array(directions), np.full(n, 0.01), camera="front", view=(0.0, 1.5))


def health(ok: bool = True) -> Health:
    return Health(1.0, "lidar", ok, "scanning", {"packets": 3})
