"""What the host says of a board whose reports are well formed and wrong."""

import itertools
import math
from dataclasses import replace

import pytest

from host.config import RobotConfig, Wheels
from host.drivers.romeo.checks import NOISE_S, old_version, wrong_edges
from host.drivers.romeo.differential_drive import displacement
from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import FIRMWARE_VERSION, DisplacementFrame, IdentityFrame
from host.drivers.romeo.session import BoardSession
from host.messages import Displacement
from host.simulation.devices.romeo_stand_in import RomeoStandIn


class Line:
    """A session and a stand-in whose displacements may be changed on the way."""

    def __init__(self, robot: RobotConfig | None = None) -> None:
        self.ticks = [0.0, 0.0]
        self.speeds = (1500.0, 1800.0)
        self.board = RomeoStandIn(lambda now: (int(self.ticks[0]), int(self.ticks[1])), 9.0)
        self.session = BoardSession(robot or RobotConfig())
        self.session.connect(10.0)
        self.now = 10.0
        self.wanted: tuple[int, int] | None = None
        self.distance_error_um = 0

    def run(self, seconds: float) -> list[Displacement]:
        steps = []
        decoder = BoardDecoder()
        for _ in range(round(seconds / 0.002)):
            self.now += 0.002
            self.ticks = [t + 0.002 * s for t, s in zip(self.ticks, self.speeds, strict=True)]
            for _, data in self.board.transmit(self.now):
                for frame in decoder.feed(data):
                    steps += self.session.receive(encode(self._changed(frame)), self.now)
            self.board.receive(self.session.transmit(self.now, self.wanted), self.now)
        return steps

    def _changed(self, frame: object) -> object:
        if isinstance(frame, DisplacementFrame) and self.distance_error_um:
            return replace(frame, distance_um=frame.distance_um + self.distance_error_um)
        return frame

    @property
    def state(self) -> tuple[bool, str]:
        return self.session.state(self.now)


def test_a_board_that_agrees_is_told_of_by_its_version_alone() -> None:
    line = Line()
    line.run(3.0)
    assert line.state == (True, f"firmware {'.'.join(map(str, FIRMWARE_VERSION))}")
    assert line.session.counts()["odometry_disagreements"] == 0


def test_odometry_that_does_not_follow_from_the_ticks_is_told_and_the_ticks_are_used() -> None:
    line = Line()
    before = line.run(1.0)[-1]
    line.distance_error_um = 500
    after = line.run(0.1)[-1]
    ok, reason = line.state
    assert not ok
    assert "do not follow from its ticks" in reason
    assert after.dx / after.interval == pytest.approx(before.dx / before.interval, rel=0.1)
    assert line.session.counts()["odometry_disagreements"] == 1


@pytest.mark.parametrize("version", [(0, 1, 9), (0, 0, 1)])
def test_an_older_version_of_the_same_protocol_is_named(version: tuple[int, int, int]) -> None:
    line = Line()
    line.board.version = version
    line.run(0.5)
    ok, reason = line.state
    assert ok
    assert reason.startswith(f"firmware {'.'.join(map(str, version))}; older than")
    assert "run `swarmloc flash`" in reason


def test_this_and_later_versions_are_not_called_old() -> None:
    major, minor, patch = FIRMWARE_VERSION
    for version in (FIRMWARE_VERSION, (major, minor, patch + 1), (major + 1, 0, 0)):
        assert old_version(IdentityFrame(0, *version, 1, 2)) == ""


@pytest.mark.parametrize(
    ("edges", "counts", "periods", "fault", "remark"),
    [
        (2, 1920, 960, False, False),
        (4, 3840, 960, False, False),
        (2, 1903, 960, False, False),
        (4, 1920, 960, True, False),
        (2, 3840, 960, True, False),
        (4, 1903, 960, True, False),
        (2, 1000, 960, False, True),  # another motor; half of 2 edges is no wiring
        (2, 1000, 500, False, False),
        (4, 1920, 0, False, False),
        (4, 7680, 1920, False, False),
    ],
)
def test_edges_are_held_against_counts_per_turn(
    edges: int, counts: int, periods: int, fault: bool, remark: bool
) -> None:
    wheels = Wheels(counts_per_turn=counts, periods_per_turn=periods)
    found = wrong_edges(IdentityFrame(0, 1, 2, 3, 1, edges), wheels)
    assert tuple(map(bool, found)) == (fault, remark)
    if any(found):
        assert f"counts_per_turn is {counts}" in "".join(found)


def test_another_wiring_is_told_with_the_value_to_set() -> None:
    line = Line()
    line.board.edges_per_period = 4
    line.run(0.5)
    ok, reason = line.state
    assert not ok
    assert "the firmware counts 4 edges" in reason
    assert "set counts_per_turn = 3840" in reason


def test_illegal_transitions_are_counted_told_for_a_while_and_widen_the_odometry() -> None:
    line = Line()
    (*_, quiet) = line.run(1.0)
    line.board.illegal = (65530, 0)  # from now on modulo 2^16
    line.run(0.1)
    line.board.illegal = (65530 + 26, 0)
    steps = line.run(0.1)
    assert line.session.counts()["illegal_left"] == 65530 + 26
    assert line.session.counts()["illegal_right"] == 0
    ok, reason = line.state
    assert ok
    assert "left encoder" in reason
    assert "illegal transitions" in reason
    assert "right encoder" not in reason
    wheels = RobotConfig().wheels
    metre = 2 * math.pi * wheels.left_radius_m / wheels.counts_per_turn
    noisy = max(step.translation_variance for step in steps)
    assert noisy - quiet.translation_variance == pytest.approx((26 * metre) ** 2, rel=0.1)
    assert steps[-1].translation_variance == pytest.approx(quiet.translation_variance, rel=0.1)
    line.run(NOISE_S + 1.0)
    assert line.state == (True, f"firmware {'.'.join(map(str, FIRMWARE_VERSION))}")


def test_illegal_transitions_of_one_wheel_widen_the_heading_by_the_track() -> None:
    wheels = Wheels()
    clean = displacement(wheels, 1.0, 0.02, 30, 30)
    noisy = displacement(wheels, 1.0, 0.02, 30, 30, illegal=(0, 5))
    off = 5 * 2 * 2 * math.pi * wheels.right_radius_m / wheels.counts_per_turn  # m, of this wheel
    assert noisy.heading_variance - clean.heading_variance == pytest.approx(
        (off / wheels.track_m) ** 2
    )
    assert noisy.translation_variance - clean.translation_variance == pytest.approx((off / 2) ** 2)


def test_a_wheel_that_stands_is_named_and_tried_again_ever_later() -> None:
    line = Line()
    line.run(0.5)
    line.wanted, line.speeds = (1500, 1800), (0.0, 1800.0)
    line.run(0.6)
    ok, reason = line.state
    assert not ok
    assert "the left wheel was driven hard" in reason
    assert line.board.wheel_speeds(line.now) == (0, 0)
    tries = []
    for _ in range(4000):
        stopped = line.board.wheel_speeds(line.now) == (0, 0)
        line.run(0.01)
        if stopped and line.board.wheel_speeds(line.now) != (0, 0):
            tries.append(line.now)
    gaps = [later - earlier for earlier, later in itertools.pairwise(tries)]
    assert gaps == sorted(gaps)
    assert gaps[0] == pytest.approx(4.3, abs=0.3)
    assert gaps[-1] < 17.0


def test_a_runaway_of_before_this_connection_is_ended_by_the_first_stop() -> None:
    line = Line()
    line.run(0.5)
    line.wanted, line.speeds = (1500, 1800), (0.0, 0.0)
    line.run(0.8)
    assert not line.state[0]
    line.session = BoardSession(RobotConfig())
    line.session.connect(line.now)
    line.wanted, line.speeds = None, (0.0, 0.0)
    line.run(0.5)
    line.wanted, line.speeds = (1500, 1800), (1500.0, 1800.0)
    line.run(0.5)
    assert line.board.wheel_speeds(line.now) == (1500, 1800)
    assert line.session.counts()["runaways"] == 0
