"""Finding and opening ports: every failure in words, with the next step."""

import errno
import grp
import os
import threading
import tty
import types
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from serial.tools import list_ports

from host.config import RobotConfig
from host.drivers import port_access, serial_port
from host.drivers.reconnect import keep_connected
from host.drivers.romeo.ports import boards
from host.drivers.serial_port import (
    explain,
    find_port,
    open_port,
    read_available,
)
from host.errors import UserError
from host.sources.discovery import found_devices

IDS = ((0x10C4, 0xEA60),)


@pytest.fixture
def terminal() -> tuple[int, str]:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    return ours, os.ttyname(theirs)


def plug(monkeypatch: pytest.MonkeyPatch, *devices: tuple[str, int | None, int | None]) -> None:
    ports = [SimpleNamespace(device=d, vid=vid, pid=pid) for d, vid, pid in devices]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)


def test_the_only_port_with_the_id_is_found_by_its_lasting_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    device = tmp_path / "ttyUSB3"
    device.touch()
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-Silicon_Labs-if00").symlink_to(device)
    monkeypatch.setattr(serial_port, "BY_ID", by_id)
    plug(monkeypatch, ("/dev/ttyS0", None, None), (str(device), *IDS[0]), ("/dev/ttyACM0", 1, 2))
    assert find_port("lidar", IDS, "auto") == str(by_id / "usb-Silicon_Labs-if00")
    assert find_port("lidar", IDS, "/dev/mine") == "/dev/mine"
    monkeypatch.setattr(serial_port, "BY_ID", tmp_path / "absent")
    assert find_port("lidar", IDS, "auto") == str(device)


def test_no_port_and_several_ports_are_told_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch, ("/dev/ttyACM0", 1, 2))
    with pytest.raises(UserError, match=r"lidar was not found\n.*10c4:ea60.*\n.*robot.toml"):
        find_port("lidar", IDS, "auto")
    plug(monkeypatch, ("/dev/ttyUSB0", *IDS[0]), ("/dev/ttyUSB1", *IDS[0]))
    with pytest.raises(UserError, match=r"ttyUSB0, .*ttyUSB1\n.*\[lidar\] of robot.toml"):
        find_port("lidar", IDS, "auto")


def test_a_port_that_is_unplugged_while_ports_are_listed_is_not_found_and_no_fault_of_ours(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As pyserial 3.5 fails where a file of the device vanishes between two that it reads."""
    monkeypatch.setattr(list_ports, "comports", lambda: int(None, 16))
    with pytest.raises(UserError, match="lidar was not found"):
        find_port("lidar", IDS, "auto")
    assert boards() == []
    assert found_devices(RobotConfig(), tmp_path) == {}


def test_a_port_is_for_one_program(terminal: tuple[int, str]) -> None:
    ours, path = terminal
    with open_port(path, 128_000, dtr=False) as port:
        os.write(ours, b"abc")
        assert read_available(port, 1.0) == b"abc"
        assert read_available(port, 0.0) == b""
        with pytest.raises(UserError, match="another program has it open, likely ModemManager"):
            open_port(path, 128_000)
    open_port(path, 128_000).close()


def test_an_unplugged_port_raises(terminal: tuple[int, str]) -> None:
    ours, path = terminal
    with open_port(path, 128_000) as port:
        os.close(ours)
        with pytest.raises(OSError) as caught:  # noqa: PT011 (which one depends on the adapter)
            read_available(port, 1.0)
    assert "unplugged" in explain(caught.value) or "plugged in" in explain(caught.value)


def test_a_missing_device_and_a_file_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such device is plugged in"):
        open_port(str(tmp_path / "absent"), 128_000)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(UserError, match="not a serial port"):
        open_port(str(file), 128_000)


def test_a_port_that_no_system_can_open_is_told_in_words() -> None:
    with pytest.raises(UserError, match=r"cannot open 'tty\\x00'\n.*\ncheck port in robot.toml"):
        open_port("tty\0", 128_000)


@pytest.mark.parametrize(
    ("mode", "names_group", "says"),
    [
        (0o660, "dialout", r"not in the group dialout\nrun: sudo usermod -aG dialout \$USER"),
        (0o660, "root", r"no group may\npaste this(.|\n)*udev"),
        (0o600, "dialout", r"no group may\npaste this(.|\n)*udev"),
    ],
)
def test_a_forbidden_port_names_the_group(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, mode: int, names_group: str, says: str
) -> None:
    def refuse(self: serial.Serial) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port")

    def stat(path: str) -> object:
        return types.SimpleNamespace(st_mode=mode, st_gid=grp.getgrnam(names_group).gr_gid)

    monkeypatch.setattr(serial.Serial, "open", refuse)
    monkeypatch.setattr(port_access.os, "stat", stat)
    with pytest.raises(UserError, match=says):
        open_port("/dev/ttyUSB0", 128_000)


def test_connecting_goes_on_until_stopped() -> None:
    stop, told, tries = threading.Event(), list[str](), iter(range(4))

    def serve() -> None:
        number = next(tries)
        if number == 0:
            raise UserError("not there")
        if number == 1:
            raise OSError(errno.EIO, "input/output error")
        if number == 3:
            stop.set()

    keep_connected(serve, lambda error: told.append(str(error)), stop, retry_s=0.0)
    assert told[0] == "not there"
    assert told[1].startswith("the connection was lost\nthe device was unplugged")
    assert len(told) == 2

    def broken() -> None:
        raise ZeroDivisionError

    stop.clear()
    with pytest.raises(ZeroDivisionError):
        keep_connected(broken, lambda error: None, stop, retry_s=0.0)
