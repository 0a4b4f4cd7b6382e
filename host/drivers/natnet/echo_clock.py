"""The clock of a motion capture server in the host's time, by questions and answers."""

from collections import deque
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class _Pair:
    """server (s since the first answer) lies at `host` (s), give or take half the round trip."""

    server: float
    host: float
    round_trip: float


class EchoClock:
    """Maps the server's ticks to host time.

    The server reads its clock between question and answer; the middle of the two is off by half
    the round trip at most. So of each second the pair of the least round trip counts, and over a
    minute a line through those gives the drift, weighted by 1 / round trip² (the idea of the clock
    filter in NTP, RFC 5905 section 10). Before 10 s the drift is taken as none.
    """

    BLOCK_S = 1.0
    BLOCKS = 60
    LEAST_SPAN_S = 10.0
    LARGEST_DRIFT = 5e-4  # as fast as a computer's clock is ever made to run to catch up
    JUMP_S = 0.05  # further off than the round trip explains: the server began to count again

    def __init__(self, clock_hz: int) -> None:
        """clock_hz: ticks per second."""
        self.restarts = 0
        self._hz = clock_hz
        self._base = 0
        self._blocks: deque[_Pair] = deque(maxlen=self.BLOCKS)
        self._origin, self._host, self._slope = 0.0, 0.0, 1.0

    @property
    def ready(self) -> bool:
        """Whether there was an answer yet."""
        return bool(self._blocks)

    @property
    def uncertainty_s(self) -> float:
        """How far the mapping may be off: half the least round trip of the window."""
        return min(pair.round_trip for pair in self._blocks) / 2.0

    def update(self, server: int, sent: float, received: float) -> None:
        """Take in one answer. server: ticks; sent, received: host time (s) of the question and of
        the answer."""
        middle, round_trip = (sent + received) / 2.0, received - sent
        if self.ready and abs(self.host_time(server) - middle) > round_trip / 2.0 + self.JUMP_S:
            self.restarts += 1
            self._blocks.clear()
        if not self.ready:
            self._base = server
        pair = _Pair((server - self._base) / self._hz, middle, round_trip)
        if self._keep(pair):
            self._fit()

    def host_time(self, server: int) -> float:
        """Host time (s) at which the server's clock stood at `server` ticks."""
        return self._host + self._slope * ((server - self._base) / self._hz - self._origin)

    def _keep(self, pair: _Pair) -> bool:
        """Enter the pair; False where its second has one of a lesser round trip already."""
        last = self._blocks[-1] if self._blocks else None
        if last is None or pair.server // self.BLOCK_S > last.server // self.BLOCK_S:
            self._blocks.append(pair)
            return True
        if pair.round_trip >= last.round_trip:
            return False
        self._blocks[-1] = pair
        return True

    def _fit(self) -> None:
        best = min(self._blocks, key=lambda pair: pair.round_trip)
        self._origin, self._host, self._slope = best.server, best.host, 1.0
        if self._blocks[-1].server - self._blocks[0].server < self.LEAST_SPAN_S:
            return
        server = np.array([pair.server for pair in self._blocks])
        host = np.array([pair.host for pair in self._blocks])
        trips = np.array([pair.round_trip for pair in self._blocks])
        weights = np.maximum(trips, 1e-5) ** -2.0
        origin, middle = np.average(server, weights=weights), np.average(host, weights=weights)
        spread = np.sum(weights * (server - origin) ** 2)
        slope = np.sum(weights * (server - origin) * (host - middle)) / spread
        limit = self.LARGEST_DRIFT
        self._slope = float(np.clip(slope, 1.0 - limit, 1.0 + limit))
        self._origin, self._host = float(origin), float(middle)
