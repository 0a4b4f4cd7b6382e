"""YDLidar X4: bytes → turns. Pure and incremental; never raises on garbage, counts it.

The lidar's words are in x4_packets.py (samples) and x4_commands.py (everything else).
"""

import math
import re

import numpy as np

from host.drivers.x4.commands import REPLY_HEADER, Reply, parse_reply, reply_length
from host.drivers.x4.packets import (
    BAUDRATE,
    BITS_PER_BYTE,
    HEADER,
    HEADER_LENGTH,
    SAMPLE_RATE_HZ,
    STEP_M,
    UNIT_RAD,
    UNITS_PER_TURN,
    PacketHeader,
    angle_correction,
    read_packet,
)
from host.messages import Scan

_STARTS = re.compile(re.escape(HEADER) + b"|" + re.escape(REPLY_HEADER))
_SECONDS_PER_BYTE = BITS_PER_BYTE / BAUDRATE
# Range and correction of every Si there can be: looked up, an arctangent costs seven times more.
_RANGES = np.arange(65536, dtype=np.float64) * STEP_M
_CORRECTIONS = angle_correction(_RANGES)


class SampleClock:
    """When each sample was taken: samples counted at 5000 a second, tied to arrivals.

    A byte can only arrive late, so the earliest arrivals tell the offset between the count and
    the host's clock; delays of USB and of the scheduler do not enter. The offset may rise by 1 %,
    which follows a lidar that is slower than it should be by as much. A busy host has caught up
    after `BEHIND_S`; where all arrivals stay `BEHIND_BY_S` late for longer, the lidar has paused.
    """

    RISE = 0.01
    LATE_S = 1.0
    LATE_AFTER_LOSS_S = 0.1
    BEHIND_S = 0.5
    BEHIND_BY_S = 0.02

    def __init__(self) -> None:
        self.count = 0
        self.offset: float | None = None
        # Since when all arrivals are late, and the least offset they tell.
        self._behind: tuple[float, float] | None = None

    def advance(self, samples: int, arrival: float, lost: int | None) -> bool:
        """Count `samples` that were complete at `arrival`, after `lost` ones (None: nothing lost).

        False where the time between is unknown, so that the clock starts anew.
        """
        step = samples + (lost or 0)
        self.count += step
        offset = arrival - (self.count - 1) / SAMPLE_RATE_HZ
        if self.offset is None:
            self.offset = offset
            return True
        late = offset - self.offset
        if late > (self.LATE_S if lost is None else self.LATE_AFTER_LOSS_S):
            self.offset, self._behind = offset, None
            return False
        if late <= self.BEHIND_BY_S:
            self._behind = None
        else:
            since, least = self._behind or (arrival, offset)
            self._behind = since, min(least, offset)
            if arrival > since + self.BEHIND_S:
                self.offset, self._behind = self._behind[1], None
                return False
        self.offset = min(offset, self.offset + self.RISE * step / SAMPLE_RATE_HZ)
        return True


class _Turn:
    """Packets of one turn, kept as they came until the turn is complete."""

    def __init__(self, first: int, whole: bool, by_angle: bool = False) -> None:
        self.first = first  # raw angle it began at, 1/64 deg
        self.by_angle = by_angle  # its first packet was lost: it began by passing that angle
        self.torn = not whole
        self.phase = 0  # 1/64 deg from the turn's first sample to the last packet's
        self.contents: list[bytes] = []
        self.sizes: list[int] = []
        self.total = 0
        # A packet's angle (rad, counter-clockwise, without correction), its step from sample to
        # sample, and the count of samples, each taken back to the turn's first sample.
        self.lines: list[tuple[float, float, int]] = []

    def add(self, header: PacketHeader, content: bytes, count: int) -> None:
        """Add a packet, `count` samples having been counted before it."""
        begin, size = self.total, header.size
        step = -UNIT_RAD * header.span / (size - 1) if size > 1 else 0.0
        self.lines.append((-UNIT_RAD * header.first - step * begin, step, count - begin))
        self.contents.append(content)
        self.sizes.append(size)
        self.total += size

    def to_scan(self, offset: float) -> Scan:
        """The turn with both angle corrections, counter-clockwise, at host time."""
        samples = np.frombuffer(b"".join(self.contents), dtype="<u2").astype(np.intp)
        number = np.arange(float(self.total))
        angle, step, count = np.repeat(np.array(self.lines), self.sizes, axis=0).T
        angles = angle + step * number
        angles -= _CORRECTIONS.take(samples)
        angles[angles < -math.pi] += 2.0 * math.pi
        times = offset + (count + number) / SAMPLE_RATE_HZ
        return Scan(float(times[-1]), times, angles, _RANGES.take(samples))


class ScanDecoder:
    """Turns the byte stream of an X4, cut anywhere, into scans and replies.

    counts: by name, since the start. turn_rate_hz: as the lidar tells it, 0 where it does not.
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
                "turns",
                "turns_torn",
                "clock_restarts",
            ),
            0,
        )
        self.turn_rate_hz = 0.0
        self._replies: list[Reply] = []
        self.reset()

    def reset(self) -> None:
        """Forget what is half read: the stream begins anew. Counts go on."""
        self._buffer = b""
        self._arrivals: list[tuple[int, float]] = []  # (end in the buffer, when) of each chunk
        self._clock = SampleClock()
        self._turn = _Turn(0, whole=False)
        self._previous: PacketHeader | None = None
        self._damaged = False  # something was dropped since the last good packet

    def take_replies(self) -> list[Reply]:
        """Replies to commands that came since the last call, oldest first."""
        replies, self._replies = self._replies, []
        return replies

    def feed(self, data: bytes, arrival: float) -> list[Scan]:
        """Take the next bytes, read at host time `arrival` (s); return the turns they complete."""
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
        if length:
            self.counts["bytes_skipped"] += length
            self._damaged = True

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
        sent = 0.0
        for chunk_end, arrival in self._arrivals:
            if chunk_end >= end:
                sent = arrival - length * _SECONDS_PER_BYTE
                break
        self._accept(header, self._buffer[start + HEADER_LENGTH : end], sent, scans)
        return length

    def _accept(self, header: PacketHeader, content: bytes, sent: float, scans: list[Scan]) -> None:
        """Add a sound packet, which was `sent` at the latest, to its turn."""
        self.counts["packets"] += 1
        self.counts["points"] += header.size
        lost = self._lost_before(header) if self._damaged else None
        if not self._clock.advance(header.size, sent, lost):
            self.counts["clock_restarts"] += 1
            self._turn = _Turn(header.first, whole=False)
        turn = self._turn
        if not turn.total:
            turn.first = header.first
        phase = (header.first - turn.first) % UNITS_PER_TURN
        if header.starts_turn or phase < turn.phase - UNITS_PER_TURN // 4:
            # A start that follows closely on a turn begun by its angle is the start of that turn.
            if not (turn.by_angle and phase < UNITS_PER_TURN // 4):
                turn = self._next_turn(header, scans)
                phase = 0
            if header.starts_turn:
                self.turn_rate_hz = header.turn_rate / 10.0
        turn.torn |= bool(lost)
        turn.phase = phase
        turn.add(header, content, self._clock.count - header.size)
        self._previous = header

    def _lost_before(self, header: PacketHeader) -> int:
        """How many samples are missing between the last good packet and this one, by the angles."""
        self._damaged = False
        before = self._previous
        if before is None:
            return 0
        known = before if before.size > 1 else header
        step = known.span / max(1, known.size - 1)
        gap = (header.first - before.first - before.span) % UNITS_PER_TURN
        lost = max(0, round(gap / step) - 1) if step > 0.0 else 0
        self.counts["points_lost"] += lost
        return lost

    def _next_turn(self, header: PacketHeader, scans: list[Scan]) -> _Turn:
        """End the turn under way before this packet."""
        turn = self._turn
        if turn.total and self._clock.offset is not None:
            self.counts["turns"] += 1
            self.counts["turns_torn"] += turn.torn
            scans.append(turn.to_scan(self._clock.offset))
        whole = header.starts_turn
        self._turn = _Turn(header.first, whole, by_angle=not whole)
        return self._turn
