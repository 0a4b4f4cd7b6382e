"""How a robot moves whose wheels turn so fast, for what commands them."""

import math

from host.config import Wheels


def body_speeds(
    wheels: Wheels, left_ticks_per_s: float, right_ticks_per_s: float
) -> tuple[float, float]:
    """Speed (m/s) and turn rate (rad/s)."""
    rad_per_tick = math.tau / wheels.counts_per_turn
    left = wheels.left_radius_m * rad_per_tick * left_ticks_per_s
    right = wheels.right_radius_m * rad_per_tick * right_ticks_per_s
    return (left + right) / 2.0, (right - left) / wheels.track_m
