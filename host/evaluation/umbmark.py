"""UMBmark: systematic odometry errors of a differential drive, from squares both ways.

Borenstein & Feng 1996, "Measurement and correction of systematic odometry errors in mobile robots",
IEEE Transactions on Robotics and Automation 12(6). The measures and names are its own; its closed
forms of both angles, x_cw = -2 L (alpha + beta) and x_ccw = -2 L (alpha - beta), hold for small
ones; here the angles are solved exactly, from the best of a grid of starts.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from host.messages import FloatArray

# Angles (alpha, beta), rad, at which the solution may start.
_STARTS = np.stack(
    np.meshgrid(np.linspace(-0.4, 0.4, 17), np.linspace(-0.9, 0.9, 37)), axis=-1
).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class Umbmark:
    """Return errors, in the frame of the start, x along the first side.

    centre_cw, centre_ccw (x, y) m: the centres of gravity of the errors, clockwise and
    counter-clockwise. systematic_m: E_max,syst, the larger of their distances from zero.
    spread_m: standard deviation of the errors about their centres. alpha_rad: of type A, heading
    error at each corner (track). beta_rad: of type B, heading error along each side (wheels).
    wheel_ratio: E_d, right diameter over left. track_ratio: E_b, true track over nominal.
    """

    centre_cw: tuple[float, float]
    centre_ccw: tuple[float, float]
    systematic_m: float
    spread_m: float
    alpha_rad: float
    beta_rad: float
    wheel_ratio: float
    track_ratio: float


def umbmark(cw: FloatArray, ccw: FloatArray, side_m: float, track_m: float) -> Umbmark:
    """Figures of return errors (n, 2) m each way: true place less that by the wheels, at the end.

    track_m: nominal. Both ways have at least one run.
    """
    centre_cw, centre_ccw = np.mean(cw, axis=0), np.mean(ccw, axis=0)
    about = np.concatenate((cw - centre_cw, ccw - centre_ccw))
    freedom = max(len(about) - 2, 1)
    measured = np.concatenate((centre_cw, centre_ccw))

    def missed(both: FloatArray) -> FloatArray:
        error: FloatArray = returned(float(both[0]), float(both[1]), side_m) - measured
        return error

    # Of wheels that are far off there are other, worse minima.
    nearest = min(_STARTS, key=lambda both: float(np.sum(missed(both) ** 2)))
    alpha, beta = least_squares(missed, nearest).x
    return Umbmark(
        (float(centre_cw[0]), float(centre_cw[1])),
        (float(centre_ccw[0]), float(centre_ccw[1])),
        float(max(np.hypot(*centre_cw), np.hypot(*centre_ccw))),
        math.sqrt(float(np.sum(about**2)) / (2.0 * freedom)),
        float(alpha),
        float(beta),
        _wheel_ratio(float(beta), side_m, track_m),
        (math.pi / 2.0) / (math.pi / 2.0 - float(alpha)),
    )


def returned(alpha: float, beta: float, side_m: float) -> FloatArray:
    """Where a robot ends (cw x, y, ccw x, y) m that believes to have driven the squares exactly.

    It rotates by alpha (rad) less than 90 degrees at each corner, and each side bends to the left
    by beta (rad).
    """
    ends = []
    for turn in (-1.0, 1.0):
        x = y = heading = 0.0
        for _ in range(4):
            chord = side_m * float(np.sinc(0.5 * beta / math.pi))
            x += chord * math.cos(heading + 0.5 * beta)
            y += chord * math.sin(heading + 0.5 * beta)
            heading += beta + turn * (0.5 * math.pi - alpha)
        ends += [x, y]
    return np.array(ends)


def _wheel_ratio(beta: float, side_m: float, track_m: float) -> float:
    """E_d of the curve that a side becomes: radius R = (L / 2) / sin(beta / 2)."""
    if beta == 0.0:
        return 1.0
    radius = 0.5 * side_m / math.sin(0.5 * beta)
    return (radius + 0.5 * track_m) / (radius - 0.5 * track_m)


def corrected(ratio: Umbmark, left_m: float, right_m: float, track_m: float) -> Sequence[float]:
    """Left and right radius and track (m) with the errors taken out; the mean radius stays."""
    mean = 0.5 * (left_m + right_m)
    right_over_left = ratio.wheel_ratio * right_m / left_m
    left = 2.0 * mean / (1.0 + right_over_left)
    return left, right_over_left * left, ratio.track_ratio * track_m
