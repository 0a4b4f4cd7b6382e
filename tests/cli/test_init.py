"""`swarmloc init` as its user sees it."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner, Result
from serial.tools import list_ports

from host.cli.main import main
from host.config import RobotConfig, load_config
from host.sources import discovery

EXAMPLE = Path(__file__).resolve().parents[2] / "robots/cherokey.toml"


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def init(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["init", *arguments])


def test_the_commented_example_is_written_with_the_next_steps(here: Path) -> None:
    done = init()
    assert (done.exit_code, done.stderr) == (0, "")
    assert (here / "robot.toml").read_bytes() == EXAMPLE.read_bytes()
    assert load_config(here / "robot.toml") == RobotConfig()
    assert "swarmloc run --simulate arena4 --robot robot.toml\n" in done.output
    assert "swarmloc flash\n" in done.output


def test_a_file_that_exists_is_left_as_it_is(here: Path) -> None:
    (here / "mine.toml").write_text("name = 'mine'\n")
    done = init("mine.toml")
    assert (done.exit_code, done.stdout) == (1, "")
    assert "mine.toml was not written\nit exists already\n" in done.stderr
    assert (here / "mine.toml").read_text() == "name = 'mine'\n"


def test_a_folder_that_is_not_there_is_reported() -> None:
    done = init("nowhere/robot.toml")
    assert done.exit_code == 1
    assert "cannot write nowhere/robot.toml\nNo such file or directory\n" in done.stderr


def test_settings_and_devices_go_into_a_file_new_or_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = tmp_path / "dev"
    for name, target in (
        ("serial/by-path/pci-usb-0:1:1.0", "ttyACM0"),
        ("serial/by-path/pci-usbv2-0:1:1.0", "ttyACM0"),
        ("serial/by-path/pci-usb-0:2:1.0-port0", "ttyUSB0"),
        ("v4l/by-path/pci-usb-0:3:1.0-video-index0", "video0"),
        ("v4l/by-path/pci-usb-0:3:1.0-video-index1", "video1"),
        ("v4l/by-path/pci-usb-0:4:1.0-video-index0", "video2"),
    ):
        (devices / name).parent.mkdir(parents=True, exist_ok=True)
        (devices / target).touch()
        (devices / name).symlink_to(devices / target)
    ports = [
        SimpleNamespace(device=str(devices / "ttyACM0"), vid=0x2341, pid=0x8036),
        SimpleNamespace(device=str(devices / "ttyUSB0"), vid=0x10C4, pid=0xEA60),
        SimpleNamespace(device=str(devices / "ttyS0"), vid=None, pid=None),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    monkeypatch.setattr(discovery.found_devices, "__defaults__", (devices,))
    file = tmp_path / "robot.toml"
    command = ["init", str(file), "--find", "--set", "name=robot7", "--set", "wheels.track_m=0.2"]
    first = CliRunner().invoke(main, command)
    assert first.exit_code == 0, first.output
    robot = load_config(file)
    assert (robot.name, robot.wheels.track_m) == ("robot7", 0.2)
    assert robot.board.port == str(devices / "serial/by-path/pci-usb-0:1:1.0")
    assert robot.lidar.port.endswith("pci-usb-0:2:1.0-port0")
    assert robot.camera.front.source.endswith("pci-usb-0:3:1.0-video-index0")
    assert robot.camera.rear.source.endswith("pci-usb-0:4:1.0-video-index0")
    text = file.read_text("utf-8")
    again = CliRunner().invoke(main, command)
    assert again.exit_code == 0
    assert file.read_text("utf-8") == text
    wrong = CliRunner().invoke(main, ["init", str(file), "--set", "nam=robot8"])
    assert wrong.exit_code == 2


def test_the_links_key_is_not_shown(tmp_path: Path) -> None:
    file, figures = tmp_path / "robot.toml", tmp_path / "figures.json"
    command = ["init", str(file), "--set", "link.key=0123456789abcdef", "--json", str(figures)]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    assert "0123456789" in file.read_text()
    assert "0123456789" not in done.output + figures.read_text()
