"""The firmware's build with avr-gcc: what it makes, when it makes it anew, and how it fails."""

import errno
import os
import re
import subprocess
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from host.errors import UserError
from host.flashing import build as romeo_build
from host.flashing import elf, platformio
from host.flashing.arduino_core import ArduinoCore, properties
from host.flashing.build import build, build_with_avr_gcc
from host.flashing.elf import symbols
from host.flashing.firmware import FLASH_BYTES, RAM_BYTES, Firmware
from host.flashing.platformio import build_with_platformio
from host.folders import build_folder
from tests.toolchain import needed

SKETCH = """
#include <Arduino.h>
#ifndef GREETING
#define GREETING 1
#endif
extern "C" { volatile uint8_t greeting = GREETING; volatile uint8_t zeros[7]; }
void setup() {}
void loop() { zeros[0] = greeting; }
"""


@pytest.fixture(scope="session")
def builds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for what is built here, with the Arduino core in it."""
    needed(romeo_build.require_avr_gcc)
    return tmp_path_factory.mktemp("builds")


@pytest.fixture
def project(builds: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(builds))
    (tmp_path / "src").mkdir()
    (tmp_path / "src/main.cpp").write_text(SKETCH)
    return tmp_path


def said_by(*command: object) -> str:
    return subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=True
    ).stdout


def test_sizes_and_symbols_are_what_binutils_says(project: Path, tmp_path: Path) -> None:
    built = build_with_avr_gcc(project=project)
    text, data, bss = map(int, said_by("avr-size", built.elf).splitlines()[1].split()[:3])
    assert (built.flash_bytes, built.ram_bytes) == (text + data, data + bss)
    assert built.built_with.startswith("avr-gcc ")
    found = symbols(built.elf)
    listed = re.findall(r"^([0-9a-f]+) [^aU] (\S+)$", said_by("avr-nm", built.elf), re.MULTILINE)
    wanted = {name: int(address, 16) for address, name in listed}
    assert {"main", "greeting", "zeros", "__vectors"} <= wanted.keys()
    for name, address in wanted.items():
        if address < 0x810000:
            assert found[name] == address % 0x800000, name
    # The .hex holds what the ELF holds.
    for source, binary in ((built.elf, "elf.bin"), (built.hex, "hex.bin")):
        kind = "ihex" if source == built.hex else "elf32-avr"
        said_by("avr-objcopy", "-I", kind, "-O", "binary", source, tmp_path / binary)
    assert (tmp_path / "elf.bin").read_bytes() == (tmp_path / "hex.bin").read_bytes()
    assert len((tmp_path / "hex.bin").read_bytes()) == built.flash_bytes


def test_what_the_sketch_does_not_use_is_not_linked(project: Path) -> None:
    found = symbols(build_with_avr_gcc(project=project).elf)
    unused = found["__bad_interrupt"]
    assert found["__vector_23"] != unused  # Timer 0, which millis() runs on
    assert found["__vector_1"] == unused  # INT0, which attachInterrupt() would bring
    assert "attachInterrupt" not in found


def test_a_define_reaches_the_sketch(project: Path) -> None:
    def greeting(built: Firmware) -> int:
        content = project / "data.bin"
        said_by("avr-objcopy", "-O", "binary", "-j", ".data", built.elf, content)
        start = 0x100  # where the ATmega32U4's RAM begins
        return content.read_bytes()[symbols(built.elf)["greeting"] - start]

    assert greeting(build_with_avr_gcc(project=project)) == 1
    assert greeting(build_with_avr_gcc({"GREETING": "42"}, project)) == 42


def test_it_is_built_once_for_each_state_of_the_sources(project: Path) -> None:
    first = build_with_avr_gcc(project=project)
    made = first.elf.stat().st_mtime_ns
    assert build_with_avr_gcc(project=project) == first
    assert first.elf.stat().st_mtime_ns == made
    (project / "include").mkdir()
    (project / "include/unused.h").write_text("#pragma once\n")
    second = build_with_avr_gcc(project=project)
    assert second.elf != first.elf
    assert symbols(second.elf) == symbols(first.elf)


def test_two_that_build_the_same_at_once_get_the_same(project: Path) -> None:
    (project / "src/main.cpp").write_text(SKETCH + "// another state of the sources\n")
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda _: build_with_avr_gcc(project=project), range(2)))
    assert both[0] == both[1]
    assert all(path.name.count(".") == 0 for path in build_folder().iterdir()), (
        "left something behind"
    )


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("int two() { return to; }", r"main\.cpp:\d+.*error: 'to' was not declared"),
        ("int two() { }", r"main\.cpp:\d+.*error: no return statement"),
        ("void missing(); int two() { missing(); return 2; }", r"undefined reference to .missing"),
    ],
)
def test_a_mistake_in_the_sources_is_told(project: Path, line: str, said: str) -> None:
    source = SKETCH.replace("void setup() {}", f"{line}\nvoid setup() {{ zeros[1] = two(); }}")
    (project / "src/main.cpp").write_text(source)
    with pytest.raises(UserError, match="cannot build the firmware") as caught:
        build_with_avr_gcc(project=project)
    assert re.search(said, caught.value.why)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("volatile char m[2500];", r"\.bss. is not within region"),
        (
            "const char m[27000] PROGMEM = {1};",
            r"does not fit the board\nit takes \d+ bytes of flash",
        ),
    ],
)
def test_what_the_board_cannot_hold_is_told(project: Path, line: str, said: str) -> None:
    user = "void setup() { zeros[1] = m[zeros[2] * 256 + zeros[3]]; }"
    (project / "src/main.cpp").write_text(SKETCH.replace("void setup() {}", f"{line}\n{user}"))
    with pytest.raises(UserError, match=said):
        build_with_avr_gcc(project=project)


def test_no_sources(builds: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(builds))
    with pytest.raises(UserError, match="there are no sources"):
        build_with_avr_gcc(project=tmp_path)


def test_a_full_disk_is_told(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> str:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "mkdtemp", full)
    with pytest.raises(UserError, match=r"(?s)cannot build.*No space left.*free space"):
        build_with_avr_gcc({"NEW": "1"}, project)


def test_missing_packages_are_named_with_the_line_to_paste(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    there = tmp_path / "there"
    there.touch()
    packages = {"gcc-avr": there, "avr-libc": tmp_path / "no", "arduino-core-avr": tmp_path / "no"}
    monkeypatch.setattr(romeo_build, "_PACKAGES", packages)
    with pytest.raises(UserError) as caught:
        build_with_avr_gcc()
    assert caught.value.why == "not installed: avr-libc, arduino-core-avr"
    assert caught.value.next_step == "run: sudo apt-get install -y avr-libc arduino-core-avr"


def test_the_product_keeps_to_its_share_of_the_board() -> None:
    for edges in "24":
        built = needed(lambda edges=edges: build_with_avr_gcc({"ENCODER_EDGES": edges}))
        assert 4000 < built.flash_bytes <= 0.6 * FLASH_BYTES
        assert 100 < built.ram_bytes <= 0.5 * RAM_BYTES


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., str]:
    """Who builds, told by `built_with`, with PlatformIO there or not and its registry so."""

    def made(name: str) -> Firmware:
        return Firmware(tmp_path / "elf", tmp_path / "hex", 1, 1, name)

    def chosen(pio: str | None, registry: str) -> str:
        monkeypatch.setattr(platformio, "find_platformio", lambda: pio)
        monkeypatch.setattr(platformio, "REGISTRY", registry)
        return build().built_with

    monkeypatch.setattr(romeo_build, "build_with_avr_gcc", lambda **_: made("avr-gcc"))
    monkeypatch.setattr(romeo_build, "build_with_platformio", lambda _: made("PlatformIO"))
    monkeypatch.setenv("PLATFORMIO_CORE_DIR", str(tmp_path))
    return chosen


class Refusal(BaseHTTPRequestHandler):
    """Answers that there is nothing."""

    def do_GET(self) -> None:
        self.send_error(404)

    def log_message(self, *_: object) -> None:
        pass


def test_platformio_builds_where_its_registry_answers_or_is_not_needed(
    tools: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with HTTPServer(("127.0.0.1", 0), Refusal) as server:
        address = f"http://127.0.0.1:{server.server_port}/"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        assert tools("pio", address) == "PlatformIO"
        server.shutdown()
        thread.join()
    assert tools("pio", address) == "avr-gcc, because PlatformIO's registry does not answer"
    assert tools(None, address) == "avr-gcc, because PlatformIO is not installed"
    for part in platformio._PLATFORM_PARTS:
        (tmp_path / part).mkdir(parents=True)
    assert tools("pio", address) == "PlatformIO"
    with monkeypatch.context() as patched:
        patched.setattr(os, "access", lambda *_: False)
        said = f"avr-gcc, because PlatformIO cannot write its folder {tmp_path}"
        assert tools("pio", address) == said


def test_platformio_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platformio, "find_platformio", lambda: None)
    with pytest.raises(UserError, match="PlatformIO\nit is not installed\nrun: pip install"):
        build_with_platformio()


def test_recipes_are_read_as_the_platform_writes_them(tmp_path: Path) -> None:
    platform = """
# tools
compiler.path=/opt/bin/
compiler.flags=-c {level}
recipe.c.o.pattern="{compiler.path}gcc" {compiler.flags} '-DNAME={name}' {includes} "{source_file}"
level=-O1
"""
    boards = (
        'one.name="An A=B"\none.build.core=x\none.build.variant=y\none.level=-Os\ntwo.level=-O3\n'
    )
    (tmp_path / "platform.txt").write_text(platform)
    (tmp_path / "boards.txt").write_text(boards)
    core = ArduinoCore(tmp_path, "one")
    command = core.command("c.o", {"includes": "-Ia '-Ib c'", "source_file": "my file.c"})
    assert command == [
        *("/opt/bin/gcc", "-c", "-Os", '-DNAME="An A=B"', "-Ia", "-Ib c", "my file.c")
    ]
    assert core.variant == tmp_path / "variants/y"
    assert properties("#a=1\nb = 2 \n\nc") == {"b": "2"}


def test_a_file_that_is_no_elf(tmp_path: Path) -> None:
    path = tmp_path / "firmware.elf"
    for content in (b"", b"\x7fELF\x02\x01" + bytes(60), b"text" * 40):
        path.write_bytes(content)
        with pytest.raises(UserError, match="cannot read"):
            elf.symbols(path)
    with pytest.raises(UserError, match="No such file"):
        elf.section_sizes(tmp_path / "none")
