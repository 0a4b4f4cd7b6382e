"""Which board a live simulation gets: the firmware itself where it can, else its stand-in."""

from collections.abc import Callable
from typing import NamedTuple

from host.config import Motors
from host.errors import UserError
from host.flashing.build import build_with_avr_gcc
from host.simulation.devices import romeo_library
from host.simulation.devices.romeo_elf_device import RomeoElfDevice
from host.simulation.devices.romeo_stand_in import RomeoStandIn

Ticks = Callable[[float], tuple[int, int]]


class BoardKind(NamedTuple):
    """A kind of board. make: one whose wheels stand at `ticks(time)`, switched on at time 0.

    name: for the screen.
    """

    make: Callable[[Ticks], RomeoStandIn | RomeoElfDevice]
    name: str


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
