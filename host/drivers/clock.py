"""A device's clock in the host's time: at which host time had its counter a given value?"""

import itertools
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class _Pair:
    """The device's time (s, unwrapped) in a frame, and the host's time (s) at its arrival."""

    device: float
    arrival: float


class ClockSync:
    """Maps a free-running device counter to host time by regression over (counter, arrival) pairs.

    A frame arrives late (a busy host, a full buffer), never early. So the line that is looked for
    runs below all pairs and, among those, closest to them on average: it is the edge of their
    lower convex hull over the mean device time (Moon, Skelly and Towsley 1999, "Estimation and
    removal of clock skew from network delay measurements"). That is the outlier gate: a late pair
    lies above the hull and cannot move the line. The smallest latency is not observable and stays
    in the result.

    The window is `BLOCKS` blocks of `BLOCK_S`, of each of which the least late pair is kept.
    """

    BLOCK_S = 0.5
    BLOCKS = 40
    # A ceramic resonator keeps 0.5 %; no line steeper or flatter than this is believed.
    LARGEST_DRIFT = 0.01
    # A pair so much later than the line counts as late, s: more than the ordinary jitter of an
    # adapter's latency timer (16 ms) and of a loop that reads every 10 or 20 ms.
    LATE_S = 0.05
    # A counter so far ahead of what the line allows did not get there by running, s. It is more
    # than a first frame is likely to be late by, which makes all the following ones look early.
    RESTART_S = 2.0
    # A counter so far behind for so long stood still: what a busy host reads late comes at once.
    STOOD_S = 1.0

    def __init__(self, bits: int = 32, tick_s: float = 1e-6) -> None:
        """bits: width of the counter. tick_s: seconds per count."""
        self.restarts = 0
        self.late = 0
        self._period = 1 << bits
        self._tick_s = tick_s
        self.forget()

    def forget(self) -> None:
        """Start again with the next pair, because the device did; the counts stay."""
        self._counter: int | None = None
        self._device = 0.0
        self._blocks: deque[_Pair] = deque(maxlen=self.BLOCKS)
        self._block = 0
        self._origin, self._base, self._slope = 0.0, 0.0, 1.0
        self._behind_since: float | None = None  # arrival, s

    def update(self, counter: int, arrival: float) -> float:
        """Host time (s) at which the device's counter stood at `counter`; never after `arrival`.

        counter: as sent, wrapped. arrival: host time (s) at which it came. Pairs come in the order
        in which the device sent them. A counter that wrapped goes on; one that jumped or stood
        still restarts and is counted in `restarts`.
        """
        device = self._unwrap(counter, arrival)
        if self._counter is not None and (
            device > self._device_at(arrival) + self.RESTART_S or self._stood_still(device, arrival)
        ):
            self.restarts += 1
            self.forget()
            device = 0.0
        self._counter, self._device = counter, device
        if self._keep(_Pair(device, arrival)):
            self._fit()
        if arrival > self._host_at(device) + self.LATE_S:
            self.late += 1
        return min(self._host_at(device), arrival)

    def _stood_still(self, device: float, arrival: float) -> bool:
        """Is the counter behind the line for so long that no delay explains it?"""
        if arrival <= self._host_at(device) + self.RESTART_S:
            self._behind_since = None
        elif self._behind_since is None:
            self._behind_since = arrival
        return self._behind_since is not None and arrival > self._behind_since + self.STOOD_S

    def _unwrap(self, counter: int, arrival: float) -> float:
        """The device's time (s) since the first pair, with whole periods nobody saw added."""
        if self._counter is None:
            return 0.0
        device = self._device + (counter - self._counter) % self._period * self._tick_s
        period_s = self._period * self._tick_s
        return device + max(0, round((self._device_at(arrival) - device) / period_s)) * period_s

    def _keep(self, pair: _Pair) -> bool:
        """Enter the pair into the window; False where its block has a less late one already."""
        block = int(pair.device / self.BLOCK_S)
        if not self._blocks or block > self._block:
            self._blocks.append(pair)
            self._block = block
            return True
        if self._lateness(pair) >= self._lateness(self._blocks[-1]):
            return False
        self._blocks[-1] = pair
        return True

    def _fit(self) -> None:
        """The line below all kept pairs that is closest to them on average."""
        hull = _lower_hull(self._blocks)
        mean = sum(pair.device for pair in self._blocks) / len(self._blocks)
        slope = 1.0
        for left, right in itertools.pairwise(hull):
            slope = (right.arrival - left.arrival) / (right.device - left.device)
            if right.device >= mean:
                break
        slope = min(max(slope, 1.0 - self.LARGEST_DRIFT), 1.0 + self.LARGEST_DRIFT)
        support = min(hull, key=lambda pair: pair.arrival - slope * pair.device)
        self._origin, self._base, self._slope = support.device, support.arrival, slope

    def _host_at(self, device: float) -> float:
        return self._base + self._slope * (device - self._origin)

    def _device_at(self, host: float) -> float:
        return self._origin + (host - self._base) / self._slope

    def _lateness(self, pair: _Pair) -> float:
        return pair.arrival - self._host_at(pair.device)


def _lower_hull(pairs: deque[_Pair]) -> list[_Pair]:
    """The lower convex hull of pairs in order of device time (Andrew's monotone chain)."""
    hull: list[_Pair] = []
    for pair in pairs:
        while len(hull) > 1 and _above(hull[-1], hull[-2], pair):
            hull.pop()
        hull.append(pair)
    return hull


def _above(middle: _Pair, left: _Pair, right: _Pair) -> bool:
    """Does `middle` lie on or above the line from `left` to `right`?"""
    rise = (middle.arrival - left.arrival) * (right.device - left.device)
    return rise >= (right.arrival - left.arrival) * (middle.device - left.device)
