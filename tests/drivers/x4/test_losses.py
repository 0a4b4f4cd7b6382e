"""The X4's decoder where packets are missing whole, and where devices differ from the manual."""

from collections.abc import Callable

import numpy as np
import pytest

from host.drivers.x4 import commands
from host.drivers.x4.formats import unknown_format
from host.drivers.x4.packets import UNITS_PER_REVOLUTION, encode_packet
from host.drivers.x4.protocol import ScanDecoder
from host.drivers.x4.revolution import REVOLUTION_SAMPLES
from host.messages import FloatArray, Scan
from host.simulation.devices.x4 import X4Emulator

Change = Callable[[bytes, int], bytes]


def numbers(times: FloatArray, angles: FloatArray) -> FloatArray:
    """Ranges from which the time of a sample can be read: it repeats after 3 s."""
    return 0.1 + (np.rint(times * 5000.0) % 15_000) / 1000.0


def time_errors(scan: Scan) -> FloatArray:
    true = np.rint((scan.ranges - 0.1) * 1000.0) / 5000.0
    return (scan.times - true + 1.5) % 3.0 - 1.5


def scans_of(
    lidar: X4Emulator, seconds: float, jitter_s: float, seed: int, change: Change | None = None
) -> tuple[ScanDecoder, list[Scan]]:
    """Decode what `lidar` sends, read at irregular times. change: of a packet and its number."""
    random = np.random.default_rng(seed)
    lidar.receive(commands.SCAN, 0.0)
    decoder, scans, now, starts = ScanDecoder(), list[Scan](), 0.0, 0
    while now < seconds:
        now += random.uniform(0.002, jitter_s)
        data = []
        for _, packet in lidar.transmit(now):
            starts += packet[2] & 1
            data.append(change(packet, starts) if change and packet[2] & 1 else packet)
        scans += decoder.feed(b"".join(data), now)
    return decoder, scans


@pytest.mark.parametrize("gap_s", [0.06, 0.1, 1 / 7, 0.2, 0.3, 0.4])
@pytest.mark.parametrize("speed_hz", [6.2, 7.0, 11.9])
@pytest.mark.parametrize("jitter_s", [0.01, 0.03])
def test_sample_times_stay_right_where_packets_are_missing(
    gap_s: float, speed_hz: float, jitter_s: float
) -> None:
    lidar = X4Emulator(numbers, speed_hz, seed=4)
    lidar.gaps = (gap_s, 2.0)
    decoder, scans = scans_of(lidar, 9.0, jitter_s, seed=1)
    # The first few arrivals may all be late.
    errors = np.abs(np.concatenate([time_errors(scan) for scan in scans[1:]]))
    assert errors.max() < 0.02
    assert len(errors) > 9.0 * 5000 - 5 * 5000 * gap_s - 2500
    # A gap of a whole revolution does not show in the angles: it counts as a pause.
    lost, restarts = decoder.counts["points_lost"], decoder.counts["clock_restarts"]
    assert lost + restarts * 5000 * gap_s == pytest.approx(5 * 5000 * gap_s, rel=0.25)


@pytest.mark.parametrize("lost_share", [0.02, 0.1])
def test_single_missing_packets_are_counted(lost_share: float) -> None:
    lidar = X4Emulator(numbers, 7.0, seed=2)
    lidar.lost_share = lost_share
    decoder, scans = scans_of(lidar, 10.0, 0.02, seed=1)
    assert np.abs(np.concatenate([time_errors(scan) for scan in scans])).max() < 0.02
    assert decoder.counts["bytes_skipped"] == 0
    assert decoder.counts["points_lost"] == pytest.approx(50_000 * lost_share, rel=0.3)
    assert decoder.counts["points_lost"] + decoder.counts["points"] == pytest.approx(50_000, abs=99)


@pytest.mark.parametrize("speed_hz", [6.0, 7.0, 12.0])
@pytest.mark.parametrize("damaged", [False, True])
@pytest.mark.parametrize("lost", [{5, 6}, set(range(5, 14)), set(range(999)), {3, 5, 7}])
def test_a_revolution_ends_whatever_starts_are_lost(
    lost: set[int], damaged: bool, speed_hz: float
) -> None:
    def change(packet: bytes, start: int) -> bytes:
        if start not in lost:
            return packet
        return packet[:-1] + bytes([packet[-1] ^ 8]) if damaged else b""

    _, scans = scans_of(X4Emulator(numbers, speed_hz, seed=1), 4.0, 0.01, 1, change)
    assert max(len(scan.ranges) for scan in scans) <= 5000.0 / speed_hz * 1.02 + 2
    assert abs(len(scans) - 4.0 * speed_hz) <= 2


def test_a_revolution_ends_though_the_angle_stands_still() -> None:
    stuck = encode_packet(np.full(40, 4000), 1000, 1000 + 39 * 32)
    decoder, scans = ScanDecoder(), list[Scan]()
    for k in range(300):
        scans += decoder.feed(stuck, k * 0.008)
    assert len(scans) > 5
    assert max(len(scan.ranges) for scan in scans) <= REVOLUTION_SAMPLES
    assert REVOLUTION_SAMPLES < 900


def revolution(start_size: int, bits: int, n: int = 720, first: int = 22_182) -> list[bytes]:
    """Packets whose first one has `start_size` samples, with CT bits 7:1 in the others."""
    angles = first + np.rint(np.arange(n) * UNITS_PER_REVOLUTION / n).astype(int)
    packets = []
    begin = 0
    while begin < n:
        end = min(n, begin + (start_size if begin == 0 else 40))
        packet = bytearray(
            encode_packet(np.arange(begin, end) + 500, angles[begin], angles[end - 1], begin == 0)
        )
        if begin:
            packet[2] ^= bits << 1
            packet[8] ^= bits << 1  # the checksum covers CT
        packets.append(bytes(packet))
        begin = end
    return packets


@pytest.mark.parametrize("start_size", [1, 2, 17, 40])
@pytest.mark.parametrize("bits", [0, 1, 0x2A, 0x7F])
def test_starts_with_many_samples_and_bits_in_plain_packets_are_read(
    start_size: int, bits: int
) -> None:
    packets = revolution(start_size, bits)
    decoder = ScanDecoder()
    scans = decoder.feed(b"".join(packets * 4), 0.0)
    assert [len(scan.ranges) for scan in scans] == [720] * 3
    assert decoder.counts["bytes_skipped"] == decoder.counts["revolutions_torn"] == 0
    assert decoder.counts["points_lost"] == 0
    assert unknown_format(b"".join(packets)) is None


def with_intensity(size: int) -> bytes:
    """A packet of the format with 3 bytes a sample, which the X4 does not send."""
    random = np.random.default_rng(size)
    content = random.integers(0, 256, 3 * size, dtype=np.uint8).tobytes()
    head = bytes([0xAA, 0x55, 0, size, 0x01, 0x20, 0x81, 0x30])
    words = b"".join(
        bytes([content[k], 0]) + content[k + 1 : k + 3] for k in range(0, len(content), 3)
    )
    return checked(head, words)[:10] + content


def checked(head: bytes, content: bytes) -> bytes:
    check = 0
    for k in range(0, len(head + content), 2):
        check ^= int.from_bytes((head + content)[k : k + 2], "little")
    return head + check.to_bytes(2, "little") + content


def test_what_is_no_format_of_the_x4_is_named() -> None:
    big = checked(bytes([0xAA, 0x55, 0, 80, 0x01, 0x20, 0x81, 0x40]), bytes(range(160)))
    odd = checked(bytes([0xAA, 0x55, 0, 10, 0x00, 0x20, 0x80, 0x30]), bytes(range(20)))
    other = bytes([0x54, 0x2C]) + bytes(range(45))
    assert "intensity" in (unknown_format(with_intensity(40) * 10) or "")
    assert "80 samples" in (unknown_format(big * 10) or "")
    assert "angles" in (unknown_format(odd * 10) or "")
    assert "AA 55" in (unknown_format(other * 40) or "")


@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
def test_damage_is_not_taken_for_a_format(share: float) -> None:
    lidar = X4Emulator(numbers, seed=3)
    lidar.corrupt_share = share
    lidar.receive(commands.SCAN, 0.0)
    stream = b"".join(packet for _, packet in lidar.transmit(1.0))
    for begin in range(0, len(stream) - 4096, 1000):
        assert unknown_format(stream[begin : begin + 4096]) is None
