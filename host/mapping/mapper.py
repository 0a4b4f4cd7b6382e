"""From scans and odometry to a map: where the robot was, and which returns are teammates."""

import math

import numpy as np

from host.config import Lidar
from host.geometry import Path, to_parent
from host.mapping.grid import OccupancyGrid
from host.messages import Displacement, FloatArray, Scan
from host.perception.scan_match import FEWEST_RETURNS, Surroundings, returns_of

TEAMMATE_M = 0.15  # a return so near to an estimate is a teammate's (Belaroussi 2024: its radius)
_NEW_M, _NEW_RAD = 0.4, math.radians(40.0)  # since the last one that a scan is matched with
_MOST_KEPT = 40  # of those
_FITS = 0.4  # share of the returns with nothing near them


class Mapper:
    """Two maps of one drive: with the teammates in it, and with them taken out.

    The frame is that of the robot at the first scan. A scan is matched with those before it, from
    where the odometry has the robot; what is a teammate's is not matched.
    """

    def __init__(self, lidar: Lidar, cell_m: float) -> None:
        self.whole, self.cleared = OccupancyGrid(cell_m), OccupancyGrid(cell_m)
        self.pose = np.zeros(3)  # at the last scan
        self.first: float | None = None  # its time, s
        self._mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
        self._path = Path(keep_seconds=60.0)
        self._time = 0.0
        self._kept: list[FloatArray] = []
        self._surroundings: Surroundings | None = None
        self._kept_at = np.zeros(3)

    def move(self, step: Displacement) -> None:
        """Take in odometry."""
        self._path.append(step)

    def take(self, scan: Scan, teammates: FloatArray) -> None:
        """Take in a scan. teammates (k, 2) m: where they are, in the robot frame at its end."""
        plain, times = returns_of(scan, self._mounting)
        if len(plain) < FEWEST_RETURNS:
            return
        points = self._path.carry(plain, times, scan.time)
        apart = np.linalg.norm(points[:, None] - teammates, axis=2)
        room = np.min(apart, axis=1, initial=math.inf) > TEAMMATE_M
        self._locate(scan.time, points[room])
        beams = np.broadcast_to(self._mounting[:2], points.shape)
        starts = to_parent(self._path.carry(beams, times, scan.time), self.pose)
        ends = to_parent(points, self.pose)
        self.whole.add(starts, ends, np.ones(len(ends), dtype=bool))
        self.cleared.add(starts, ends, room)

    def _locate(self, time: float, points: FloatArray) -> None:
        """Find the pose at `time` (s), and keep the points (n, 2) where they show something new."""
        if self.first is None:
            self.first = self._time = time
        step = self._path.between(self._time, time)
        place = to_parent(np.array([[step.dx, step.dy]]), self.pose)[0]
        self.pose = np.append(place, self.pose[2] + step.dpsi)
        self._time = time
        if self._surroundings is not None:
            matched = self._surroundings.match(points, self.pose)
            if self._surroundings.misfit(points, matched) <= _FITS:
                self.pose = matched
        moved = self.pose - self._kept_at
        if self._surroundings is None or _far(moved):
            self._keep(points)

    def _keep(self, points: FloatArray) -> None:
        self._kept = [*self._kept, to_parent(points, self.pose)][-_MOST_KEPT:]
        self._surroundings = Surroundings(np.concatenate(self._kept))
        self._kept_at = self.pose


def _far(moved: FloatArray) -> bool:
    return bool(np.hypot(*moved[:2]) > _NEW_M or abs(moved[2]) > _NEW_RAD)
