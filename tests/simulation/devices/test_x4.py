"""The emulated X4: idle until asked, and on the line what the manual says a real one sends."""

import itertools
import math

import numpy as np
import pytest

from host.drivers.x4 import commands
from host.drivers.x4.commands import DeviceHealth, DeviceInfo, ScanBegins
from host.drivers.x4.packets import angle_correction
from host.drivers.x4.protocol import ScanDecoder
from host.messages import FloatArray, Scan
from host.simulation.devices.x4 import X4Emulator, X4ProEmulator


class Room:
    """A made-up range for each raw angle, and what was asked."""

    def __init__(self) -> None:
        self.times: list[FloatArray] = []
        self.angles: list[FloatArray] = []

    def sense(self, times: FloatArray, angles: FloatArray) -> FloatArray:
        self.times.append(times)
        self.angles.append(angles)
        return self.ranges(angles)

    @staticmethod
    def ranges(angles: FloatArray) -> FloatArray:
        return np.where(angles < 4.0, np.rint(1000 * (0.5 + angles)) / 1000, 0.0)


def listen(lidar: X4Emulator, begin: float, end: float) -> list[tuple[float, bytes]]:
    return [
        sent for now in np.arange(begin, end + 1e-9, 0.005) for sent in lidar.transmit(float(now))
    ]


def replies(lidar: X4Emulator, now: float) -> list[object]:
    decoder = ScanDecoder()
    for when, data in listen(lidar, now, now + 0.05):
        decoder.feed(data, when)
    return list(decoder.take_replies())


def test_scans_show_what_was_sensed_where_and_when() -> None:
    room = Room()
    lidar = X4Emulator(room.sense, speed_hz=7.0, seed=4)
    lidar.receive(commands.SCAN, 50.0)
    decoder, scans = ScanDecoder(), list[Scan]()
    for when, data in listen(lidar, 50.0, 55.0):
        scans += decoder.feed(data, when)
    times, raw = np.concatenate(room.times), np.concatenate(room.angles)
    got = len(np.concatenate([scan.times for scan in scans]))
    ranges = Room.ranges(raw)[:got]
    expected = -(raw[:got] + angle_correction(ranges))
    error = np.concatenate([scan.angles for scan in scans]) - expected
    assert np.abs((error + math.pi) % (2 * math.pi) - math.pi).max() < math.radians(1 / 64)
    assert np.concatenate([scan.ranges for scan in scans]) == pytest.approx(ranges, abs=1e-9)
    assert np.concatenate([scan.times for scan in scans]) == pytest.approx(times[:got], abs=0.002)
    assert 33 <= len(scans) <= 36
    assert decoder.speed_hz == pytest.approx(7.0, abs=0.15)
    assert decoder.counts["bytes_skipped"] == 0
    assert raw.min() >= 0.0
    assert raw.max() < 2.0 * math.pi


def test_the_line_carries_no_more_than_it_can() -> None:
    lidar = X4Emulator(Room().sense)
    lidar.receive(commands.SCAN, 0.0)
    sent = listen(lidar, 0.0, 3.0)
    ends = np.array([when for when, _ in sent])
    lengths = np.array([len(data) for _, data in sent])
    assert (np.diff(ends) >= lengths[1:] * 10 / 128_000 - 1e-9).all()
    assert lengths.sum() / 3.0 == pytest.approx(11_300, rel=0.02)


def test_packets_are_1_40_40_and_a_short_last_one() -> None:
    lidar = X4Emulator(Room().sense, seed=2)
    lidar.receive(commands.SCAN, 0.0)
    packets = [data for _, data in listen(lidar, 0.0, 2.0)][1:]
    starts = [k for k, data in enumerate(packets) if data[2] & 1]
    assert len(starts) >= 12
    for begin, end in itertools.pairwise(starts):
        sizes = [data[3] for data in packets[begin:end]]
        assert sizes[0] == 1
        assert set(sizes[1:-1]) == {40}
        assert 1 <= sizes[-1] <= 40
        first = int.from_bytes(packets[begin][4:6], "little") / 128.0
        assert first == pytest.approx(346.6, abs=1.0)


def test_questions_are_answered_and_silence_kept_otherwise() -> None:
    lidar = X4Emulator(Room().sense)
    assert listen(lidar, 0.0, 1.0) == []
    lidar.receive(b"\x00\xa5", 1.0)  # a command may come in pieces, after garbage
    lidar.receive(b"\x90", 1.0)
    lidar.receive(commands.HEALTH + commands.HEALTH_OF_SDK + b"\xa5\x33", 1.0)
    info, *health = replies(lidar, 1.0)
    assert isinstance(info, DeviceInfo)
    assert info.model == 6
    assert health == [DeviceHealth(0, 0)] * 2
    lidar.answers = False
    lidar.receive(commands.INFO, 2.0)
    assert replies(lidar, 2.0) == []


@pytest.mark.parametrize(
    "command", [commands.STOP, commands.FORCE_STOP, commands.RESET, commands.RESET_OF_MANUAL]
)
def test_it_stops_when_told(command: bytes) -> None:
    lidar = X4Emulator(Room().sense)
    lidar.receive(commands.FORCE_SCAN, 0.0)
    assert len(listen(lidar, 0.0, 0.5)) > 50
    lidar.receive(command, 0.5)
    assert listen(lidar, 0.5, 1.0) == []


def test_without_motor_power_it_answers_but_sends_no_samples() -> None:
    lidar = X4Emulator(Room().sense)
    lidar.motor_powered = False
    lidar.receive(commands.SCAN, 0.0)
    assert replies(lidar, 0.0) == [ScanBegins()]
    assert listen(lidar, 0.1, 1.0) == []
    lidar.motor_powered = True
    assert len(listen(lidar, 1.0, 1.5)) > 50


def test_the_asked_share_of_packets_is_damaged() -> None:
    lidar = X4Emulator(Room().sense, seed=3)
    lidar.corrupt_share = 0.2
    lidar.receive(commands.SCAN, 0.0)
    decoder = ScanDecoder()
    sent = listen(lidar, 0.0, 5.0)
    for when, data in sent:
        decoder.feed(data, when)
    assert 1.0 - decoder.counts["packets"] / len(sent) == pytest.approx(0.2, abs=0.05)


def test_the_same_seed_gives_the_same_bytes() -> None:
    streams = []
    for _ in range(2):
        lidar = X4Emulator(Room().sense, seed=9)
        lidar.receive(commands.SCAN, 0.0)
        streams.append(listen(lidar, 0.0, 1.0))
    assert streams[0] == streams[1]


def test_packets_are_missing_whole_where_asked() -> None:
    for switch, share in (("lost_share", 0.1), ("gaps", 0.2)):
        lidar = X4Emulator(Room().sense, seed=5)
        setattr(lidar, switch, 0.1 if switch == "lost_share" else (0.4, 2.0))
        lidar.receive(commands.SCAN, 0.0)
        decoder = ScanDecoder()
        for when, data in listen(lidar, 0.0, 10.0):
            decoder.feed(data, when)
        assert decoder.counts["points"] == pytest.approx((1.0 - share) * 50_000, rel=0.04)
        assert decoder.counts["bytes_skipped"] == 0


def test_a_dead_laser_sends_packets_of_zeros_and_a_slow_motor_none_yet() -> None:
    lidar = X4Emulator(Room().sense)
    lidar.laser_fires = False
    lidar.spin_up_s = 3.6
    lidar.receive(commands.SCAN, 0.0)
    assert replies(lidar, 0.0) == [ScanBegins()]
    assert listen(lidar, 0.1, 3.5) == []
    decoder, scans = ScanDecoder(), list[Scan]()
    for when, data in listen(lidar, 3.6, 4.6):
        scans += decoder.feed(data, when)
    assert len(scans) >= 6
    assert not any(scan.ranges.any() for scan in scans)


def test_the_x4_pro_sends_unasked_and_answers_nothing() -> None:
    lidar = X4ProEmulator(Room().sense)
    for command in (commands.STOP, commands.INFO, commands.HEALTH):
        lidar.receive(command, 0.0)
    decoder = ScanDecoder()
    for when, data in listen(lidar, 0.0, 1.0):
        decoder.feed(data, when)
    assert decoder.counts["packets"] > 100
    assert decoder.take_replies() == []
