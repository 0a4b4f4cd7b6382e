"""The firmware as the simulator runs it."""

from pathlib import Path

import pytest

from host.flashing.build import build_with_avr_gcc
from host.simulation.devices import romeo_library
from tests.toolchain import needed


@pytest.fixture(scope="session")
def elf() -> Path:
    """The firmware with its default wiring, built with avr-gcc; the simulator is built as well."""
    needed(romeo_library.load)
    return needed(build_with_avr_gcc).elf
