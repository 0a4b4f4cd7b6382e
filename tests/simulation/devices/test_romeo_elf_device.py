"""The real firmware among simulated devices behaves as the stand-in does."""

from pathlib import Path

import pytest

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame, IdentityFrame
from host.simulation.devices.romeo_elf_device import RomeoElfDevice

START_S = 2.0


def driving(now: float) -> tuple[int, int]:
    return int(1000 * now), int(-2000 * now)


def reports(device: RomeoElfDevice, now: float) -> list[tuple[float, DisplacementFrame]]:
    decoder = BoardDecoder()
    frames = [(at, frame) for at, data in device.transmit(now) for frame in decoder.feed(data)]
    assert decoder.counts.refused == 0
    return [(at, frame) for at, frame in frames if isinstance(frame, DisplacementFrame)]


def test_it_reports_the_ticks_of_the_time(elf: Path) -> None:
    device = RomeoElfDevice(elf, driving, start=START_S)
    got = reports(device, START_S + 2.0)
    assert len(got) == pytest.approx(50 * 1.88, abs=2)
    for at, frame in got:
        measured = START_S + frame.board_time_us / 1e6
        assert 0.0 < at - measured < 0.0015
        left, right = driving(measured)
        assert frame.left_ticks == pytest.approx(left - 2000, abs=2)
        assert frame.right_ticks == pytest.approx(right + 4000, abs=3)


def test_how_often_it_is_asked_changes_nothing(elf: Path) -> None:
    rare, often = RomeoElfDevice(elf, driving), RomeoElfDevice(elf, driving)
    pieces = [packet for k in range(1, 301) for packet in often.transmit(k * 0.0017)]
    assert pieces == rare.transmit(300 * 0.0017)
    assert pieces


def test_it_hears_and_is_heard_again_after_a_reset(elf: Path) -> None:
    device = RomeoElfDevice(elf, driving)
    first_frames = []
    for now in (0.3, 1.0):
        device.receive(encode(HelloFrame()), now)
        decoder = BoardDecoder()
        frames = [f for _, data in device.transmit(now + 0.1) for f in decoder.feed(data)]
        assert sum(isinstance(frame, IdentityFrame) for frame in frames) == 1
        first_frames.append(next(f for f in frames if isinstance(f, DisplacementFrame)))
        device.reset(now + 0.2)
        device.transmit(now + 0.2)
    assert [frame.sequence for frame in first_frames] == [0, 0]
    assert device.board.steps[0] == pytest.approx(2 * 1200, abs=4)
