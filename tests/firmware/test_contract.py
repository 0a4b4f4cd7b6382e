"""What any board must do at its port: the firmware's machine code and its stand-in alike."""

import itertools
import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import pytest

from host.config import RobotConfig
from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import (
    BOARD_ROMEO_V2,
    COMMAND_TIMEOUT_MS,
    FIRMWARE_VERSION,
    PROTOCOL_HASH,
    DisplacementFrame,
    DisplacementStatus,
    Frame,
    HelloFrame,
    IdentityFrame,
    ReadSettingsFrame,
    SettingsFrame,
    SettingsReversed,
    VelocityFrame,
)
from host.drivers.romeo.session import BoardSession
from host.simulation.devices.romeo_stand_in import DEFAULTS
from tests.firmware.boards import (
    BoardUnderTest,
    Received,
    mutated,
    on_the_line,
    refused_by_board,
)

SEED = 8
Make = Callable[[int], BoardUnderTest]
F = TypeVar("F", bound=Frame)
# The wheels of these boards do not follow their motors, which is what some tests are not about.
FREE = replace(DEFAULTS, runaway=0)


@pytest.fixture
def board(make_board: Make) -> BoardUnderTest:
    return make_board(0)


def of(kind: type[F], received: Received) -> list[F]:
    return [frame for _, frame in received if isinstance(frame, kind)]


def status(board: BoardUnderTest) -> DisplacementStatus:
    return DisplacementStatus(of(DisplacementFrame, board.run(0.05))[-1].status)


def test_it_introduces_itself_as_often_as_asked(board: BoardUnderTest) -> None:
    for _ in range(3):
        board.send(encode(HelloFrame()))
        (identity,) = of(IdentityFrame, board.run(0.1))
        assert identity.protocol_hash == PROTOCOL_HASH
        assert identity.board == BOARD_ROMEO_V2
        version = identity.version_major, identity.version_minor, identity.version_patch
        assert version == FIRMWARE_VERSION
        assert identity.edges_per_period == board.edges_per_period
    assert board.decoder.counts.refused == 0


def test_it_is_fresh_until_the_first_hello_and_again_after_a_restart(
    board: BoardUnderTest,
) -> None:
    assert status(board) & DisplacementStatus.FRESH
    board.send(encode(HelloFrame()))
    board.run(0.05)
    assert not status(board) & DisplacementStatus.FRESH
    board.restart()
    assert status(board) & DisplacementStatus.FRESH


def test_it_reports_its_ticks_50_times_a_second(board: BoardUnderTest) -> None:
    before = of(DisplacementFrame, board.run(0.1))[-1]
    reports = of(DisplacementFrame, board.turn(2000, -1000, 2.0))
    assert len(reports) == pytest.approx(100, abs=1)
    for earlier, later in itertools.pairwise(reports):
        assert later.sequence == earlier.sequence + 1
        interval = (later.board_time_us - earlier.board_time_us) * 1e-6
        assert interval == pytest.approx(0.02, abs=0.0005)
        # Counted at one instant, that of board_time_us: at most one tick is about to come.
        assert later.left_ticks - earlier.left_ticks == pytest.approx(1000 * interval, abs=1.01)
        assert later.right_ticks - earlier.right_ticks == pytest.approx(-500 * interval, abs=1.01)
    after = of(DisplacementFrame, board.run(0.1))[-1]
    assert (after.left_ticks - before.left_ticks, after.right_ticks - before.right_ticks) == (
        2000,
        -1000,
    )
    assert (after.dropped_frames, after.bad_frames) == (0, 0)


def test_counter_clockwise_is_positive(board: BoardUnderTest) -> None:
    session = BoardSession(RobotConfig())
    session.connect(board.now)
    heading = 0.0
    for _ in range(40):
        board.send(session.transmit(board.now, None))
        received = board.turn(-10, 10, 0.02)
        for step in session.receive(b"".join(encode(frame) for _, frame in received), board.now):
            heading += step.dpsi
            assert abs(step.dx) < 1e-4
    assert heading > 0.1


@pytest.mark.parametrize(("left", "right"), [(800, 800), (-800, 800), (0, -800)])
def test_a_command_drives_each_wheel_its_way_until_zero(
    board: BoardUnderTest, left: int, right: int
) -> None:
    board.send(encode(FREE))
    assert board.driving == (0, 0)
    senses = ((left > 0) - (left < 0), (right > 0) - (right < 0))
    for _ in range(10):
        board.send(encode(VelocityFrame(left, right)))
        board.run(0.1)
        assert board.driving == senses
    board.send(encode(VelocityFrame(0, 0)))
    board.run(0.4)
    assert board.driving == (0, 0)


def test_the_wheels_stop_300_ms_after_the_last_command(board: BoardUnderTest) -> None:
    board.send(encode(FREE))
    assert not status(board) & DisplacementStatus.COMMAND_TIMED_OUT
    for _ in range(5):
        board.send(encode(VelocityFrame(700, -700)))
        board.run(0.1)
        assert board.driving == (1, -1)
    # The last one was 0.1 s ago.
    board.run(COMMAND_TIMEOUT_MS / 1000 - 0.1 - 0.02)
    assert board.driving == (1, -1)
    board.run(0.04)
    assert board.driving == (0, 0)
    assert status(board) & DisplacementStatus.COMMAND_TIMED_OUT
    board.send(encode(VelocityFrame(700, 700)))
    assert not status(board) & DisplacementStatus.COMMAND_TIMED_OUT
    assert board.driving == (1, 1)


def test_a_wheel_that_does_not_follow_stops_both_until_a_stop_command(
    board: BoardUnderTest,
) -> None:
    go, stop = encode(VelocityFrame(1500, 1500)), encode(VelocityFrame(0, 0))

    def drive(left: int, right: int) -> DisplacementStatus:
        """For a second, with the wheels at so many ticks/s."""
        for _ in range(10):
            board.send(go)
            received = board.turn(left // 10, right // 10, 0.1)
        return DisplacementStatus(of(DisplacementFrame, received)[-1].status)

    both = DisplacementStatus.LEFT_RUNAWAY | DisplacementStatus.RIGHT_RUNAWAY
    for (left, right), expected in {
        (1500, 0): DisplacementStatus.RIGHT_RUNAWAY,
        (0, 1500): DisplacementStatus.LEFT_RUNAWAY,
        (-1500, 1500): DisplacementStatus.LEFT_RUNAWAY,
        (100, 1500): DisplacementStatus.LEFT_RUNAWAY,
        (0, 0): both,
    }.items():
        assert not drive(1500, 1500) & both
        assert drive(left, right) & both == expected
        assert board.driving == (0, 0)
        # Neither time nor commands end it.
        assert drive(1500, 1500) & both == expected
        assert board.driving == (0, 0)
        board.send(stop)
        assert not status(board) & both


def test_a_second_without_ticks_is_borne_where_that_is_set(board: BoardUnderTest) -> None:
    board.send(encode(replace(DEFAULTS, runaway=1500)))
    for k in range(20):
        board.send(encode(VelocityFrame(1500, 1500)))
        board.run(0.1)
        assert board.driving == ((1, 1) if k < 14 else board.driving), k
    assert board.driving == (0, 0)


def test_distance_and_heading_are_those_of_its_ticks_and_settings(board: BoardUnderTest) -> None:
    rng = random.Random(SEED)
    distance = heading = 0.0
    for _ in range(6):
        settings = replace(
            DEFAULTS,
            left_radius=rng.randrange(20_000_000, 60_000_000),
            right_radius=rng.randrange(20_000_000, 60_000_000),
            track=rng.randrange(50_000_000, 900_000_000),
            counts_per_turn=rng.randrange(500, 5000),
        )
        board.send(encode(settings))
        board.run(0.1)
        left, right = rng.randrange(-800, 800), rng.randrange(-800, 800)
        board.turn(left, right, 0.2)
        report = of(DisplacementFrame, board.run(0.1))[-1]
        turn = 2e-9 * math.pi / settings.counts_per_turn
        left_way, right_way = (
            left * turn * settings.left_radius,
            right * turn * settings.right_radius,
        )
        distance += (left_way + right_way) / 2.0
        heading += (right_way - left_way) / (1e-9 * settings.track)
        assert report.distance_um == pytest.approx(1e6 * distance, abs=1.0), f"seed {SEED}"
        assert report.heading_urad == pytest.approx(1e6 * heading, abs=1.0), f"seed {SEED}"


def test_settings_are_bounded_answered_used_and_kept(board: BoardUnderTest) -> None:
    board.send(encode(ReadSettingsFrame()))
    assert of(SettingsFrame, board.run(0.05)) == [DEFAULTS]
    wild = SettingsFrame(255, 0xFF, 0, 7, 9, 0, 0, 2**32 - 1, 5, track=0, counts_per_turn=0)
    board.send(encode(wild))
    reversed_all = sum(SettingsReversed)
    tamed = SettingsFrame(100, reversed_all, 100, 7, 9, 100, 0, 10**9, 5, 10**7, counts_per_turn=4)
    assert of(SettingsFrame, board.run(0.05)) == [tamed]
    assert len(of(DisplacementFrame, board.run(1.0))) == pytest.approx(100, abs=1)
    board.restart()
    board.send(encode(ReadSettingsFrame()))
    assert of(SettingsFrame, board.run(0.05)) == [tamed]
    board.send(encode(replace(DEFAULTS, report_rate_hz=1)))
    board.run(0.1)
    assert len(of(DisplacementFrame, board.run(1.0))) == pytest.approx(10, abs=1)


def test_lost_settings_give_defaults_and_it_says_so(board: BoardUnderTest) -> None:
    board.send(encode(replace(DEFAULTS, report_rate_hz=20, proportional=1)))
    board.run(0.3)
    board.lose_settings()
    assert status(board) & DisplacementStatus.SETTINGS_DEFAULTED
    board.send(encode(ReadSettingsFrame()))
    assert of(SettingsFrame, board.run(0.05)) == [DEFAULTS]
    board.send(encode(DEFAULTS))
    board.run(0.3)
    assert not status(board) & DisplacementStatus.SETTINGS_DEFAULTED
    board.restart()
    assert not status(board) & DisplacementStatus.SETTINGS_DEFAULTED


def test_broken_frames_are_counted_and_move_nothing(board: BoardUnderTest) -> None:
    rng = random.Random(SEED)
    refused = 0
    for _ in range(40):
        data = b"".join(mutated(rng) for _ in range(50))
        bad, frames = refused_by_board(data)
        if frames:  # a mutation that undid itself
            continue
        refused += bad
        board.send(data)
        received = board.run(0.1)
        assert board.driving == (0, 0), f"seed {SEED}"
    board.send(encode(HelloFrame()))
    received = board.run(0.1)
    assert len(of(IdentityFrame, received)) == 1
    assert of(DisplacementFrame, received)[-1].bad_frames == refused > 1500


def test_frames_of_wrong_length_or_direction_are_counted_as_bad(board: BoardUnderTest) -> None:
    # Whole frames with the right CRC that mean nothing to a board.
    short = encode(HelloFrame())
    identity = encode(IdentityFrame(1, 2, 3, 4, 5, 6))
    unknown, long = on_the_line(b"\x7e"), on_the_line(bytes([VelocityFrame.ID, 1, 1, 1, 1, 1]))
    board.send(short + identity + unknown + long + short)
    received = board.run(0.1)
    assert len(of(IdentityFrame, received)) == 2
    assert of(DisplacementFrame, board.run(0.1))[-1].bad_frames == 3
    assert board.driving == (0, 0)


def test_random_bytes_do_no_harm(board: BoardUnderTest) -> None:
    rng = random.Random(SEED)
    for _ in range(10):
        board.send(rng.randbytes(1000))
        board.run(0.1)
        assert board.driving == (0, 0), f"seed {SEED}"
    board.send(b"\0" + encode(HelloFrame()))
    assert len(of(IdentityFrame, board.run(0.2))) == 1


def test_its_clock_rolls_over_without_a_jump_in_host_time(make_board: Make) -> None:
    board = make_board(2**32 - 1_500_000)
    session = BoardSession(RobotConfig())
    session.connect(board.now)
    clocks, steps = [], []
    for _ in range(150):
        board.send(session.transmit(board.now, None))
        for at, frame in board.turn(10, 10, 0.02):
            steps += session.receive(encode(frame), at)
            if isinstance(frame, DisplacementFrame):
                clocks.append(frame.board_time_us)
    assert clocks[0] > 2**31 > clocks[-1], "the clock has not rolled over"
    assert session.counts()["restarts"] == 0
    assert len(steps) > 130
    for earlier, later in itertools.pairwise(steps):
        assert later.time - later.interval == pytest.approx(earlier.time, abs=1e-9)
        assert later.interval == pytest.approx(0.02, abs=0.002)
        assert later.ticks is not None
        assert later.ticks[0] == pytest.approx(10, abs=2)


def test_every_displacement_counts_what_it_says(board: BoardUnderTest) -> None:
    """Sequence and bytes over a long quiet time: nothing lost, nothing torn."""
    reports = of(DisplacementFrame, board.run(3.0))
    assert [r.sequence for r in reports] == list(
        range(reports[0].sequence, reports[0].sequence + len(reports))
    )
    assert board.decoder.counts.refused == 0
