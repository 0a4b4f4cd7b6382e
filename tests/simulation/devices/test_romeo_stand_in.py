"""The board that is not there behaves as protocol.toml says."""

import random
from dataclasses import replace

import pytest

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import (
    PROTOCOL_HASH,
    DisplacementFrame,
    DisplacementStatus,
    Frame,
    HelloFrame,
    IdentityFrame,
    ReadSettingsFrame,
    SettingsFrame,
    VelocityFrame,
)
from host.simulation.devices.romeo_stand_in import DEFAULTS, RomeoStandIn


def driving(now: float) -> tuple[int, int]:
    return int(1000 * now), int(-2000 * now)


def sent(board: RomeoStandIn, now: float) -> list[tuple[float, Frame]]:
    decoder = BoardDecoder()
    frames = [(at, frame) for at, chunk in board.transmit(now) for frame in decoder.feed(chunk)]
    assert decoder.counts.refused == 0
    return frames


def reports(board: RomeoStandIn, now: float) -> list[tuple[float, DisplacementFrame]]:
    return [(at, f) for at, f in sent(board, now) if isinstance(f, DisplacementFrame)]


def test_it_reports_50_times_a_second_the_ticks_of_that_instant() -> None:
    board = RomeoStandIn(driving, start=2.0)
    got = reports(board, 3.999)
    assert len(got) == 100
    for k, (at, frame) in enumerate(got):
        assert at == pytest.approx(2.0 + k * 0.02)
        assert frame.sequence == k
        assert frame.left_ticks == int(1000 * at) - 2000
        assert frame.right_ticks == int(-2000 * at) + 4000
        assert abs(frame.board_time_us - k * 20_000) <= 1
    assert reports(board, 3.999) == []


def test_how_often_it_is_asked_changes_nothing() -> None:
    rare, often = RomeoStandIn(driving), RomeoStandIn(driving)
    pieces = [chunk for k in range(1, 401) for chunk in often.transmit(k * 0.005)]
    assert pieces == rare.transmit(2.0)


def test_it_answers_each_hello_and_is_fresh_until_the_first() -> None:
    board = RomeoStandIn(driving)
    (_, first), *_ = reports(board, 0.0)
    assert first.status & DisplacementStatus.FRESH
    board.receive(encode(HelloFrame()) + encode(HelloFrame()), 0.03)
    answers = [(at, f) for at, f in sent(board, 0.2) if isinstance(f, IdentityFrame)]
    assert [(at, f.protocol_hash) for at, f in answers] == [(0.03, PROTOCOL_HASH)] * 2
    (_, later), *_ = reports(board, 0.3)
    assert not later.status & DisplacementStatus.FRESH


def test_wheels_stop_150_ms_after_the_last_command() -> None:
    board = RomeoStandIn(driving)
    assert board.wheel_speeds(0.0) == (0, 0)
    assert not reports(board, 0.0)[-1][1].status & DisplacementStatus.COMMAND_TIMED_OUT
    board.receive(encode(VelocityFrame(300, -400)), 1.0)
    assert board.wheel_speeds(1.0) == (300, -400)
    assert board.wheel_speeds(1.149) == (300, -400)
    assert board.wheel_speeds(1.151) == (0, 0)
    assert reports(board, 1.2)[-1][1].status & DisplacementStatus.COMMAND_TIMED_OUT
    board.receive(encode(VelocityFrame(1, 2)), 1.4)
    assert board.wheel_speeds(1.5) == (1, 2)
    assert not reports(board, 1.5)[-1][1].status & DisplacementStatus.COMMAND_TIMED_OUT


def test_settings_are_brought_into_bounds_and_answered() -> None:
    board = RomeoStandIn(driving)
    board.settings_defaulted = True
    assert reports(board, 0.0)[-1][1].status & DisplacementStatus.SETTINGS_DEFAULTED
    board.receive(encode(replace(DEFAULTS, report_rate_hz=255, reversed=0xFF)), 0.01)
    board.receive(encode(ReadSettingsFrame()), 0.01)
    got = sent(board, 1.005)
    answers = [f for _, f in got if isinstance(f, SettingsFrame)]
    assert answers == [replace(DEFAULTS, report_rate_hz=100, reversed=0x0F)] * 2
    assert len(got) == 2 + 99  # from 0.02 s on, a hundred a second
    assert not reports(board, 1.1)[-1][1].status & DisplacementStatus.SETTINGS_DEFAULTED
    board.receive(encode(replace(DEFAULTS, report_rate_hz=0)), 1.2)
    assert board.settings.report_rate_hz == 10


def test_its_clock_drifts_and_rolls_over() -> None:
    board = RomeoStandIn(driving, start=5.0, first_count_us=2**32 - 1_000_000, drift=0.005)
    got = reports(board, 7.0)
    assert got[0][1].board_time_us == 2**32 - 1_000_000
    assert got[-1][1].board_time_us == pytest.approx(2.0 * 1.005e6 - 1e6, abs=2)


def test_a_reset_starts_clock_counters_and_greeting_anew_and_stops_the_wheels() -> None:
    board = RomeoStandIn(driving)
    board.receive(encode(HelloFrame()) + encode(VelocityFrame(5, 5)), 9.9)
    reports(board, 10.0)
    board.reset(10.01)
    assert board.wheel_speeds(10.01) == (0, 0)
    (at, first), *_ = reports(board, 10.02)
    assert at == 10.01
    assert (first.sequence, first.board_time_us, first.left_ticks, first.right_ticks) == (0,) * 4
    assert first.status & DisplacementStatus.FRESH


def test_ticks_are_those_of_a_32_bit_register() -> None:
    board = RomeoStandIn(lambda now: (2**31 if now else 0, -(2**31) - 1 if now else 0))
    frame = reports(board, 0.02)[-1][1]
    assert (frame.left_ticks, frame.right_ticks) == (-(2**31), 2**31 - 1)


def test_garbage_is_counted_and_moves_nothing() -> None:
    rng = random.Random(5)
    board = RomeoStandIn(driving)
    good = encode(VelocityFrame(700, 700))
    for _ in range(2000):
        broken = bytearray(good)
        broken[rng.randrange(len(good) - 1)] ^= 1 << rng.randrange(8)
        board.receive(bytes(broken), 0.0)
    assert board.wheel_speeds(0.0) == (0, 0)
    assert reports(board, 0.0)[-1][1].bad_frames >= 2000
    board.receive(rng.randbytes(200_000), 0.0)
    board.receive(b"\0" + encode(HelloFrame()), 0.01)
    assert any(isinstance(frame, IdentityFrame) for _, frame in sent(board, 0.02))


def test_a_silent_board_sends_nothing_and_its_counters_go_on() -> None:
    board = RomeoStandIn(driving)
    board.silent = True
    assert board.transmit(1.0) == []
    board.silent = False
    assert reports(board, 1.025)[-1][1].sequence == 51
