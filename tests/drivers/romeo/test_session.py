"""The conversation with the board in virtual time, with frames lost, torn, late and restarted."""

import itertools
import math
import random

import pytest

from host.config import Board, Motors, RobotConfig, Wheels
from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import (
    FIRMWARE_VERSION,
    PROTOCOL_HASH,
    DisplacementFrame,
    HelloFrame,
    IdentityFrame,
    SettingsFrame,
    SettingsReversed,
    VelocityFrame,
)
from host.drivers.romeo.session import BoardSession, settings_for
from host.messages import Displacement
from host.simulation.devices.romeo_stand_in import RomeoStandIn

FIRMWARE = f"firmware {'.'.join(map(str, FIRMWARE_VERSION))}"
LEFT, RIGHT = 1500.0, 1800.0  # ticks/s


def driving(now: float) -> tuple[int, int]:
    return math.floor(LEFT * now), math.floor(RIGHT * now)


class Line:
    """Session and board on a line that loses and delays as told, 1 ms a step."""

    def __init__(
        self, board: RomeoStandIn, start: float = 100.0, robot: RobotConfig | None = None
    ) -> None:
        self.board, self.session = board, BoardSession(robot or RobotConfig())
        self.now = start
        self.steps: list[Displacement] = []
        self.lose = self.tear = 0.0
        self.rng = random.Random(1)
        self.wanted: tuple[int, int] | None = None
        self.to_board = bytearray()
        self.session.connect(start)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now += 0.001
            for _, chunk in self.board.transmit(self.now - 0.0005):
                if self.rng.random() < self.lose:
                    continue
                if self.rng.random() < self.tear:
                    chunk = chunk[self.rng.randrange(len(chunk)) :]
                self.steps += self.session.receive(chunk, self.now)
            data = self.session.transmit(self.now, self.wanted)
            self.to_board += data
            self.board.receive(data, self.now)

    @property
    def state(self) -> tuple[bool, str]:
        return self.session.state(self.now)

    def ticks(self) -> tuple[int, int]:
        known = [step.ticks for step in self.steps if step.ticks is not None]
        assert len(known) == len(self.steps)
        return sum(left for left, _ in known), sum(right for _, right in known)


def check_chain(steps: list[Displacement]) -> None:
    """Each interval begins where the one before ended: no time is told twice or left out."""
    for before, after in itertools.pairwise(steps):
        assert after.time - after.interval == pytest.approx(before.time, abs=1e-9)
        assert after.interval > 0


def check_ticks(line: Line) -> None:
    """All ticks between the first and the last instant told, none lost, none twice."""
    steps = line.steps
    begin = steps[0].time - steps[0].interval
    for wheel, speed in enumerate((LEFT, RIGHT)):
        expected = speed * (steps[-1].time - begin)
        assert line.ticks()[wheel] == pytest.approx(expected, abs=speed * 0.004 + 2)


def test_greeting_then_displacements() -> None:
    line = Line(RomeoStandIn(driving, start=50.0, drift=0.004))
    line.run(5.0)
    assert line.state == (True, FIRMWARE)
    assert len(line.steps) == pytest.approx(250, abs=4)
    check_chain(line.steps)
    check_ticks(line)
    last = line.steps[-1]
    assert last.time == pytest.approx(line.now, abs=0.03)
    counts = line.session.counts()
    assert (counts["connections"], counts["lost"], counts["refused"]) == (1, 0, 0)


@pytest.mark.parametrize(("lose", "tear"), [(0.3, 0.0), (0.0, 0.3), (0.4, 0.2)])
def test_lost_and_torn_frames_are_counted_and_lose_no_tick(lose: float, tear: float) -> None:
    line = Line(RomeoStandIn(driving, start=50.0))
    line.run(1.0)
    line.lose, line.tear = lose, tear
    line.run(10.0)
    line.lose = line.tear = 0.0
    line.run(0.1)
    check_chain(line.steps)
    check_ticks(line)
    first, last = line.steps[0], line.steps[-1]
    reported = round((last.time - first.time) / 0.02)
    assert line.session.counts()["lost"] == reported - (len(line.steps) - 1)
    assert line.session.counts()["lost"] > 80


def test_counters_wrap_at_32_bits() -> None:
    near = 2**31 - 3000
    base = {"at": 0}

    def ticks(now: float) -> tuple[int, int]:
        left, right = driving(now - 100.0)
        return left + base["at"], right - base["at"]

    board = RomeoStandIn(ticks, start=100.0, first_count_us=2**32 - 2_000_000)
    base["at"] = near
    line = Line(board)
    line.run(5.0)
    check_chain(line.steps)
    check_ticks(line)
    assert line.session.counts()["restarts"] == 0


def test_a_wrong_hash_is_told_with_both_and_nothing_is_believed_or_commanded() -> None:
    board = RomeoStandIn(driving, start=99.0)
    board.protocol_hash = 0x0BADC0DE
    line = Line(board)
    line.wanted = (100, 100)
    line.run(3.0)
    ok, reason = line.state
    assert not ok
    assert reason == (
        f"firmware speaks 0badc0de, host speaks {PROTOCOL_HASH:08x}: run `swarmloc flash`"
    )
    assert line.steps == []
    assert board.wheel_speeds(line.now) == (0, 0)
    sent = BoardDecoder().feed(bytes(line.to_board))
    assert set(sent) == {HelloFrame()}
    assert 5 <= len(sent) <= 8
    board.protocol_hash = PROTOCOL_HASH
    line.run(1.0)
    assert line.state[0]
    assert line.steps


def test_a_restarted_board_is_noticed_greeted_again_and_invents_no_motion() -> None:
    board = RomeoStandIn(driving, start=99.0, first_count_us=4_000_000_000)
    line = Line(board)
    line.run(2.0)
    told = len(line.steps)
    board.reset(line.now + 1.0)
    reasons = set()
    for _ in range(1500):
        line.run(0.001)
        reasons.add(line.state[1])
    assert any("restarted" in reason for reason in reasons)
    assert line.state[0]
    assert line.session.counts()["restarts"] == 1
    for step in line.steps:
        assert step.ticks is not None
        assert step.ticks[0] == pytest.approx(LEFT * step.interval, abs=5)
    assert len(line.steps) > told + 10


def test_a_restart_that_looks_like_a_roll_over_is_still_told() -> None:
    board = RomeoStandIn(driving, start=99.0, first_count_us=2**32 - 4_000_000)
    line = Line(board)
    line.run(2.9)  # 0.1 s before the roll-over the board restarts, in no time
    board.reset(line.now)
    line.run(1.0)
    assert line.session.counts()["restarts"] == 1
    assert line.state[0]
    assert all(step.interval < 0.1 for step in line.steps)
    assert all(step.ticks is not None and step.ticks[0] > 0 for step in line.steps)


def test_a_restart_is_told_by_the_clock_where_somebody_else_greeted_the_board() -> None:
    line = Line(RomeoStandIn(driving, start=99.0))
    line.run(2.0)
    line.board.reset(line.now)
    line.board.receive(encode(HelloFrame()), line.now)
    line.run(1.0)
    assert line.session.counts()["restarts"] == 1
    assert line.state[0]
    assert all(step.ticks is not None and step.ticks[0] > 0 for step in line.steps)


def test_the_end_of_one_connection_does_not_spoil_the_next() -> None:
    session = BoardSession(RobotConfig())
    session.connect(0.0)
    identity = encode(IdentityFrame(PROTOCOL_HASH, 1, 2, 3, 1, 2))
    session.receive(identity[:4], 0.1)
    session.connect(1.0)
    session.receive(identity, 1.1)
    assert session.state(1.1) == (False, "sending the board its settings")
    session.receive(encode(settings_for(RobotConfig())), 1.2)
    assert session.state(1.2) == (True, "firmware 1.2.3")


def test_settings_that_the_last_connection_left_unread_are_no_answer_to_this_one() -> None:
    robot = RobotConfig(motors=Motors(left_reversed=True))
    line = Line(RomeoStandIn(driving, start=99.0), robot=robot)
    line.session.receive(encode(settings_for(RobotConfig())), line.now)
    line.run(1.0)
    assert line.board.settings == settings_for(robot)
    assert line.state == (True, FIRMWARE)


def test_a_silent_board_and_its_return() -> None:
    line = Line(RomeoStandIn(driving, start=99.0))
    line.run(1.0)
    line.board.silent = True
    line.run(1.5)
    assert line.state == (
        False,
        "the board fell silent: check its power, press its reset button",
    )
    line.board.silent = False
    line.run(0.5)
    assert line.state[0]
    check_chain(line.steps)
    check_ticks(line)


def test_no_answer_and_foreign_answers_differ_in_words() -> None:
    line = Line(RomeoStandIn(driving, start=99.0))
    line.board.silent = True
    line.run(0.5)
    assert line.state == (False, "waiting for the board to answer")
    line.run(1.0)
    assert "does not answer" in line.state[1]
    line.session.receive(b"1920;1915\r\n1922;1917\r\n", line.now)
    assert "not this firmware's" in line.state[1]
    assert "run `swarmloc flash`" in line.state[1]


def test_lost_settings_are_told_while_the_board_works() -> None:
    line = Line(RomeoStandIn(driving, start=99.0))
    line.board.settings_defaulted = True
    line.run(1.0)
    ok, reason = line.state
    assert ok
    assert "settings sent from robot.toml" in reason
    assert not line.board.settings_defaulted


def test_commands_are_repeated_while_wanted_and_end_with_a_stop() -> None:
    board = RomeoStandIn(driving, start=99.0)
    line = Line(board)
    line.run(0.5)
    line.to_board.clear()
    line.wanted = (300, -200)
    line.run(1.0)
    sent = BoardDecoder().feed(bytes(line.to_board))
    assert set(sent) == {VelocityFrame(300, -200)}
    assert len(sent) == pytest.approx(20, abs=1)
    assert board.wheel_speeds(line.now) == (300, -200)
    line.wanted = (50, 50)
    line.run(0.002)
    assert board.wheel_speeds(line.now) == (50, 50)
    line.wanted = None
    line.run(0.002)
    assert board.wheel_speeds(line.now) == (0, 0)
    line.to_board.clear()
    line.run(1.0)
    assert line.to_board == b""


def test_a_new_connection_forgets_counters_of_the_last() -> None:
    line = Line(RomeoStandIn(driving, start=99.0))
    line.run(1.0)
    line.board = RomeoStandIn(driving, start=line.now)
    line.session.connect(line.now)
    line.run(1.0)
    for step in line.steps:
        assert step.interval < 0.1
    assert line.session.counts()["connections"] == 2
    assert line.session.counts()["restarts"] == 1, "it was another board, or the same anew"


@pytest.mark.parametrize("away_s", [0.5, 100.0, 1.5 * 2**32 * 1e-6])
def test_a_board_that_was_only_unplugged_has_not_restarted(away_s: float) -> None:
    robot = RobotConfig(board=Board(report_rate_hz=10))
    line = Line(RomeoStandIn(driving, start=99.0, drift=0.004), robot=robot)
    line.run(1.0)
    line.board.silent = True
    line.board.transmit(line.now + away_s)
    line.now += away_s
    line.board.silent = False
    line.session.connect(line.now)
    line.run(1.0)
    counts = line.session.counts()
    assert (counts["connections"], counts["restarts"]) == (2, 0)


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_absurd_values_never_raise(seed: int) -> None:
    print(f"seed {seed}")
    rng = random.Random(seed)
    session = BoardSession(RobotConfig())
    now = 0.0
    for _ in range(3000):
        now += rng.random() * 0.1
        kind = rng.randrange(4)
        if kind == 0:
            data = rng.randbytes(rng.randrange(100))
        elif kind == 1:
            data = encode(IdentityFrame(PROTOCOL_HASH, 1, 2, 3, *rng.randbytes(2)))
        else:
            data = encode(
                DisplacementFrame(
                    rng.randrange(1 << 16),
                    rng.choice((0, 1, 2**32 - 1, rng.randrange(1 << 32))),
                    rng.choice((-(2**31), 2**31 - 1, 0)),
                    rng.randrange(-(2**31), 2**31),
                    *(rng.randrange(-(2**31), 2**31) for _ in range(2)),
                    rng.choice((0, 0, 0, rng.randrange(256))),
                    rng.randrange(1 << 16),
                    rng.randrange(1 << 16),
                    rng.randrange(1 << 16),
                    rng.randrange(1 << 16),
                )
            )
        for step in session.receive(data, now):
            assert math.isfinite(step.dx + step.dy + step.dpsi)
            assert step.interval > 0
        session.transmit(now, (1, 1))
        session.state(now)


def test_the_board_gets_the_settings_of_robot_toml_before_anything_moves_or_counts() -> None:
    wheels = Wheels(left_radius_m=0.03, right_radius_m=0.034, counts_per_turn=3840)
    motors = Motors(
        right_reversed=True, left_encoder_reversed=True, full_speed_mps=0.5, acceleration_mps2=2.0
    )
    robot = RobotConfig(wheels=wheels, motors=motors, board=Board(report_rate_hz=100))
    line = Line(RomeoStandIn(driving, start=99.0), robot=robot)
    line.wanted = (100, 100)
    line.run(1.0)
    kinds = [type(frame) for frame in BoardDecoder().feed(bytes(line.to_board))]
    assert kinds[:3] == [HelloFrame, SettingsFrame, VelocityFrame]
    got = line.board.settings
    assert got.report_rate_hz == 100
    assert got.reversed == SettingsReversed.RIGHT_MOTOR | SettingsReversed.LEFT_ENCODER
    # By hand, with each wheel's own ticks per metre averaged: 3840 / (2 pi 0.032) is not it.
    per_metre = 3840 / (2 * math.pi) * (1 / 0.03 + 1 / 0.034) / 2
    assert got.full_speed == pytest.approx(0.5 * per_metre, abs=0.5)
    assert got.acceleration == pytest.approx(2.0 * per_metre, abs=0.5)
    assert (got.proportional, got.integral) == (32, 128)
    assert len(line.steps) == pytest.approx(97, abs=3)


def test_what_the_board_cannot_set_is_told() -> None:
    robot = RobotConfig(wheels=Wheels(counts_per_turn=4, periods_per_turn=0))
    line = Line(RomeoStandIn(driving, start=99.0), robot=robot)
    line.run(1.0)
    ok, reason = line.state
    assert ok
    assert "it can only set full_speed 100 instead of" in reason
