"""Which devices are plugged in, by the names of their sockets: what robot.toml calls them."""

import os
from collections.abc import Collection, Mapping
from pathlib import Path

from host.config import RobotConfig
from host.drivers.romeo.ports import SKETCH_IDS
from host.drivers.serial_port import usb_ports
from host.drivers.x4.device import USB_IDS

DEVICES = Path("/dev")


def found_devices(known: RobotConfig, devices: Path = DEVICES) -> dict[str, str]:
    """Settings, by dotted key, of devices that are plugged in and not in robot.toml.

    A port or a camera that it names and that is there stays. Several of a kind stay unnamed, but
    cameras: the first one is taken for the front one. devices: the folder /dev.
    """
    found: dict[str, str] = {}
    for key, port, ids in (
        ("board.port", known.board.port, SKETCH_IDS),
        ("lidar.port", known.lidar.port, USB_IDS),
    ):
        paths = _ports(ids, devices)
        if len(paths) == 1 and not os.path.exists(port):
            found[key] = paths[0]
    return found | _cameras(known, devices)


def _cameras(known: RobotConfig, devices: Path) -> dict[str, str]:
    named: Mapping[str, str] = {
        "camera.front.source": known.camera.front.source,
        "camera.rear.source": known.camera.rear.source,
    }
    there = {os.path.realpath(path) for path in named.values() if os.path.exists(path)}
    plugged = sorted((devices / "v4l/by-path").glob("*video-index0"))
    free = [str(path) for path in plugged if os.path.realpath(path) not in there]
    missing = [key for key, path in named.items() if not os.path.exists(path)]
    return dict(zip(missing, free, strict=False))


def _ports(ids: Collection[tuple[int, int]], devices: Path) -> list[str]:
    """Names of the sockets in which such devices are."""
    return sorted(
        _by_path(port.device, devices) for port in usb_ports() if (port.vid, port.pid) in ids
    )


def _by_path(device: str, devices: Path) -> str:
    """The name of the device's USB socket, which no other one of its kind has; else its own."""
    target = os.path.realpath(device)
    links = sorted((devices / "serial/by-path").glob("*"))
    # Newer systems give two links, of which the one without "usbv2" is the one that all have.
    same = [link for link in links if os.path.realpath(link) == target]
    plain = [link for link in same if "usbv" not in link.name]
    return str((plain or same or [Path(device)])[0])
