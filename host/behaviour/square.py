"""Once around a square by the wheels alone: UMBmark's path (Borenstein & Feng 1996)."""

import math

from host.behaviour.interface import Command, Situation
from host.geometry import wrap

SPEED_MPS = 0.2
_RATE_RADPS = 1.2
_LEAST_RATE_RADPS = 0.15
_HEADING_GAIN = 3.0  # 1/s
_SLOWING_M, _SLOWING_RAD = 0.08, 0.4  # before the end of a side, of a rotation
_LEAST_MPS = 0.03
_PAUSE_S = 0.6  # to stand still, after each part


class Square:
    """Four sides and four rotations, as the odometry counts them; then it is done.

    side_m: of the square. left: counter-clockwise, else clockwise. It begins where the robot
    stands, along where it looks.
    """

    def __init__(self, side_m: float, left: bool) -> None:
        self._side_m = side_m
        self._turn = math.pi / 2.0 if left else -math.pi / 2.0
        self._part = 0  # even: a side, odd: a rotation
        self._start: tuple[float, float] | None = None
        self._heading = 0.0  # along the present side
        self._rest_until = -math.inf

    def command(self, now: Situation) -> Command | None:
        """Along the side or around the corner; None after the last corner."""
        x, y, heading = now.pose
        if self._start is None:
            self._start, self._heading = (x, y), heading
        if now.time < self._rest_until:
            return Command(0.0, 0.0)
        if self._part >= 8:
            return None
        return self._along(x, y, heading, now) if self._part % 2 == 0 else self._around(now)

    def _along(self, x: float, y: float, heading: float, now: Situation) -> Command:
        start = self._start or (x, y)
        dx, dy = x - start[0], y - start[1]
        c, s = math.cos(self._heading), math.sin(self._heading)
        left_m = self._side_m - (c * dx + s * dy)
        if left_m <= 0.002:
            return self._next(now)
        # Back onto the line where the robot left it.
        aim = float(wrap(self._heading - heading)) - 1.5 * (c * dy - s * dx)
        speed = SPEED_MPS * min(1.0, left_m / _SLOWING_M)
        return Command(max(speed, _LEAST_MPS), _HEADING_GAIN * aim)

    def _around(self, now: Situation) -> Command:
        left = self._heading + self._turn - now.pose[2]
        if math.copysign(1.0, self._turn) * left <= 0.004:
            self._heading += self._turn
            return self._next(now)
        rate = _RATE_RADPS * min(1.0, abs(left) / _SLOWING_RAD)
        return Command(0.0, math.copysign(max(rate, _LEAST_RATE_RADPS), self._turn))

    def _next(self, now: Situation) -> Command:
        self._part += 1
        self._rest_until = now.time + _PAUSE_S
        self._start = (now.pose[0], now.pose[1])
        return Command(0.0, 0.0)
