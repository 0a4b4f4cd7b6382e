"""What a robot's camera and lidar find, as their messages arrive.

As published a picture counts as taken when it arrives, some 150 ms late, and the lidar looks for
its robots in the newest scan. Compensated, a scan waits for the picture of its time, as is proposed
in section 6.2.5, and the robot's own motion is taken out by odometry.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.config import RobotConfig
from host.geometry import Path
from host.messages import Bearings, Displacement, FloatArray, Scan
from host.perception.scan_match import returns_of
from host.systems.kalman_hungarian.lidar_detection import ASSISTED, DETECTIONS, Detection, detect


@dataclass(frozen=True, slots=True)
class Found:
    """Positions (k, 2) m in the robot frame at `time` (s), and when each was measured, (k,) s."""

    time: float
    positions: FloatArray
    times: FloatArray

    def carried(self, path: Path, time: float) -> "Found":
        """The same in the robot frame at another `time` (s): what was found stands still."""
        then = np.full(len(self.times), self.time)
        return Found(time, path.carry(self.positions, then, time), self.times)


NOTHING = Found(0.0, np.zeros((0, 2)), np.zeros(0))


class Sensors:
    """camera and lidar, by method of detection: the newest that each has found."""

    def __init__(self, config: RobotConfig, compensated: bool) -> None:
        self.compensated = compensated
        self.path = Path()
        self.camera = NOTHING
        self.lidar: dict[Detection, Found] = dict.fromkeys(DETECTIONS, NOTHING)
        self._mounting = np.array([config.lidar.x_m, config.lidar.y_m, config.lidar.heading_rad])
        self._waiting: list[Found] = []  # returns of scans, for the picture of their time

    def take(self, message: Scan | Bearings | Displacement) -> None:
        """Take in one message, in order of arrival."""
        if isinstance(message, Displacement):
            self.path.append(message)
        elif isinstance(message, Scan):
            self._take_scan(message)
        elif message.ranges is not None:
            self._take_picture(message, message.ranges)

    def _take_scan(self, scan: Scan) -> None:
        returns, times = returns_of(scan, self._mounting)
        if not self.compensated:
            self._look_up(Found(scan.time, returns, times), self.camera, DETECTIONS)
            return
        taken = Found(scan.time, self.path.carry(returns, times, scan.time), times)
        self._look_up(taken, NOTHING, ("standalone",))
        self._waiting.append(taken)

    def _take_picture(self, picture: Bearings, ranges: FloatArray) -> None:
        along = np.column_stack((np.cos(picture.bearings), np.sin(picture.bearings)))
        positions = np.array(picture.origin) + ranges[:, None] * along
        taken = picture.time if self.compensated else self.path.end
        self.camera = Found(taken, positions, np.full(len(ranges), taken))
        ready = [scan for scan in self._waiting if scan.time <= picture.time]
        if ready:
            then = self.camera.carried(self.path, ready[-1].time)
            self._look_up(ready[-1], then, ASSISTED)
            self._waiting = self._waiting[len(ready) :]

    def _look_up(self, returns: Found, camera: Found, methods: Sequence[Detection]) -> None:
        """The robots in a scan, by each method, where the camera says they are."""
        for how in methods:
            positions = detect(how, returns.positions, camera.positions)
            apart = np.linalg.norm(positions[:, None] - returns.positions, axis=2)
            nearest = np.argmin(apart, axis=1) if len(positions) else np.zeros(0, dtype=np.int64)
            self.lidar[how] = Found(returns.time, positions, returns.times[nearest])
