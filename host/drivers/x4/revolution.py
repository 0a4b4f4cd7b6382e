"""One revolution of the X4: its packets, kept as they came until it is complete."""

import numpy as np

from host.drivers.x4.packets import (
    ANGLE_STEP_RAD,
    SAMPLE_RATE_HZ,
    STEP_M,
    UNIT_RAD,
    UNITS_PER_REVOLUTION,
    PacketHeader,
    angle_correction,
)
from host.messages import Scan

SLOWEST_HZ, FASTEST_HZ = 6.0, 12.0  # the motor's range, by the data sheet
# The speed is regulated to a few per cent.
REVOLUTION_SAMPLES = round(1.05 * SAMPLE_RATE_HZ / SLOWEST_HZ)
# Revolutions begin at the same angle to 0.4 deg; a packet that ends further than 1 deg beyond a
# whole revolution belongs to the next one.
_FULL = UNITS_PER_REVOLUTION + 64
# Range and correction of every Si there can be: looked up, an arctangent costs seven times more.
_RANGES = np.arange(65536, dtype=np.float64) * STEP_M
_CORRECTIONS = angle_correction(_RANGES)


class Revolution:
    """The packets of one revolution.

    torn: samples are missing, or its first packet is. total: samples.
    """

    def __init__(self, torn: bool) -> None:
        self.torn = torn
        self.total = 0
        self._angle = 0  # from its first sample to its last one, 1/64 deg
        self._fields: list[int] = []  # of each packet: first, span, size, samples counted before it
        self._contents: list[bytes] = []

    @property
    def packets(self) -> int:
        """How many packets it has."""
        return len(self._contents)

    def has_room(self, gap: int, span: int, size: int) -> bool:
        """Does a packet of `size` samples belong to it, `gap` and `span` in 1/64 deg?"""
        return self._angle + gap + span <= _FULL and self.total + size <= REVOLUTION_SAMPLES

    def add(self, header: PacketHeader, gap: int, content: bytes, count: int) -> None:
        """Add a packet, `gap` (1/64 deg) after the last one, with `count` samples before it."""
        _, _, size, first, span = header
        self._angle += gap + span if self.total else span
        self._fields += (first, span, size, count)
        self._contents.append(content)
        self.total += size

    def delay(self, start: int, samples: int) -> None:
        """Count `samples` more before each packet from number `start` on."""
        for place in range(4 * start + 3, len(self._fields), 4):
            self._fields[place] += samples

    def split(self, start: int) -> "Revolution":
        """Take off the packets from number `start` on, as a revolution of their own."""
        rest = Revolution(torn=True)
        rest._fields, self._fields = self._fields[4 * start :], self._fields[: 4 * start]
        rest._contents, self._contents = self._contents[start:], self._contents[:start]
        rest.total = sum(rest._fields[2::4])
        if rest.total:
            last = rest._fields[-4] + rest._fields[-3]
            rest._angle = (last - rest._fields[0]) % UNITS_PER_REVOLUTION
        self.total -= rest.total
        self.torn = True
        return rest

    def speed_hz(self) -> float:
        """Revolutions a second by the angles within the packets; 0 where they have one sample."""
        spans = sum(self._fields[1::4])
        steps = self.total - self.packets
        return SAMPLE_RATE_HZ * spans / (steps * UNITS_PER_REVOLUTION) if steps else 0.0

    def to_scan(self, offset: float) -> Scan:
        """The scan, counter-clockwise with the angle correction; sample 0 was taken at `offset`."""
        samples = np.frombuffer(b"".join(self._contents), dtype="<u2").astype(np.intp)
        number = np.arange(float(self.total))
        sizes = self._fields[2::4]
        lines = np.array(self._fields, dtype=np.float64).reshape(-1, 4).T
        first, span, size, count = lines
        before = size.cumsum() - size
        # Each packet's line taken back to the revolution's first sample.
        span *= -UNIT_RAD
        span /= np.maximum(size - 1.0, 1.0)
        first *= -UNIT_RAD
        first -= span * before
        count -= before
        angle, step, _, count = lines.repeat(sizes, axis=1)
        angles = angle + step * number
        angles -= _CORRECTIONS.take(samples)
        # 16 bits, of which those that overflow are whole revolutions.
        units = np.rint(angles / ANGLE_STEP_RAD).astype(np.int64).astype(np.int16)
        angles = units * ANGLE_STEP_RAD
        times = offset + (count + number) / SAMPLE_RATE_HZ
        return Scan(float(times[-1]), times, angles, _RANGES.take(samples))
