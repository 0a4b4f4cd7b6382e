"""How far the robot really drives and rotates for what its wheels report, by the scans' own motion.

What stands still, walls and posts, moves in the scans as the robot does. Once per second a scan is
matched with the one before (`scan_match`), and two gains are learnt from how both agree, each by a
scalar Kalman filter: seen = gain * reported + noise, the gain a slow random walk around 1.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from host.config import Lidar
from host.geometry import Path, wrap
from host.messages import Displacement, FloatArray, Scan
from host.perception.scan_match import FEWEST_RETURNS, Surroundings, returns_of

_INTERVAL_S = (1.0, 1.6)  # between two scans that are matched
_SOME = 3  # every third return of the later scan is matched
_FITS = 0.3  # at most this share of the returns may have nothing near them
_LEAST_M, _LEAST_RAD = 0.03, 0.06  # a motion that is smaller says nothing
_PRIOR_STD = 0.05  # of a gain
_DRIFT_STD = 0.003  # of a gain in the square root of a second of driving
_BOUNDS = (0.75, 1.3)
_GATE_SIGMAS = 4.0  # what differs more is slip, a push or a wrong match
# Of a matched motion; and of the wheels' own noise, after 1 m or 1 rad.
_MATCH_M, _MATCH_RAD, _SLIP_M, _SLIP_RAD = 0.008, 0.008, 0.03, 0.04
_KNOWN_STD = 0.02
_FAR_OFF = 0.05  # a gain that differs more from 1 is reported


class _Gain:
    """One gain, with its variance."""

    def __init__(self) -> None:
        self.value, self._variance = 1.0, _PRIOR_STD**2

    @property
    def known(self) -> bool:
        """Whether something was learnt."""
        return self._variance < _KNOWN_STD**2

    def learn(self, reported: float, seen: float, variance: float) -> None:
        """Take in one motion, both in m or both in rad; variance: of their difference."""
        self._variance = min(self._variance + _DRIFT_STD**2, _PRIOR_STD**2)
        innovation = seen - self.value * reported
        spread = self._variance * reported * reported + variance
        if innovation * innovation > _GATE_SIGMAS**2 * spread:
            return
        weight = self._variance * reported / spread
        self.value = min(max(self.value + weight * innovation, _BOUNDS[0]), _BOUNDS[1])
        self._variance *= 1.0 - weight * reported


@dataclass(frozen=True, slots=True)
class _Seen:
    """Returns of a scan in the robot frame at `time`, de-skewed."""

    time: float
    points: FloatArray
    surroundings: Surroundings


class OdometryGains:
    """Learns the gains from scans, and corrects displacements by them."""

    def __init__(self, lidar: Lidar) -> None:
        self._mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
        self._distance, self._rotation = _Gain(), _Gain()
        self._reported = Path()
        self._last: _Seen | None = None

    @property
    def gains(self) -> tuple[float, float]:
        """By what the reported distance and rotation are multiplied."""
        return self._distance.value, self._rotation.value

    def corrected(self, step: Displacement) -> Displacement:
        """The displacement as the gains make it; its noise stays."""
        self._reported.append(step)
        distance, rotation = self.gains
        return replace(
            step, dx=distance * step.dx, dy=distance * step.dy, dpsi=rotation * step.dpsi
        )

    def take(self, scan: Scan, path: Path) -> None:
        """Learn from the next scan. path: of the corrected odometry, which has reached its end."""
        last = self._last
        if last is not None and 0.0 <= scan.time - last.time < _INTERVAL_S[0]:
            return
        self._last = now = self._see(scan, path)
        if last is None or now is None or not 0.0 < now.time - last.time <= _INTERVAL_S[1]:
            return
        reported = _arc(self._reported, last.time, now.time)
        if abs(reported[0]) < _LEAST_M and abs(reported[1]) < _LEAST_RAD:
            return
        step = path.between(last.time, now.time)
        start = np.array([step.dx, step.dy, step.dpsi])
        motion = last.surroundings.match(now.points, start)
        if last.surroundings.misfit(now.points, motion) > _FITS:
            return
        distance, rotation = arc_of(motion)
        if abs(reported[0]) >= _LEAST_M:
            variance = _MATCH_M**2 + _SLIP_M**2 * abs(reported[0])
            self._distance.learn(reported[0], distance, variance)
        if abs(reported[1]) >= _LEAST_RAD:
            variance = _MATCH_RAD**2 + _SLIP_RAD**2 * abs(reported[1])
            self._rotation.learn(reported[1], rotation, variance)

    def _see(self, scan: Scan, path: Path) -> _Seen | None:
        plain, times = returns_of(scan, self._mounting)
        if len(plain) < FEWEST_RETURNS:
            return None
        points = path.carry(plain, times, scan.time)
        return _Seen(scan.time, points[::_SOME], Surroundings(points))

    @property
    def known(self) -> bool:
        """Whether there was enough to learn a gain from."""
        return self._distance.known or self._rotation.known

    def summary(self) -> str:
        """The gains in words."""
        return "the scans move as the wheels report: distance x{:.2f}, rotation x{:.2f}".format(
            *self.gains
        )

    def fault(self) -> str | None:
        """What is far from the configuration, with the next step; None where nothing is."""
        off = [
            f"the robot {does} {abs(gain - 1.0):.0%} {'further' if gain > 1.0 else 'less'}"
            for does, gain in zip(("drives", "rotates"), self.gains, strict=True)
            if abs(gain - 1.0) > _FAR_OFF
        ]
        if not off:
            return None
        return (
            f"by the scans {' and '.join(off)} than the wheels report; estimates allow for it: "
            "`swarmloc calibrate wheels` fits wheel radii and track"
        )


def _arc(path: Path, start: float, end: float) -> tuple[float, float]:
    step = path.between(start, end)
    return arc_of(np.array([step.dx, step.dy, step.dpsi]))


def arc_of(motion: FloatArray) -> tuple[float, float]:
    """Length (m, negative backwards) and rotation (rad) of the one arc with this motion (3,)."""
    x, y, rotation = motion[0], motion[1], float(wrap(motion[2]))
    half = 0.5 * rotation
    chord = x * math.cos(half) + y * math.sin(half)
    return float(chord / np.sinc(half / math.pi)), rotation
