"""How long the interrupts and the loop of a simulated board's program take."""

import ctypes
from dataclasses import dataclass

INTERRUPTS = {
    1: "INT0",
    2: "INT1",
    9: "PCINT0",
    10: "USB_GEN",
    11: "USB_COM",
    12: "WDT",
    17: "TIMER1_COMPA",
    20: "TIMER1_OVF",
    23: "TIMER0_OVF",
}


@dataclass(frozen=True, slots=True)
class InterruptTime:
    """One interrupt's runs: how many, the longest, and the longest wait from request to start.

    In cycles of 1/16 us. A run lasts from its vector to its RETI, which are not counted.
    """

    count: int
    worst_cycles: int
    worst_latency_cycles: int


@dataclass(frozen=True, slots=True)
class PassTime:
    """How often a place in the program was passed again, and the most cycles in between."""

    count: int
    worst_cycles: int


def interrupts(library: ctypes.CDLL, board: ctypes.c_void_p) -> dict[str, InterruptTime]:
    """The interrupts that ran, by name, of a board of the library."""
    figures = (ctypes.c_uint64 * 3)()
    found = {}
    for vector, name in INTERRUPTS.items():
        library.romeo_vector(board, vector, figures)
        if figures[0]:
            found[name] = InterruptTime(*figures)
    return found


def passes(library: ctypes.CDLL, board: ctypes.c_void_p) -> PassTime:
    """How the watched place of the program was passed."""
    figures = (ctypes.c_uint64 * 2)()
    library.romeo_passes(board, figures)
    return PassTime(*figures)


def longest_interrupts_off(library: ctypes.CDLL, board: ctypes.c_void_p) -> tuple[int, int]:
    """The longest time with interrupts off (cycles), and where in flash (byte address) it began."""
    figures = (ctypes.c_uint64 * 2)()
    library.romeo_deaf(board, figures)
    return figures[0], figures[1]
