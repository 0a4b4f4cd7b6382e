"""The simulated board's C part: built with the system's compiler if needed, loaded by ctypes."""

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

from host.errors import UserError
from host.flashing.firmware import written
from host.folders import build_folder, data_folder

SOURCES = data_folder() / "firmware/simulator"
COMPILE = ("cc", "-std=gnu11", "-O2", "-Wall", "-Wextra", "-fPIC", "-shared")
LIBRARIES = ("-lsimavr",)
INSTALL = "sudo apt install gcc libc6-dev libsimavr-dev"

_BOARD = ctypes.c_void_p
_BYTES = ctypes.c_char_p
_U64 = ctypes.c_uint64
_I64 = ctypes.c_int64
_U32 = ctypes.c_uint32
_INT = ctypes.c_int
_U64_OUT = ctypes.POINTER(_U64)

# By name, result and arguments of the functions at the end of romeo_simulator.c.
_FUNCTIONS = {
    "romeo_new": (_BOARD, [_BYTES, _U32, _INT]),
    "romeo_free": (None, [_BOARD]),
    "romeo_cycle": (_U64, [_BOARD]),
    "romeo_error": (_BYTES, [_BOARD]),
    "romeo_watchdog_resets": (_U64, [_BOARD]),
    "romeo_bootloader": (_INT, [_BOARD]),
    "romeo_configured": (_INT, [_BOARD]),
    "romeo_open": (_INT, [_BOARD]),
    "romeo_run": (_INT, [_BOARD, _U64]),
    "romeo_reset": (None, [_BOARD]),
    "romeo_turn": (None, [_BOARD, _INT, _I64, _U64]),
    "romeo_disturb": (None, [_BOARD, _INT, _INT, _U64, _U64, _U64]),
    "romeo_steps": (_I64, [_BOARD, _INT]),
    "romeo_set_line": (_INT, [_BOARD, _U32, _INT]),
    "romeo_request": (_INT, [_BOARD, _BYTES, _INT]),
    "romeo_set_stage_gap": (None, [_BOARD, _U32]),
    "romeo_set_reading": (None, [_BOARD, _INT]),
    "romeo_send": (_INT, [_BOARD, _BYTES, _U32]),
    "romeo_unsent": (_U32, [_BOARD]),
    "romeo_take": (_U32, [_BOARD, _BYTES, _U64_OUT]),
    "romeo_descriptor": (_U32, [_BOARD, _INT, _BYTES]),
    "romeo_motor": (ctypes.c_double, [_BOARD, _INT]),
    "romeo_ram": (_BOARD, [_BOARD, _U32]),
    "romeo_eeprom": (None, [_BOARD, _BYTES, _U32, _INT]),
    "romeo_patch": (_INT, [_BOARD, _U32, _BYTES, _U32]),
    "romeo_vector": (None, [_BOARD, _INT, _U64_OUT]),
    "romeo_watch": (None, [_BOARD, _I64]),
    "romeo_passes": (None, [_BOARD, _U64_OUT]),
    "romeo_deaf": (None, [_BOARD, _U64_OUT]),
    "romeo_clear_figures": (None, [_BOARD]),
}


@functools.cache
def load() -> ctypes.CDLL:
    """Return the library, its functions declared. Calls into it release the interpreter's lock.

    Raises UserError if it is not built yet and cannot be.
    """
    path = build()
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        # The system's libsimavr may have been replaced since, or its folder not be executable.
        raise _not_built(f"{error}; what was built is in {path.parent}") from error
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def build() -> Path:
    """Return the compiled library's path, compiling it if these sources were not before."""
    sources = sorted(SOURCES.glob("*.c"))
    if not sources:
        raise UserError(
            "the board's simulator is not here",
            f"{SOURCES} has no sources: this installation is incomplete",
            "install swarmloc again",
        )
    # A home folder may be shared by machines of different kinds.
    digest = hashlib.sha256(repr((COMPILE, LIBRARIES, platform.machine())).encode())
    for file in [*sources, *sorted(SOURCES.glob("*.h"))]:
        digest.update(file.read_bytes())
    library = build_folder() / f"romeo-simulator-{digest.hexdigest()[:16]}.so"
    if not library.exists():
        _compile(sources, library)
    return library


def _compile(sources: list[Path], library: Path) -> None:
    if shutil.which(COMPILE[0]) is None:
        raise _not_built("no C compiler is installed")
    # Built aside, so that whoever looks for it meanwhile finds it whole or not at all.
    with (
        written(library.parent, "the board's simulator"),
        tempfile.TemporaryDirectory(dir=library.parent) as folder,
    ):
        made = Path(folder) / library.name
        result = subprocess.run(
            [*COMPILE, "-o", str(made), *map(str, sources), *LIBRARIES],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        if result.returncode != 0:
            raise _not_built(_cause(result.stderr))
        os.replace(made, library)


def _cause(messages: str) -> str:
    if "simavr" in messages:
        return "libsimavr-dev is not installed"
    errors = [line for line in messages.splitlines() if "error" in line]
    return errors[0] if errors else "the C compiler failed"


def _not_built(why: str) -> UserError:
    return UserError("cannot build the board's simulator", why, INSTALL)
