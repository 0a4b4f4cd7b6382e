"""Drives by a behaviour: gathers its inputs, calls it, and lets safety overrule its command.

The messages come from the threads of their devices, the estimates from the localizer's, and a
thread of its own drives; so a slow filter ages estimates, but keeps nobody from braking.
"""

import dataclasses
import math
import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from host.behaviour.interface import STILL, Behaviour, Command, Situation
from host.behaviour.obstacles import Obstacles
from host.behaviour.safety import ODOMETRY_S, PERIOD_S, SCAN_S, SILENCE_S, Safety
from host.config import RobotConfig
from host.drivers.health import HealthReporter
from host.drivers.x4.liveness import FROZEN_RETURNS, Repeats
from host.geometry import Path, rotation, to_frame, to_parent
from host.messages import Displacement, Estimate, FloatArray, Message, Scan

DRIVER = "driver"

_SPEED_S = 0.1  # over which the robot's own speed is taken
_COAST_S = 0.3  # after the last report of the wheels

# Sends a speed (m/s) and a turn rate (rad/s) to the board.
Send = Callable[[float, float], None]


class Driving:
    """One robot under a behaviour.

    heard: when the lidar's newest return came (s); None: this lidar cannot tell, and the robot
    trusts whole revolutions. done: the behaviour has ended. stopped: asked at every step; once it
    is true the robot stands still, however long the rest takes to end.
    """

    def __init__(
        self,
        config: RobotConfig,
        behaviour: Behaviour,
        send: Send,
        heard: Callable[[], float] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.safety = Safety(config)
        self.done = False
        self.stopped: Callable[[], bool] = lambda: False
        self._behaviour = behaviour
        self._send = send
        self._heard = heard
        self._clock = clock
        self._health = HealthReporter(DRIVER, clock)
        self._lock = threading.Lock()
        self._path = Path()
        self._obstacles = Obstacles(config.lidar)
        self._repeats = Repeats()
        self._steps: deque[Displacement] = deque()
        self._speeds = 0.0, 0.0
        self._estimate: Estimate | None = None
        self._seen_from = np.zeros(3)

    def take(self, message: Message) -> None:
        """Receive a device's message, in that device's thread."""
        if isinstance(message, Displacement):
            with self._lock:
                self._path.append(message)
                self._measure_speeds(message)
        elif isinstance(message, Scan):
            with self._lock:
                self._repeats.add(message.ranges)
                frozen = np.count_nonzero(message.ranges) >= FROZEN_RETURNS and self._repeats.count
                if not frozen:
                    self._obstacles.add(message, self._path)

    def know(self, estimate: Estimate) -> None:
        """Receive the present estimate, in the localizer's thread."""
        with self._lock:
            self._estimate = estimate
            self._seen_from = self._pose_at(estimate.time)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Drive until `stop` is set, then stop the robot; emit Health."""
        due = self._clock()
        try:
            while not stop.wait(max(0.0, due - self._clock())):
                now = self._clock()
                self.step(now)
                halt = self.safety.halt
                self._health.report(emit, not halt, halt or "driving", dict, certain=True)
                due = max(due + PERIOD_S, now)
        finally:
            self._send(0.0, 0.0)

    def step(self, now: float) -> Command:
        """Call the behaviour and send the command that safety allows."""
        with self._lock:
            situation = self._situation(now)
            lost = self._lost(now)
        wanted: Command | None = STILL
        if self.stopped():
            lost = "stopped"
        if not lost and not self.done:
            wanted = self._behaviour.command(situation)
            self.done = wanted is None
        command = self.safety.allowed(wanted, situation, lost)
        self._send(command.speed_mps, command.turn_rate_radps)
        return command

    def _lost(self, now: float) -> str:
        """The lost sensor for which the robot must stop; "": none."""
        if math.isinf(self._path.end) or math.isinf(self._obstacles.time):
            return "waiting for lidar and wheels"
        if now - self._path.end > ODOMETRY_S:
            return "the wheels report nothing"
        if now - self._obstacles.time > SCAN_S:
            return "the lidar is lost"
        if self._heard is not None and now - self._heard() > SILENCE_S:
            return "nothing returns to the lidar"
        return ""

    def _situation(self, now: float) -> Situation:
        pose = self._pose_at(now)
        points, ages = self._obstacles.seen_from(pose, now)
        estimate = None
        if self._estimate is not None:
            estimate = moved(self._estimate, self._seen_from, pose, now)
        x, y, heading = pose.tolist()
        speed, turn_rate = self._speeds
        return Situation(now, points, ages, estimate, (x, y, heading), speed, turn_rate)

    def _measure_speeds(self, newest: Displacement) -> None:
        """The robot's own speed and turn rate over the last _SPEED_S."""
        self._steps.append(newest)
        while newest.time - self._steps[0].time >= _SPEED_S:
            self._steps.popleft()
        seconds = max(sum(step.interval for step in self._steps), 1e-3)
        ways = sum(math.copysign(math.hypot(step.dx, step.dy), step.dx) for step in self._steps)
        self._speeds = ways / seconds, sum(step.dpsi for step in self._steps) / seconds

    def _pose_at(self, time: float) -> FloatArray:
        """The pose (3,) by the wheels, extrapolated after their last report."""
        ahead = min(time - self._path.end, _COAST_S)
        if ahead <= 0.0:
            pose: FloatArray = self._path.poses(np.array([time]))[0]
            return pose
        x, y, heading = self._path.last.tolist()
        speed, turn_rate = self._speeds
        along = heading + 0.5 * ahead * turn_rate
        way = ahead * speed
        return np.array(
            [x + way * math.cos(along), y + way * math.sin(along), heading + ahead * turn_rate]
        )


def moved(estimate: Estimate, seen_from: FloatArray, pose: FloatArray, time: float) -> Estimate:
    """The same estimate in the frame at another pose (3,) and a later time (s).

    seen_from (3,): the pose of its own time. Teammates stand still in between.
    """
    rotated_by = float(seen_from[2] - pose[2])
    turned = rotation(rotated_by)
    origin = np.array([*to_frame(seen_from[:2], pose), rotated_by])

    def carried(points: FloatArray) -> FloatArray:
        return to_parent(points, origin)

    return dataclasses.replace(
        estimate,
        time=time,
        positions=carried(estimate.positions),
        covariances=turned @ estimate.covariances @ turned.T,
        ages=estimate.ages + (time - estimate.time),
        obstacles=carried(estimate.obstacles),
        obstacle_covariances=turned @ estimate.obstacle_covariances @ turned.T,
    )
