"""When each sample of the X4 was taken, in host time, from the count of samples and arrivals."""

from host.drivers.x4.packets import SAMPLE_RATE_HZ


class SampleClock:
    """Samples counted at 5000 a second, tied to the host's clock by the arrivals of packets.

    A byte can only arrive late, so the earliest arrivals give the offset between the count and
    the host's clock; delays of USB and of the scheduler do not enter. The offset may rise by 1 %,
    which follows a lidar that is slower than it should be by as much.
    """

    RISE = 0.01

    def __init__(self) -> None:
        self.count = 0
        self.offset: float | None = None

    def advance(self, samples: int, arrival: float) -> float:
        """Count `samples` that were complete at `arrival` (s); return by how much that is late."""
        self.count += samples
        offset = arrival - (self.count - 1) / SAMPLE_RATE_HZ
        if self.offset is None:
            self.offset = offset
            return 0.0
        late = offset - self.offset
        self.offset = min(offset, self.offset + self.RISE * samples / SAMPLE_RATE_HZ)
        return late


class Delay:
    """Packets began to arrive late: is the host behind, or did the lidar leave something out?

    A host that was busy reads what has piled up faster than the lidar sends, and is soon on time
    again. Where the lateness stays, samples are missing before the first late packet.
    """

    LATE_S = 0.02  # more than the ordinary jitter of an adapter's latency timer (16 ms)
    SETTLE_S = 0.1
    _CATCHING_UP_S = 0.005
    _ANOTHER_S = 0.03
    _JITTER_S = 0.05

    def __init__(self, late: float, arrival: float, angles_jumped: bool) -> None:
        """late: s, of the packet that arrived at `arrival`. angles_jumped: with a loss, surely."""
        self.least = late
        self.angles_jumped = angles_jumped
        self._since = arrival

    def is_another(self, late: float) -> bool:
        """Is a packet so late (s) that the first late ones before it were ordinary jitter?"""
        jitter = self.least < self._JITTER_S and not self.angles_jumped
        return jitter and late > self.least + self._ANOTHER_S

    def update(self, late: float, arrival: float) -> float | None:
        """Take the lateness (s) of the next packet; return what stays (0: none), None: not yet."""
        if late <= self.LATE_S:
            return 0.0
        if late < self.least - self._CATCHING_UP_S:
            self._since = arrival
        self.least = min(self.least, late)
        return self.least if arrival >= self._since + self.SETTLE_S else None
