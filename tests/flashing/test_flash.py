"""Flashing: the real avrdude, real bytes on pseudo-terminals, and each failure in words."""

import itertools
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from host.drivers import port_access
from host.drivers.romeo import ports as romeo_ports
from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import BOARD_ROMEO_V2, PROTOCOL_HASH, IdentityFrame
from host.drivers.serial_port import open_port
from host.errors import UserError
from host.flashing import flash as romeo_flash
from host.flashing import identity as romeo_identity
from host.flashing.build import build_with_avr_gcc
from host.flashing.firmware import Firmware
from host.flashing.flash import LOG, find_avrdude, flash
from host.flashing.identity import identity_of, in_words
from host.folders import build_folder
from host.simulation.devices import romeo_library
from host.simulation.devices import romeo_stand_in as romeo_device
from host.simulation.devices.romeo_elf import RomeoElf
from tests.flashing.romeo_machine import Machine
from tests.toolchain import needed

LEONARDO = {"vid": 0x2341, "pid": 0x8036}


@pytest.fixture(scope="module")
def firmware() -> Firmware:
    needed(find_avrdude)
    return needed(build_with_avr_gcc)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What nobody answers is not waited for; and nothing is plugged in."""
    monkeypatch.setattr(romeo_ports, "POLL_S", 0.005)
    monkeypatch.setattr(romeo_ports, "ACCESS_S", 0.0)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(list_ports, "comports", list)
    built = identity_of()
    monkeypatch.setattr(
        romeo_device, "VERSION", (built.version_major, built.version_minor, built.version_patch)
    )


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Machine]:
    with Machine(tmp_path) as running:
        monkeypatch.setattr(list_ports, "comports", running.comports)
        yield running


def failure(
    firmware: Firmware, port: str = "auto", read: Callable[[str], None] = lambda line: None
) -> UserError:
    with pytest.raises(UserError) as caught:
        flash(firmware, port, read)
    assert len(str(caught.value).splitlines()) <= 5
    return caught.value


def image(firmware: Firmware, folder: Path) -> bytes:
    """The flash as binutils sees it."""
    binary = folder / "image.bin"
    subprocess.run(["avr-objcopy", "-O", "binary", firmware.elf, binary], check=True)
    return binary.read_bytes()


def test_the_firmware_is_uploaded_byte_for_byte_and_read_back(
    machine: Machine, firmware: Firmware, tmp_path: Path
) -> None:
    lines: list[str] = []
    flashed = flash(firmware, "auto", lines.append)
    wanted = image(firmware, tmp_path)
    assert machine.bootloader.flash[: len(wanted)] == wanted
    assert machine.touches == 1
    assert flashed.port == str(machine.sketch.path)
    assert flashed.identity == identity_of()
    steps = ("found the board", "bootloader", "uploaded and verified", "has started")
    assert len(lines) == len(steps)
    assert all(step in line for step, line in zip(steps, lines, strict=True))
    assert "bytes of flash verified" in (build_folder() / LOG).read_text("utf-8")


def test_an_answer_that_came_while_this_computer_stood_still_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    times = itertools.chain([0.0, 0.0, 0.0, 0.0], itertools.repeat(60.0))
    answers = iter([b"", encode(identity_of())])
    monkeypatch.setattr(romeo_identity, "time", SimpleNamespace(monotonic=lambda: next(times)))
    monkeypatch.setattr(romeo_identity, "read_available", lambda port: next(answers))
    port = SimpleNamespace(write=len)
    assert romeo_identity._greet(port) == identity_of()


def test_what_avrdude_said_need_not_be_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The disk may be full, as the folder that is not there stands for: the board has it all."""
    monkeypatch.setattr(romeo_flash, "build_folder", lambda: tmp_path / "absent")
    romeo_flash.upload(["true"], tmp_path / "firmware.hex", "/dev/null")
    with pytest.raises(UserError) as caught:
        romeo_flash.upload(["false"], tmp_path / "firmware.hex", "/dev/null")
    assert caught.value.why == "it did not say why"


def test_a_board_in_its_bootloader_needs_no_touch(
    monkeypatch: pytest.MonkeyPatch, firmware: Firmware, tmp_path: Path
) -> None:
    with Machine(tmp_path, in_bootloader=True) as machine:
        monkeypatch.setattr(list_ports, "comports", machine.comports)
        link = tmp_path / "by-id"
        link.symlink_to(machine.loader.path)
        assert flash(firmware, str(link), lambda line: None).port == str(machine.sketch.path)
        assert machine.touches == 0


def test_the_real_firmware_follows_the_touch(
    monkeypatch: pytest.MonkeyPatch, firmware: Firmware, tmp_path: Path
) -> None:
    needed(romeo_library.load)
    elf = RomeoElf(firmware.elf)
    elf.run(0.2)

    def touched() -> bool:
        elf.open_port(1200)
        elf.run(elf.now + 0.05)
        elf.close_port(1200)
        elf.run(elf.now + 1.0)
        return elf.bootloader_asked

    assert not elf.bootloader_asked
    with Machine(tmp_path, obeys=touched) as machine:
        monkeypatch.setattr(list_ports, "comports", machine.comports)
        board = romeo_ports.find_board()
        assert romeo_flash.enter_bootloader(board, print).path == str(machine.loader.path)


def test_where_the_touch_does_nothing_the_reset_button_is_asked_for_and_waited_for(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    monkeypatch.setattr(romeo_flash, "BOOTLOADER_S", 0.3)
    machine.obeys = lambda: False
    lines: list[str] = []

    def read(line: str) -> None:
        lines.append(line)
        if "press the board's reset button" in line:
            machine.reset_button.set()
        if "uploaded" in line:
            machine.reset_button.clear()

    assert flash(firmware, "auto", read).identity == identity_of()
    assert len(lines) == 5


def test_another_board_in_its_bootloader_is_left_alone(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    other = SimpleNamespace(device="/dev/ttyACM9", vid=0x2341, pid=0x36, location="1-1.4:1.0")
    monkeypatch.setattr(list_ports, "comports", lambda: [other, *machine.comports()])
    flashed = flash(firmware, str(machine.sketch.path), lambda line: None)
    assert flashed.port == str(machine.sketch.path)


def test_no_board(firmware: Firmware) -> None:
    error = failure(firmware)
    assert error.what == "the board was not found"
    assert "2341:8036" in error.why
    assert "--port" in error.next_step


def test_several_boards(monkeypatch: pytest.MonkeyPatch, firmware: Firmware) -> None:
    ports = [SimpleNamespace(device=f"/dev/ttyACM{n}", **LEONARDO) for n in (0, 1)]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    error = failure(firmware)
    assert "/dev/ttyACM0, /dev/ttyACM1" in error.why
    assert "swarmloc flash --port PORT" in error.next_step


def test_a_port_that_is_not_there_or_another_devices(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware, tmp_path: Path
) -> None:
    error = failure(firmware, "/dev/none")
    assert str(error).startswith(f"there is no port /dev/none\nplugged in: {machine.sketch.path}")
    lidar = tmp_path / "ttyUSB0"
    lidar.touch()
    listed = SimpleNamespace(device=str(lidar), vid=0x10C4, pid=0xEA60)
    monkeypatch.setattr(list_ports, "comports", lambda: [listed])
    error = failure(firmware, str(lidar))
    assert error.what.endswith("is not the board")
    assert "10c4:ea60" in error.why


def test_no_permission_says_which_rules_to_paste(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    may = os.access
    forbidden = str(machine.sketch.path)
    monkeypatch.setattr(os, "access", lambda path, mode: path != forbidden and may(path, mode))
    error = failure(firmware)
    assert error.why == "this user may not use it, and no group may"
    _, command, reload = (line.strip() for line in error.next_step.splitlines())
    rules, tee = (shlex.split(part) for part in command.split(" | "))
    assert rules == ["swarmloc", "doctor", "--udev-rules"]
    assert tee == ["sudo", "tee", "/etc/udev/rules.d/60-swarmloc.rules"]
    assert shlex.split(reload) == ["sudo", "udevadm", "control", "--reload"]
    assert machine.touches == 0


@pytest.mark.parametrize(
    ("programs", "why"),
    [
        ({"7": ("ModemManager", True)}, "ModemManager takes it for a modem and holds it"),
        ({"7": ("ModemManager", False)}, "ModemManager takes it for a modem and holds it"),
        ({"7": ("ModemManager", False), "8": ("minicom", True)}, "minicom has it open"),
        (
            {"7": ("bash", False)},
            "another program has it open, likely ModemManager or a second swarmloc",
        ),
    ],
)
def test_a_port_that_another_program_holds(
    machine: Machine,
    monkeypatch: pytest.MonkeyPatch,
    firmware: Firmware,
    tmp_path: Path,
    programs: dict[str, tuple[str, bool]],
    why: str,
) -> None:
    processes = tmp_path / "proc"
    for number, (name, holds) in programs.items():
        (processes / number / "fd").mkdir(parents=True)
        (processes / number / "comm").write_text(f"{name}\n")
        if holds:
            (processes / number / "fd" / "3").symlink_to(os.path.realpath(machine.sketch.path))
    monkeypatch.setattr(port_access, "PROCESSES", processes)
    with open_port(str(machine.sketch.path), 115200):
        error = failure(firmware)
    assert error.why == why
    assert ("udev" in error.next_step) == why.startswith("ModemManager")
    assert machine.touches == 0


def test_the_program_that_holds_the_port_is_found(machine: Machine, firmware: Firmware) -> None:
    code = (
        "import sys, serial; port = serial.Serial(sys.argv[1], exclusive=True); "
        "print(flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(machine.sketch.path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        name = Path(f"/proc/{holder.pid}/comm").read_text("utf-8").strip()
        assert failure(firmware).why == f"{name} has it open"
        holder.communicate()


@pytest.mark.parametrize(
    ("gone", "why"), [(False, "the sketch still has"), (True, "gone from USB")]
)
def test_the_bootloader_does_not_appear(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware, gone: bool, why: str
) -> None:
    monkeypatch.setattr(romeo_flash, "BOOTLOADER_S", 0.3)
    monkeypatch.setattr(romeo_flash, "BUTTON_S", 0.3)
    machine.lost, machine.obeys = gone, lambda: False

    def read(line: str) -> None:
        end = time.monotonic() + 30.0  # the machine's thread may not have run yet
        while "reset button" in line and not (machine.touches and machine.sketch.plugged != gone):
            assert time.monotonic() < end
            time.sleep(0.01)

    error = failure(firmware, read=read)
    assert error.what == "the bootloader did not appear"
    assert why in error.why
    assert "press its reset button" in error.next_step
    assert machine.touches == 1


def test_avrdude_fails(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    machine.forgetful = True
    error = failure(firmware)
    assert error.what == "avrdude could not upload the firmware"
    assert error.why.startswith("what was read back from the board is not what was written")
    assert str(build_folder() / LOG) in error.why
    assert "verification mismatch" in (build_folder() / LOG).read_text("utf-8")


def test_the_bootloader_is_mute(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    monkeypatch.setattr(romeo_flash, "UPLOAD_S", 0.5)
    machine.mute = True
    error = failure(firmware)
    assert error.why.startswith("the bootloader did not answer")
    assert "press its reset button" in error.next_step


def test_avrdude_cannot_open_the_port(firmware: Firmware, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="the bootloader's port disappeared"):
        romeo_flash.upload(find_avrdude(), firmware.hex, str(tmp_path / "none"))


def test_the_firmware_does_not_start(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    monkeypatch.setattr(romeo_flash, "SKETCH_S", 0.3)
    machine.stuck = True
    error = failure(firmware)
    assert error.what == "the firmware was uploaded but has not started"
    assert error.why == "the board is still in its bootloader"


def test_the_version_or_the_protocol_did_not_change(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    monkeypatch.setattr(romeo_device, "VERSION", (0, 0, 9))
    machine.board.protocol_hash = 0x12345678
    error = failure(firmware)
    assert error.what == "the board does not run what was built"
    assert error.why == (
        "it runs firmware 0.0.9 with protocol 12345678 on a Romeo V2; "
        f"built was {in_words(identity_of())}"
    )


def test_the_board_says_nothing(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, firmware: Firmware
) -> None:
    monkeypatch.setattr(romeo_identity, "IDENTITY_S", 0.3)
    machine.board.silent = True
    error = failure(firmware)
    assert error.what == "the board does not introduce itself"
    assert error.why.startswith("it sent 0 bytes")


def test_avrdude_is_found_or_its_absence_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("PLATFORMIO_CORE_DIR", str(tmp_path))
    with pytest.raises(UserError, match="not installed\nrun: sudo apt-get install -y avrdude"):
        find_avrdude()
    tool = tmp_path / "packages/tool-avrdude"
    tool.mkdir(parents=True)
    for name in ("avrdude", "avrdude.conf"):
        (tool / name).touch()
    assert find_avrdude() == [f"{tool}/avrdude", f"-C{tool}/avrdude.conf"]


@pytest.fixture
def project(tmp_path: Path) -> Callable[[str, str], Path]:
    """A project with these two headers."""

    def make(version: str, protocol: str) -> Path:
        (tmp_path / "include").mkdir()
        (tmp_path / "include/version.h").write_text(version)
        (tmp_path / "include/protocol.h").write_text(protocol)
        return tmp_path

    return make


VERSION_H = "".join(
    f"#define FIRMWARE_VERSION_{part} {number}\n"
    for part, number in (("MAJOR", 3), ("MINOR", 14), ("PATCH", 15))
)


def test_what_was_built_is_read_from_its_sources(project: Callable[[str, str], Path]) -> None:
    folder = project(VERSION_H, f"#define PROTOCOL_HASH 0x{PROTOCOL_HASH:08x}UL\n")
    assert identity_of(folder) == IdentityFrame(PROTOCOL_HASH, 3, 14, 15, BOARD_ROMEO_V2, 2)


def test_a_stale_header_is_told_before_anything_is_uploaded(
    project: Callable[[str, str], Path],
) -> None:
    folder = project(VERSION_H, "#define PROTOCOL_HASH 0x00000001UL\n")
    with pytest.raises(UserError, match=r"00000001.*\nrun: python tools/generate_protocol.py"):
        identity_of(folder)


def test_a_header_without_a_version(project: Callable[[str, str], Path]) -> None:
    with pytest.raises(UserError, match="does not define PROTOCOL_HASH, FIRMWARE_VERSION_MAJOR"):
        identity_of(project("", ""))
    with pytest.raises(UserError, match="No such file"):
        identity_of(Path("/none"))
