"""Edges or requests without end: the motors go off, and no tick is lost to a host that is slow."""

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from host.config import Wheels
from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame, VelocityFrame
from host.simulation.devices.motors import DrivenRobot
from host.simulation.devices.romeo_elf import CHANNEL_A, CHANNEL_B, LEFT, RIGHT
from tests.firmware.boards import ElfBoard

OFF_S = 0.6
ALL = tuple(itertools.product((LEFT, RIGHT), (CHANNEL_A, CHANNEL_B)))
READ_CONFIGURATION = bytes.fromhex("8006000200000002")
READ_PRODUCT = bytes.fromhex("800602030000ff00")
SET_LINE_CODING = bytes.fromhex("2120000000000700")
GET_LINE_CODING = bytes.fromhex("a121000000000700")


class Driving:
    """A robot on its real firmware that was sent off forward a second ago."""

    def __init__(self, elf: Path, edges: int) -> None:
        self.board = ElfBoard(elf, edges)
        self.robot = DrivenRobot(self.board.elf, Wheels())
        self.command = encode(VelocityFrame(750 * edges, 750 * edges))
        self.board.send(encode(HelloFrame()))
        self.drive(1.0)
        assert self.board.driving == (1, 1)

    def drive(self, seconds: float, commanded: bool = True) -> None:
        end = self.board.now + seconds
        while self.board.now < end:
            if commanded:
                self.board.send(self.command)
            self.robot.run(min(self.board.now + 0.05, end))

    def storm(self, pins: Sequence[tuple[int, int]], rate_hz: float, seconds: float) -> None:
        """Edges on each of the pins, so many a second."""
        for wheel, channel in pins:
            period = 2.0 / rate_hz
            self.board.elf.disturb(wheel, channel, period / 2, period, round(seconds / period))


def seconds_until_off(driving: Driving, commanded: bool) -> float:
    start = driving.board.now
    while driving.board.driving != (0, 0):
        driving.drive(0.01, commanded)
        assert driving.board.now < start + 2.0, "still driving"
    return driving.board.now - start


@pytest.mark.parametrize("pins", [ALL[:1], ALL[1:2], ALL[2:3], ALL[3:], ALL], ids=str)
@pytest.mark.parametrize("rate_hz", [40e3, 140e3, 500e3])
@pytest.mark.parametrize("edges", [2, 4])
def test_a_storm_ends_with_the_motors_off(
    elf: Callable[[int], Path], edges: int, rate_hz: float, pins: Sequence[tuple[int, int]]
) -> None:
    driving = Driving(elf(edges), edges)
    driving.storm(pins, rate_hz, 0.8)
    assert seconds_until_off(driving, commanded=False) < OFF_S
    driving.drive(0.1, commanded=False)
    assert driving.board.driving == (0, 0)


@pytest.mark.parametrize("edges", [2, 4])
@pytest.mark.parametrize("rate_hz", [20e3, 120e3, 300e3])
def test_a_storm_on_a_wheels_a_stops_also_a_robot_that_is_commanded_on(
    elf: Callable[[int], Path], edges: int, rate_hz: float
) -> None:
    driving = Driving(elf(edges), edges)
    driving.storm([(RIGHT, CHANNEL_A)], rate_hz, 0.8)
    assert seconds_until_off(driving, commanded=True) < OFF_S


@pytest.mark.parametrize("on_ms", [30, 200, 450])
def test_storms_with_pauses_do_not_stretch_the_command_timeout(
    elf: Callable[[int], Path], on_ms: int
) -> None:
    driving = Driving(elf(2), 2)
    start = driving.board.now
    while driving.board.driving != (0, 0):
        driving.storm([(LEFT, CHANNEL_A), (RIGHT, CHANNEL_A)], 400e3, on_ms / 1000)
        driving.drive(on_ms / 1000 + 0.005, commanded=False)
        assert driving.board.now < start + OFF_S + on_ms / 1000, "still driving"


@pytest.mark.parametrize("setup", [SET_LINE_CODING, READ_CONFIGURATION], ids=["write", "read"])
@pytest.mark.parametrize("edges", [2, 4])
def test_a_control_request_without_its_data_stage_stops_nothing_but_the_motors(
    elf: Callable[[int], Path], edges: int, setup: bytes
) -> None:
    driving = Driving(elf(edges), edges)
    start = driving.board.now
    driving.board.elf.request(setup, abandoned=True)
    while driving.board.driving != (0, 0):
        driving.drive(0.01)
        assert driving.board.now < start + OFF_S, "still driving"


@pytest.mark.parametrize("edges", [2, 4])
def test_abandoned_requests_again_and_again(elf: Callable[[int], Path], edges: int) -> None:
    driving = Driving(elf(edges), edges)
    start = driving.board.now
    while driving.board.driving != (0, 0):
        driving.board.elf.request(SET_LINE_CODING, abandoned=True)
        driving.drive(0.007)
        assert driving.board.now < start + OFF_S, "still driving"


@pytest.mark.parametrize(("edges", "rate"), [(2, 8_000), (4, 20_000)])
@pytest.mark.parametrize("gap_s", [0.0, 0.001, 0.01])
def test_no_tick_is_lost_while_the_host_asks_and_takes_its_time(
    elf: Callable[[int], Path], edges: int, rate: int, gap_s: float
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.send(encode(HelloFrame()))
    board.elf.slow_control(gap_s)
    expected = 0
    for k in range(16):
        setup = (READ_CONFIGURATION, READ_PRODUCT, GET_LINE_CODING)[k % 3]
        if k % 4 == 3:
            board.elf.open_port(57600 + k)
        else:
            board.elf.request(setup)
        board.turn(rate // 10, -rate // 10, 0.1)
        expected += rate // 10
    reports = [f for _, f in board.run(0.2) if isinstance(f, DisplacementFrame)]
    assert (reports[-1].left_ticks, reports[-1].right_ticks) == (expected, -expected)
    assert (reports[-1].left_illegal, reports[-1].right_illegal) == (0, 0)
    assert board.elf.restarts == 0
