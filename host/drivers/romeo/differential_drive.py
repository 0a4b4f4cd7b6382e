"""Two driven wheels: encoder ticks to motion, and wanted motion to wheel speeds. Pure."""

import math

from host.config import Wheels
from host.messages import Displacement

# What one illegal transition may have cost, in ticks: two edges missed, all of them the same way.
TICKS_PER_ILLEGAL = 2
FASTEST_TICKS_PER_S = 32767  # an i16 of the velocity frame


def displacement(
    wheels: Wheels,
    time: float,
    interval: float,
    left_ticks: int,
    right_ticks: int,
    illegal: tuple[int, int] = (0, 0),
) -> Displacement:
    """How the robot moved in the `interval` (s) in which the wheels went so many ticks.

    Perera 2021, eq. 31 for the distance D and eq. 32 for the rotation, here with each wheel's own
    radius and counter-clockwise positive: dpsi = (right - left) / track. At constant wheel speeds
    the path is an arc; (dx, dy) is its chord, of length D sin(dpsi/2) / (dpsi/2) and direction
    dpsi/2. The variances grow with the way: distance_noise² per metre for the translation,
    heading_noise² per radian turned and drift_noise² per metre for the heading: wheels slip and
    tyres differ on the straight too. illegal: the encoders' illegal transitions (left, right) in
    the interval, for each of which a wheel may have gone TICKS_PER_ILLEGAL further or less.
    """
    left, right = _ways(wheels, left_ticks, right_ticks)
    distance, dpsi = (left + right) / 2.0, (right - left) / wheels.track_m
    half = dpsi / 2.0
    chord = distance * math.sin(half) / half if half else distance
    way = abs(distance)
    left_off, right_off = _ways(wheels, *(TICKS_PER_ILLEGAL * count for count in illegal))
    uncounted = left_off**2 + right_off**2
    return Displacement(
        time=time,
        interval=interval,
        dx=chord * math.cos(half),
        dy=chord * math.sin(half),
        dpsi=dpsi,
        translation_variance=wheels.distance_noise_m**2 * way + uncounted / 4.0,
        heading_variance=wheels.heading_noise_rad**2 * abs(dpsi)
        + wheels.drift_noise_rad**2 * way
        + uncounted / wheels.track_m**2,
        ticks=(left_ticks, right_ticks),
    )


def distance(wheels: Wheels, left_ticks: int, right_ticks: int) -> float:
    """Eq. 31: the way (m) of the middle between the wheels, along its arc."""
    left, right = _ways(wheels, left_ticks, right_ticks)
    return (left + right) / 2.0


def wheel_speeds(wheels: Wheels, speed_mps: float, turn_rate_radps: float) -> tuple[float, float]:
    """Ticks/s (left, right) that drive so fast and turn so fast (counter-clockwise positive)."""
    difference = turn_rate_radps * wheels.track_m / 2.0
    return (
        (speed_mps - difference) / _metres_per_tick(wheels, wheels.left_radius_m),
        (speed_mps + difference) / _metres_per_tick(wheels, wheels.right_radius_m),
    )


def ticks_for(wheels: Wheels, speed_mps: float, turn_rate_radps: float) -> tuple[int, int]:
    """What to send for it: whole ticks/s (left, right), clipped to the limits of robot.toml.

    Raises ValueError where one is not a finite number.
    """
    if not (math.isfinite(speed_mps) and math.isfinite(turn_rate_radps)):
        raise ValueError(f"no finite command: {speed_mps} m/s, {turn_rate_radps} rad/s")
    speed = _clip(speed_mps, wheels.max_speed_mps)
    turn_rate = _clip(turn_rate_radps, wheels.max_turn_rate_radps)
    left, right = wheel_speeds(wheels, speed, turn_rate)
    # Both wheels are slowed alike, so that the robot stays on its arc.
    scale = min(1.0, FASTEST_TICKS_PER_S / max(abs(left), abs(right), 1.0))
    return round(scale * left), round(scale * right)


def _clip(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _ways(wheels: Wheels, left_ticks: int, right_ticks: int) -> tuple[float, float]:
    """How far the wheels (left, right) went, m."""
    return (
        _metres_per_tick(wheels, wheels.left_radius_m) * left_ticks,
        _metres_per_tick(wheels, wheels.right_radius_m) * right_ticks,
    )


def _metres_per_tick(wheels: Wheels, radius_m: float) -> float:
    return 2.0 * math.pi * radius_m / wheels.counts_per_turn
