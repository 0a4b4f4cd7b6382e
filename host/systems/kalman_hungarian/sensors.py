"""What a robot's camera and lidar find, message by message.

As published messages are used as they arrive: a picture, some 150 ms late, counts as taken then,
and where the robot drives itself is left out. Compensated they come in the order of their own
times, as is proposed in section 6.2.5, and odometry takes the robot's own motion out. What is
found is so much older then.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from host.config import RobotConfig
from host.geometry import Path, along_rays
from host.messages import Bearings, Displacement, FloatArray, Scan
from host.perception.scan_match import returns_of
from host.systems.kalman_hungarian.lidar_detection import DETECTIONS, Detection, detect

Event = Scan | Bearings | Displacement


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

    def in_order(self, messages: Iterable[Event]) -> list[Event]:
        """Messages, given in order of arrival, in the order in which they are to be taken in."""
        return sorted(messages, key=_begin) if self.compensated else list(messages)

    def take(self, message: Event) -> None:
        """Take in one message."""
        if isinstance(message, Displacement):
            self.path.append(message)
        elif isinstance(message, Scan):
            self._take_scan(message)
        elif message.ranges is not None:
            self._take_picture(message, message.ranges)

    def _take_scan(self, scan: Scan) -> None:
        """Find the robots in a scan by each method, with what the newest picture shows."""
        returns, times = returns_of(scan, self._mounting)
        camera = self.camera
        if self.compensated:
            returns = self.path.carry(returns, times, scan.time)
            camera = camera.carried(self.path, scan.time)
        for how in DETECTIONS:
            positions = detect(how, returns, camera.positions)
            apart = np.linalg.norm(positions[:, None] - returns, axis=2)
            nearest = np.argmin(apart, axis=1) if len(positions) else np.zeros(0, dtype=np.int64)
            self.lidar[how] = Found(scan.time, positions, times[nearest])

    def _take_picture(self, picture: Bearings, ranges: FloatArray) -> None:
        positions = along_rays(picture.origin, picture.bearings, ranges)
        taken = picture.time if self.compensated else self.path.end
        self.camera = Found(taken, positions, np.full(len(ranges), taken))


def _begin(message: Event) -> float:
    """When it began (s), so that the odometry up to a picture comes before it."""
    return message.time - (message.interval if isinstance(message, Displacement) else 0.0)
