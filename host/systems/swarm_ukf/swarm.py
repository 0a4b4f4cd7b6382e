"""The whole of Miller 2019: wait until the swarm is observable, start from nothing, then track.

All robots report to one place: their odometry, and whom they see where. The order of arrival does
not matter as long as `run_until` is called with a time that all of it has reached.
"""

from collections import Counter
from dataclasses import dataclass, field

from host.geometry import Path
from host.messages import Displacement, Positions
from host.systems.swarm_ukf.joint_map import JointMap, Neighbours, Reading
from host.systems.swarm_ukf.start import TimedReading, find_start


@dataclass(frozen=True, slots=True)
class SwarmSettings:
    """window_s: how old a reading may be that helps to start. gain_sigmas: how wrong odometry may
    be, as shares of distance and of rotation. neighbours: "joint", or "exact" as published."""

    window_s: float = 30.0
    gain_sigmas: tuple[float, float] = (0.02, 0.02)
    neighbours: Neighbours = "joint"


@dataclass
class SwarmUkf:
    """Poses of `count` robots, numbered from 0. map: None until they are observable; why: in words
    what is missing until then, and how often it was."""

    count: int
    settings: SwarmSettings = SwarmSettings()
    map: JointMap | None = None
    why: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        keep = self.settings.window_s + 1.0
        self._paths = {robot: Path(keep) for robot in range(self.count)}
        self._pending: list[TimedReading] = []
        self._recent: list[TimedReading] = []
        self._times = [0.0] * self.count

    def take(self, robot: int, message: Displacement | Positions) -> None:
        """Robot `robot` has moved, or has seen `message.identities`; a negative one is nobody."""
        if isinstance(message, Displacement):
            self._paths[robot].append(message)
            return
        if message.identities is None:
            return
        rows = zip(message.positions, message.covariances, message.identities, strict=True)
        for position, covariance, seen in rows:
            if 0 <= seen < self.count and seen != robot:
                reading = Reading(robot, int(seen), position, covariance)
                self._pending.append(TimedReading(message.time, reading))

    def run_until(self, time: float) -> None:
        """Take in all readings up to `time` (s) and predict every robot to it."""
        self._pending.sort(key=lambda timed: timed.time)
        due = [timed for timed in self._pending if timed.time <= time]
        self._pending = self._pending[len(due) :]
        if self.map is None:
            self._recent += due
            self._recent = [r for r in self._recent if r.time > time - self.settings.window_s]
            self._try_to_start(time)
            return
        for timed in due:
            self._predict(timed.reading.observer, timed.time)
            self._predict(timed.reading.seen, timed.time)
            self.map.update(timed.reading)
        for robot in range(self.count):
            self._predict(robot, time)
        self.map.lay_frame()

    def _try_to_start(self, time: float) -> None:
        found = find_start(self._recent, self._paths, time, self.settings.gain_sigmas)
        if isinstance(found, str):
            self.why[found] += 1
            return
        self.map = JointMap(
            found.poses, found.covariance, self.settings.gain_sigmas, self.settings.neighbours
        )
        self._times = [time] * self.count
        self._recent = []

    def _predict(self, robot: int, time: float) -> None:
        if self.map is not None and time > self._times[robot]:
            self.map.predict(robot, self._paths[robot].between(self._times[robot], time))
            self._times[robot] = time
