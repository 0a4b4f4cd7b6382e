"""The simulated teammates' radios: signed odometry, by UDP to this computer."""

import contextlib
import math
import secrets
import socket
import time
from collections.abc import Callable

import numpy as np

from host.config import LinkSettings
from host.drivers.link.protocol import Report, encode
from host.geometry import to_frame, to_parent
from host.messages import FloatArray
from host.simulation.devices.workers import Workers

Poses = Callable[[float], FloatArray]

OBSERVER = 0  # the number of the robot that listens
_LOST, _LATE_S = 0.1, 0.02  # share of datagrams, and mean delay of the others
_GAIN_SIGMA = 0.01  # of each robot's odometry
_VARIANCE = 1e-5  # m² and rad² that its odometry claims from one datagram to the next
_POLL_S = 0.01
_ADDRESS = "127.0.0.1"


class LinkSenders(Workers):
    """Send while the `with` block lasts. settings: what a listener needs.

    poses: host time (s) → poses (n, 3) of all robots on the floor, the listener first; called from
    its own thread. Robot k has the number k.
    """

    def __init__(
        self,
        poses: Poses,
        rate_hz: float,
        seed: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._poses = poses
        self._clock = clock
        self._random = np.random.default_rng(seed)
        with contextlib.ExitStack() as opened:
            self._socket = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            super().__init__({"link senders": self._run}, opened)
        self.settings = LinkSettings(
            robot=OBSERVER,
            key=secrets.token_hex(16),
            address=_ADDRESS,
            port=_free_port(),
            rate_hz=rate_hz,
        )
        self._began = clock()
        self._session = round(time.time() * 1e6)
        self._sequence = 0
        self._before: FloatArray | None = None  # true poses at the last datagram
        self._totals = np.zeros((0, 3))  # of the odometry
        self._gains = np.ones((0, 2))

    def _run(self) -> None:
        pending: list[tuple[float, bytes]] = []
        due = self._clock()
        while not self._stop.wait(_POLL_S):
            now = self._clock()
            if now >= due:
                due = now + 1.0 / self.settings.rate_hz
                self._drive(self._poses(now))
                pending += self._datagrams(now)
                self._sequence += 1
            for _, datagram in (each for each in pending if each[0] <= now):
                self._socket.sendto(datagram, (_ADDRESS, self.settings.port))
            pending = [each for each in pending if each[0] > now]

    def _drive(self, poses: FloatArray) -> None:
        """Integrate each robot's odometry, which is off by a gain of its own."""
        if self._before is None:
            self._totals = np.zeros((len(poses), 3))
            self._gains = self._random.normal(1.0, _GAIN_SIGMA, (len(poses), 2))
            self._before = poses
        steps = to_frame(poses[:, :2], self._before) * self._gains[:, :1]
        turned = poses[:, 2] - self._before[:, 2]
        turned = (turned + math.pi) % (2.0 * math.pi) - math.pi
        for robot, step in enumerate(steps):
            self._totals[robot, :2] = to_parent(step[None], self._totals[robot])[0]
        self._totals[:, 2] += self._gains[:, 1] * turned
        self._before = poses

    def _datagrams(self, now: float) -> list[tuple[float, bytes]]:
        """What is not lost, and when it arrives."""
        key = self.settings.key.encode()
        variance = _VARIANCE * self._sequence
        sent = round((now - self._began) * 1e6)
        datagrams = []
        for robot, (x, y, heading) in enumerate(self._totals.tolist()):
            if robot == OBSERVER or self._random.uniform() < _LOST:
                continue
            report = Report(
                robot,
                self._session,
                self._sequence,
                sent,
                0.0,
                (x, y, heading),
                (variance, variance),
            )
            late = float(self._random.exponential(_LATE_S))
            datagrams.append((now + late, encode(report, key)))
        return datagrams


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])
