"""Which board a live simulation gets: the firmware itself where it can, else its stand-in."""

from collections.abc import Callable
from typing import NamedTuple

from host.config import Motors, RobotConfig, Wheels
from host.errors import UserError
from host.flashing.build import build_with_avr_gcc
from host.simulation.devices import romeo_library
from host.simulation.devices.driven_wheels import CommandDriven, MotorDriven
from host.simulation.devices.romeo_elf_device import RomeoElfDevice
from host.simulation.devices.romeo_stand_in import RomeoStandIn

Ticks = Callable[[float], tuple[int, int]]


class BoardKind(NamedTuple):
    """A kind of board. make: one whose wheels stand at `ticks(time)`, switched on at time 0.

    name: for the screen.
    """

    make: Callable[[Ticks], RomeoStandIn | RomeoElfDevice]
    name: str


def motion_of(
    board: RomeoStandIn | RomeoElfDevice, robot: RobotConfig, wheels: Wheels
) -> MotorDriven | CommandDriven:
    """What turns the wheels of a robot that obeys this board. wheels: as they actually are."""
    motors = robot.motors
    if isinstance(board, RomeoElfDevice):
        return MotorDriven(lambda: board.board.motors, motors)
    mean_radius = 0.5 * (robot.wheels.left_radius_m + robot.wheels.right_radius_m)
    acceleration = motors.acceleration_mps2 / mean_radius
    return CommandDriven(
        board.wheel_speeds, board.has_timed_out, wheels.counts_per_turn, acceleration
    )


STAND_IN = BoardKind(RomeoStandIn, "a stand-in")


def best_board(motors: Motors) -> BoardKind:
    """The firmware itself, built where it has changed; the stand-in, with the reason, if it cannot.

    motors: the simulated encoders are wired as they say.
    """
    try:
        romeo_library.load()
        firmware = build_with_avr_gcc()
    except UserError as error:
        return BoardKind(RomeoStandIn, f"a stand-in ({error.why})")
    return BoardKind(
        lambda ticks: RomeoElfDevice(firmware.elf, wired(ticks, motors)),
        f"the firmware, built with {firmware.built_with}",
    )


def wired(ticks: Ticks, motors: Motors) -> Ticks:
    """Raw ticks, before the reversal settings."""
    left_sign = -1 if motors.left_encoder_reversed else 1
    right_sign = -1 if motors.right_encoder_reversed else 1

    def counted(time: float) -> tuple[int, int]:
        left, right = ticks(time)
        return left_sign * left, right_sign * right

    return counted
