"""Each sensor against the others, to find one whose valid messages have wrong content.

Everything goes by the messages' own times, so that a recording gives the same verdicts.
"""

import math

from host.config import RobotConfig
from host.cross_checks.cameras import LidarAgainstCameras
from host.cross_checks.wheels import WheelsAgainstLidar
from host.geometry import Path
from host.messages import Bearings, Displacement, Health, Message, Scan

DEVICE = "cross-check"
_PERIOD_S = 1.0
_GAP_S = 0.2  # the odometry of a longer one is unknown


class CrossChecks:
    """Takes every message of a run and reports contradictions once per second of their time."""

    def __init__(self, config: RobotConfig) -> None:
        self._wheels = WheelsAgainstLidar(config)
        self._cameras = LidarAgainstCameras(config)
        self._path = Path()
        self._scan: Scan | None = None  # waits for its odometry
        self._next = -math.inf

    def take(self, message: Message) -> Health | None:
        """Take the next message; return Health where one is due: after a first comparison."""
        if isinstance(message, Displacement):
            self._take_displacement(message)
        elif isinstance(message, Scan):
            self._scan = message
        elif isinstance(message, Bearings):
            self._cameras.take_bearings(message, self._path)
        else:
            return None
        return self._due(message.time)

    def _take_displacement(self, step: Displacement) -> None:
        end = self._path.end
        if math.isfinite(end) and step.time - step.interval > end + _GAP_S:
            self._wheels.forget()
            self._cameras.forget()
            self._scan = None
        self._path.append(step)
        if self._scan is not None and self._path.end >= self._scan.time:
            scan, self._scan = self._scan, None
            self._wheels.take(scan, self._path)
            self._cameras.take_scan(scan, self._path)

    def _due(self, time: float) -> Health | None:
        if time < self._next or not (self._wheels.compared or self._cameras.compared):
            return None
        self._next = time + _PERIOD_S
        # Where the odometry is wrong, or scans are old, pictures do not meet them either.
        fault = self._wheels.fault() or self._cameras.fault()
        counts = {
            "comparisons": self._wheels.compared,
            "contradictions": self._wheels.contradictions,
            "pictures": self._cameras.compared,
        }
        return Health(time, DEVICE, fault is None, str(fault or self._agreement()), counts)

    def _agreement(self) -> str:
        pairs = []
        if self._wheels.compared:
            pairs.append("no contradiction between wheels and lidar")
        if self._cameras.compared:
            pairs.append("no contradiction between lidar and cameras")
        return ", ".join(pairs) or "nothing to compare in the last minute"
