"""YDLidar X4: bytes → scans. Pure and incremental; never raises on garbage, counts it.

The formats are in packets.py (samples) and commands.py (everything else).
"""

import math
import re
from dataclasses import replace

from host.drivers.x4.commands import REPLY_HEADER, Reply, parse_reply, reply_length
from host.drivers.x4.packets import (
    BAUDRATE,
    BITS_PER_BYTE,
    HEADER,
    HEADER_LENGTH,
    SAMPLE_RATE_HZ,
    UNITS_PER_REVOLUTION,
    PacketHeader,
    read_packet,
)
from host.drivers.x4.revolution import Revolution
from host.drivers.x4.sample_clock import Delay, SampleClock
from host.messages import Scan

_STARTS = re.compile(re.escape(HEADER) + b"|" + re.escape(REPLY_HEADER))
_SECONDS_PER_BYTE = BITS_PER_BYTE / BAUDRATE
# An angle that lies so little behind the expected one is no loss of most of a revolution.
_BACKWARD_UNITS = 320
_START_JITTER_UNITS = 40  # by which revolutions begin at different angles


def delayed(scan: Scan, delay_s: float) -> Scan:
    """The scan as it was taken, `delay_s` before its bytes say."""
    return replace(scan, time=scan.time - delay_s, times=scan.times - delay_s)


class ScanDecoder:
    """Turns the byte stream of an X4, cut anywhere, into scans and replies.

    counts: by name, since the start. speed_hz: revolutions per second as the lidar reports them, 0
    where it does not. motor_hz: the same by the angles of the last revolution. last_return: when
    the newest packet came in which anything came back, host time, s.
    A packet is held back until its checksum is right and what follows it does not speak against
    its length; after a bad one the search goes on right behind its header, so that damage costs
    the packets it touches and no other.
    """

    def __init__(self) -> None:
        self.counts = dict.fromkeys(
            (
                "bytes",
                "bytes_skipped",
                "packets",
                "checksum_errors",
                "implausible_packets",
                "replies",
                "points",
                "points_lost",
                "revolutions",
                "revolutions_torn",
                "clock_restarts",
            ),
            0,
        )
        self.speed_hz = self.motor_hz = 0.0
        self.last_return = -math.inf
        self._replies: list[Reply] = []
        self.reset()

    def reset(self) -> None:
        """Forget what is half read: the stream restarts. Counts go on."""
        self._buffer = b""
        self._arrivals: list[tuple[int, float]] = []  # (end in the buffer, when) of each chunk
        self._clock = SampleClock()
        self._revolution = Revolution(torn=True)
        self._done: list[Revolution] = []  # complete, but not yet handed out
        self._end = 0  # of the last packet, 1/64 deg
        self._step = 0.0  # from sample to sample
        self._largest_gap = math.inf  # between packets of which none is missing
        self._delay: Delay | None = None
        self._delayed: list[tuple[Revolution, int]] = []  # and from which packet on

    def take_replies(self) -> list[Reply]:
        """Replies to commands that came since the last call, oldest first."""
        replies, self._replies = self._replies, []
        return replies

    def feed(self, data: bytes, arrival: float) -> list[Scan]:
        """Take the next bytes, read at host time `arrival` (s); return completed scans."""
        if not data:
            return []
        self.counts["bytes"] += len(data)
        self._buffer += data
        self._arrivals.append((len(self._buffer), arrival))
        scans: list[Scan] = []
        position = self._consume(scans)
        self._buffer = self._buffer[position:]
        self._arrivals = [(end - position, when) for end, when in self._arrivals if end > position]
        return scans

    def _consume(self, scans: list[Scan]) -> int:
        """Read packets and replies off the buffer; return where what is still open begins."""
        buffer, size = self._buffer, len(self._buffer)
        position = 0
        while True:
            if not buffer.startswith(HEADER, position):
                match = _STARTS.search(buffer, position)
                if match is None:
                    kept = int(size > position and buffer[-1] in (HEADER[0], REPLY_HEADER[0]))
                    self._skip(size - kept - position)
                    return size - kept
                self._skip(match.start() - position)
                position = match.start()
            if buffer[position] == HEADER[0]:
                length = self._read_packet(position, scans)
            else:
                length = self._read_reply(position)
            if length is None:
                return position
            if length == 0:
                length = len(HEADER)
                self._skip(length)
            position += length

    def _skip(self, length: int) -> None:
        self.counts["bytes_skipped"] += length

    def _read_reply(self, start: int) -> int | None:
        """Length of the reply at `start`; 0 where there is none, None where it is incomplete."""
        length = reply_length(self._buffer[start : start + 7])
        if length == 0:
            return 0
        if len(self._buffer) < start + length:
            return None
        reply = parse_reply(self._buffer[start : start + length])
        if reply is None:
            return 0
        self.counts["replies"] += 1
        self._replies.append(reply)
        return length

    def _read_packet(self, start: int, scans: list[Scan]) -> int | None:
        """Length of the packet at `start`; 0 where there is none, None where it is incomplete."""
        header = read_packet(self._buffer, start)
        if header is None:
            return None
        if isinstance(header, str):
            self.counts[header] += 1
            return 0
        length = HEADER_LENGTH + 2 * header.size
        end = start + length
        content = self._buffer[start + HEADER_LENGTH : end]
        for chunk_end, arrival in self._arrivals:
            if chunk_end >= end:
                sent = arrival - length * _SECONDS_PER_BYTE
                self._accept(header, content, sent, (chunk_end - end) * _SECONDS_PER_BYTE, scans)
                break
        return length

    def _accept(
        self, header: PacketHeader, content: bytes, sent: float, waited: float, scans: list[Scan]
    ) -> None:
        """Add a sound packet to its revolution.

        sent: when at the latest. waited: how long at least it lay in the host's buffer, s.
        """
        starts, _, size, first, span = header
        counts, clock = self.counts, self._clock
        counts["packets"] += 1
        counts["points"] += size
        if content.count(0) < len(content):
            self.last_return = sent
        gap = (first - self._end) % UNITS_PER_REVOLUTION
        lost = 0
        if gap > self._largest_gap:
            gap, lost = self._explain_gap(gap, header)
            counts["points_lost"] += lost
            clock.count += lost
        late = clock.advance(size, sent) - waited
        revolution = self._revolution
        if starts or not revolution.has_room(gap, span, size):
            revolution = self._begin(header)
            gap = 0
        if lost:
            revolution.torn = True
        if self._delay is not None or late > Delay.LATE_S:
            self._watch_delay(late, sent, lost > 0)
            revolution = self._revolution
        revolution.add(header, gap, content, clock.count - size)
        if self._done and self._delay is None:
            self._deliver(scans)
        self._end = first + span
        if size > 1:
            self._step = span / (size - 1)
            self._largest_gap = 1.5 * self._step

    def _explain_gap(self, gap: int, header: PacketHeader) -> tuple[int, int]:
        """The angle (1/64 deg) between two packets, negative if back, and how many samples lack.

        By the angles, which do not show whole revolutions that are missing.
        """
        if gap > UNITS_PER_REVOLUTION - _BACKWARD_UNITS:
            return gap - UNITS_PER_REVOLUTION, 0
        jitter = _START_JITTER_UNITS if header.starts_revolution else 0
        # The motor's speed may differ before and after the gap.
        step = max(self._step, header.span / max(1, header.size - 1))
        lost = round((gap - jitter) / step) - 1 if step > 0.0 else 0
        return gap, max(0, lost)

    def _begin(self, header: PacketHeader) -> Revolution:
        """End the revolution under way before this packet."""
        if self._revolution.total:
            self._done.append(self._revolution)
        self._revolution = Revolution(torn=not header.starts_revolution)
        if self._delay is not None:
            self._delayed.append((self._revolution, 0))
        if header.starts_revolution:
            self.speed_hz = header.speed_tenths / 10.0
        return self._revolution

    def _watch_delay(self, late: float, arrival: float, angles_jumped: bool) -> None:
        """Find out whether packets are late because the host was busy, or samples are missing.

        Revolutions are held back until this is known.
        """
        if self._delay is None or self._delay.is_another(late):
            self._delay = Delay(late, arrival, angles_jumped)
            self._delayed = [(self._revolution, self._revolution.packets)]
            return
        remaining = self._delay.update(late, arrival)
        if remaining is None:
            return
        if remaining > 0.0:
            self._make_up(remaining, self._delay.angles_jumped)
        self._delay = None

    def _make_up(self, seconds: float, angles_jumped: bool) -> None:
        """Let the clock pass over `seconds` in which no sample came, before the first late packet.

        Where the angles jumped, packets are missing, and what the angles cannot show is whole
        revolutions. Else the lidar paused.
        """
        shift = round(seconds * SAMPLE_RATE_HZ)
        whole = 0
        if angles_jumped:
            revolution_samples = UNITS_PER_REVOLUTION / self._step
            whole = round(round(shift / revolution_samples) * revolution_samples)
        if whole and abs(whole - shift) < Delay.LATE_S * SAMPLE_RATE_HZ:
            self.counts["points_lost"] += whole
            shift = whole
        else:
            self.counts["clock_restarts"] += 1
        self._clock.count += shift
        for revolution, start in self._delayed:
            revolution.delay(start, shift)
        revolution, start = self._delayed[0]
        if start:  # it must not contain samples of two revolutions
            rest = revolution.split(start)
            if revolution is self._revolution:
                self._revolution = rest
                self._done.append(revolution)
            else:
                place = self._done.index(revolution)
                self._done.insert(place + 1, rest)

    def _deliver(self, scans: list[Scan]) -> None:
        """Hand out the revolutions that are complete."""
        for revolution in self._done:
            self.counts["revolutions"] += 1
            self.counts["revolutions_torn"] += revolution.torn
            self.motor_hz = revolution.speed_hz()
            scans.append(revolution.to_scan(self._clock.offset or 0.0))
        self._done.clear()
