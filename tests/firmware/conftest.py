"""The firmware's pure sources, compiled for this machine with every check that the compiler has."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware/romeo_odometry"
PURE = ("framing", "speed_control", "settings", "displacement")
HERE = Path(__file__).resolve().parent / "host"


@pytest.fixture(scope="session")
def pure_parts(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """tests/firmware/host/pure_parts.cpp as a library; undefined behaviour in it aborts."""
    if shutil.which("g++") is None:
        why = "no g++ on this machine: sudo apt-get install g++"
        if os.environ.get("CI") == "true":
            pytest.fail(why)
        pytest.skip(why)
    library = tmp_path_factory.mktemp("firmware") / "pure_parts.so"
    sources = [HERE / "pure_parts.cpp", *(FIRMWARE / f"src/{name}.cpp" for name in PURE)]
    includes = [f"-I{folder}" for folder in (HERE, FIRMWARE / "include", FIRMWARE / "src")]
    checks = ["-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    command = ["g++", "-std=gnu++14", "-shared", "-fPIC", "-O1", *checks, *includes]
    subprocess.run([*command, "-o", library, *sources], check=True)
    parts = ctypes.CDLL(str(library))
    for name in ("decoder_new", "decoder_content", "control_new", "reports_new"):
        getattr(parts, name).restype = ctypes.c_void_p
    for name, result in (
        ("control_step", ctypes.c_int16),
        ("decoder_bad", ctypes.c_uint16),
        ("reports_due", ctypes.c_bool),
        ("settings_unpack", ctypes.c_bool),
    ):
        getattr(parts, name).restype = result
    return parts
