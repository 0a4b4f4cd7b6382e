"""A YDLidar X4 or X4 Pro as its serial line shows it: commands in, timed bytes out, no hardware."""

import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.drivers.x4 import commands
from host.drivers.x4.commands import DeviceHealth, DeviceInfo, ScanBegins, encode_reply
from host.drivers.x4.packets import (
    BAUDRATE,
    BITS_PER_BYTE,
    MAX_SAMPLES,
    SAMPLE_RATE_HZ,
    UNIT_RAD,
    encode_packet,
)
from host.messages import FloatArray

Sense = Callable[[FloatArray, FloatArray], FloatArray]

_START_RAD = math.radians(346.6)
_START_SPREAD_RAD = math.radians(0.2)
_SPEED_SPREAD = 0.005  # relative, from revolution to revolution
_MAX_RANGE_MM = 16_383  # what a sample can hold; the X4 sees no further than 10 m
_SECONDS_PER_BYTE = BITS_PER_BYTE / BAUDRATE


@dataclass(frozen=True, slots=True)
class _PlannedPacket:
    """When and at which raw angle (rad, may exceed 2 pi) the samples of a packet are taken."""

    times: FloatArray
    angles: FloatArray
    starts_revolution: bool
    speed_hz: float

    def encode(self, ranges: FloatArray) -> bytes:
        millimetres = np.rint(ranges * 1000.0)
        samples = np.where(millimetres <= _MAX_RANGE_MM, 4 * millimetres, 0).astype(np.int64)
        first, last = (round(float(angle) / UNIT_RAD) for angle in self.angles[[0, -1]])
        return encode_packet(samples, first, last, self.starts_revolution, self.speed_hz)


class X4Emulator:
    """The lidar's side of the line. Idle until asked, as the device is.

    sense(times (n,) s, raw_angles (n,) rad clockwise in [0, 2 pi)) -> ranges (n,) m, 0 where
    nothing comes back: what each sample measures. The raw angle is the device's own; the reader
    adds `x4_packets.angle_correction`.
    Times are those of the caller's clock. delay_s: how much later its bytes come than over a plain
    line, as through a hub. Switches, for tests and demonstrations: motor_powered; spin_up_s, until
    its motor has its speed and samples come; laser_fires (False: packets of zeros); answers
    (False: dead); corrupt_share (packets with one flipped bit); lost_share (packets missing
    whole); gaps (length, period) s: for so long every so often all packets are missing; health.
    """

    def __init__(
        self, sense: Sense, speed_hz: float = 7.0, seed: int = 0, delay_s: float = 0.0
    ) -> None:
        self.motor_powered = True
        self.answers = True
        self.laser_fires = True
        self.spin_up_s = 0.0
        self.corrupt_share = 0.0
        self.lost_share = 0.0
        self.gaps: tuple[float, float] | None = None
        self.health = DeviceHealth(status=0, error=0)
        self.info = DeviceInfo(model=6, firmware="1.5", hardware=1, serial=f"{seed:016d}")
        self._sense = sense
        self._speed_hz = speed_hz
        self._delay_s = delay_s
        self._random = np.random.default_rng(seed)
        self._scanning = False
        self._half_command = b""
        self._line: deque[tuple[float, bytes]] = deque()
        self._line_free = -math.inf
        self._measuring = False
        self._motor_started: float | None = None
        self._planned: deque[_PlannedPacket] = deque()
        self._planned_to = 0.0  # time and raw angle of the first sample not planned yet
        self._angle = float(self._random.uniform(0.0, 2.0 * math.pi))

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes of the host at time `now`; unknown commands are ignored."""
        stream = self._half_command + data
        position = stream.find(b"\xa5")
        while 0 <= position < len(stream) - 1:
            self._obey(stream[position : position + 2], now)
            position = stream.find(b"\xa5", position + 2)
        self._half_command = stream[position:] if position >= 0 else b""

    def _obey(self, command: bytes, now: float) -> None:
        if not self.answers:
            return
        self._measure(now)
        if command in (commands.SCAN, commands.FORCE_SCAN):
            self._send(encode_reply(ScanBegins()), now)
            self._scanning = True
        elif command in (
            commands.STOP,
            commands.FORCE_STOP,
            commands.RESET,
            commands.RESET_OF_MANUAL,
        ):
            self._scanning = False
            self._line.clear()
            self._line_free = now
        elif command == commands.INFO:
            self._send(encode_reply(self.info), now)
        elif command in (commands.HEALTH, commands.HEALTH_OF_SDK):
            self._send(encode_reply(self.health), now)

    def transmit(self, now: float) -> list[tuple[float, bytes]]:
        """Packets and replies whose last byte has come by `now`, each with that time, in order."""
        self._measure(now)
        sent: list[tuple[float, bytes]] = []
        while self._line and self._line[0][0] + self._delay_s <= now:
            left, data = self._line.popleft()
            sent.append((left + self._delay_s, data))
        return sent

    def _send(self, data: bytes, ready: float) -> None:
        """Queue bytes that are ready at `ready` on the line, which carries one bit at a time."""
        self._line_free = max(self._line_free, ready) + len(data) * _SECONDS_PER_BYTE
        self._line.append((self._line_free, data))

    def _measure(self, now: float) -> None:
        """Take the samples of the packets that are complete by `now`, and send those."""
        if not (self._scanning and self.motor_powered and self.answers):
            self._measuring = False
            self._motor_started = None
            self._planned.clear()
            return
        if self._motor_started is None:
            self._motor_started = now
        if now < self._motor_started + self.spin_up_s:
            return
        if not self._measuring:
            self._measuring = True
            self._planned_to = now
            self._plan_revolution(from_start=False)
        due: list[_PlannedPacket] = []
        while self._planned[0].times[-1] <= now:
            due.append(self._planned.popleft())
            if not self._planned:
                self._plan_revolution(from_start=True)
        if not due:
            return
        times = np.concatenate([packet.times for packet in due])
        angles = np.concatenate([packet.angles for packet in due])
        ranges = self._sense(times, angles % (2.0 * math.pi)) * self.laser_fires
        ends = np.cumsum([len(packet.times) for packet in due])
        for packet, of_packet in zip(due, np.split(ranges, ends[:-1]), strict=True):
            complete = float(packet.times[-1])
            if not self._is_lost(complete):
                self._send(self._damage(packet.encode(of_packet)), complete)

    def _plan_revolution(self, from_start: bool) -> None:
        """Lay out the next revolution (or its rest, when the lidar starts in the middle of one)."""
        rate_hz = self._speed_hz * (1.0 + _SPEED_SPREAD * self._random.normal())
        step = 2.0 * math.pi * rate_hz / SAMPLE_RATE_HZ
        end = _START_RAD + _START_SPREAD_RAD * self._random.uniform(-1.0, 1.0)
        half = math.pi if from_start else 0.0  # a whole one ends where it began, more or less
        ahead = (end - self._angle + half) % (2.0 * math.pi) + half
        size = max(1, math.ceil(ahead / step))
        times = self._planned_to + np.arange(size) / SAMPLE_RATE_HZ
        angles = self._angle + step * np.arange(size, dtype=np.float64)
        cuts = [0, *range(1 if from_start else MAX_SAMPLES, size, MAX_SAMPLES), size]
        for begin, end_of_packet in itertools.pairwise(cuts):
            part = slice(begin, end_of_packet)
            starts_revolution = from_start and begin == 0
            self._planned.append(
                _PlannedPacket(times[part], angles[part], starts_revolution, rate_hz)
            )
        self._planned_to += size / SAMPLE_RATE_HZ
        self._angle = (self._angle + step * size) % (2.0 * math.pi)

    def _is_lost(self, time: float) -> bool:
        """Is a packet that is complete at `time` (s) to be missing whole?"""
        if self.gaps is not None and time % self.gaps[1] < self.gaps[0]:
            return True
        return self.lost_share > 0.0 and self._random.random() < self.lost_share

    def _damage(self, packet: bytes) -> bytes:
        """Flip one bit in `corrupt_share` of the packets."""
        if self.corrupt_share <= 0.0 or self._random.random() >= self.corrupt_share:
            return packet
        bit = int(self._random.integers(8 * len(packet)))
        return (int.from_bytes(packet, "little") ^ 1 << bit).to_bytes(len(packet), "little")


class X4ProEmulator(X4Emulator):
    """The X4 Pro: the same packets, but one-way. It sends as soon as it has power."""

    def receive(self, data: bytes, now: float) -> None:
        """Ignore what the host sends: there is no line that leads to it."""

    def transmit(self, now: float) -> list[tuple[float, bytes]]:
        """Packets whose last byte has come by `now`, each with that time, in order."""
        self._scanning = True
        return super().transmit(now)
