"""The firmware, built: for the board in the simulator, and its pure parts for this machine."""

import ctypes
import functools
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from host.flashing.build import build_with_avr_gcc
from host.simulation.devices import romeo_library
from tests.firmware.boards import BoardUnderTest, ElfBoard, StandInBoard
from tests.toolchain import missing, needed

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware/romeo_odometry"
PURE = (
    "framing",
    "speed_control",
    "runaway",
    "tick_counter",
    "odometry",
    "settings",
    "displacement",
)
HERE = Path(__file__).resolve().parent / "host"


@pytest.fixture(scope="session")
def elf() -> Callable[[int], Path]:
    """The firmware's ELF by its encoder edges, 2 or 4, built with avr-gcc."""

    @functools.cache
    def build(encoder_edges: int) -> Path:
        needed(romeo_library.load)
        return needed(lambda: build_with_avr_gcc({"ENCODER_EDGES": str(encoder_edges)})).elf

    return build


@pytest.fixture(params=["stand-in", "elf-2x", "elf-4x"])
def make_board(
    request: pytest.FixtureRequest, elf: Callable[[int], Path]
) -> Callable[[int], BoardUnderTest]:
    """A new board whose clock (us) begins where told."""
    if request.param == "stand-in":
        return StandInBoard
    edges = int(request.param[4])
    return lambda clock_us: ElfBoard(elf(edges), edges, clock_us)


@pytest.fixture(scope="session")
def pure_parts(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """tests/firmware/host/pure_parts.cpp as a library; undefined behaviour in it aborts."""
    if shutil.which("g++") is None:
        missing("no g++ on this machine: sudo apt-get install g++")
    library = tmp_path_factory.mktemp("firmware") / "pure_parts.so"
    sources = [HERE / "pure_parts.cpp", *(FIRMWARE / f"src/{name}.cpp" for name in PURE)]
    includes = [f"-I{folder}" for folder in (HERE, FIRMWARE / "include", FIRMWARE / "src")]
    checks = ["-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    command = ["g++", "-std=gnu++14", "-shared", "-fPIC", "-O1", *checks, *includes]
    subprocess.run([*command, "-o", library, *sources], check=True)
    parts = ctypes.CDLL(str(library))
    for name in ("decoder_new", "decoder_content", "control_new", "reports_new", "odometry_new"):
        getattr(parts, name).restype = ctypes.c_void_p
    for name, result in (
        ("control_step", ctypes.c_int16),
        ("decoder_bad", ctypes.c_uint16),
        ("reports_due", ctypes.c_bool),
        ("settings_unpack", ctypes.c_bool),
    ):
        getattr(parts, name).restype = result
    return parts
