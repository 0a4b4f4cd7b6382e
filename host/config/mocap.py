"""The settings of motion capture in robot.toml: a NatNet server, or a camera under the ceiling."""

import ipaddress
import math
import re
from typing import Annotated, Literal

from pydantic import Field

from host.config.cameras import Camera
from host.config.section import Section, Text, contradiction, listed

# A name on the network, or an address of four numbers up to 255.
_HOST = re.compile(r"((25[0-5]|2[0-4]\d|1?\d?\d)(\.(?!$)|$)){4}|(?![\d.]+$)[\w.-]+")


class NatNet(Section):
    """Where the motion capture's server (Motive) streams from, and how."""

    server: Text = "192.168.0.100"
    connection: Literal["multicast", "unicast"] = "multicast"
    multicast_group: Text = "239.255.42.99"
    command_port: int = Field(1510, ge=1, le=65535)
    data_port: int = Field(1511, ge=1, le=65535)
    up: Literal["y", "z"] = "y"  # the vertical axis in Motive

    @contradiction
    def _ports_and_group(self) -> None:
        if self.command_port == self.data_port:
            raise ValueError(f"data_port must differ from command_port ({self.command_port})")
        if not _HOST.fullmatch(self.server) or _is_no_computer(self.server):
            raise ValueError(
                f"server ({self.server}) must be the address or the name of the computer with "
                "Motive, as 192.168.0.100"
            )
        try:
            multicast = ipaddress.IPv4Address(self.multicast_group).is_multicast
        except ValueError:
            multicast = False
        if not multicast:
            raise ValueError(
                f"multicast_group ({self.multicast_group}) must be an address of multicast, "
                "224.0.0.0 to 239.255.255.255, as Motive shows it"
            )


def _is_no_computer(server: str) -> bool:
    """Whether it is an address of many computers, or of none."""
    try:
        address = ipaddress.IPv4Address(server)
    except ValueError:
        return False
    return address.is_unspecified or address.is_multicast or server == "255.255.255.255"


class OverheadCamera(Camera):
    """A camera under the ceiling: its mounting is that in the floor's frame."""

    focal_px: float = Field(1400.0, gt=1.0, lt=10_000.0)
    x_m: float = Field(0.0, gt=-20.0, lt=20.0)
    y_m: float = Field(0.0, gt=-20.0, lt=20.0)
    z_m: float = Field(2.5, gt=0.0, lt=20.0)
    tilt_rad: float = Field(math.pi / 2, ge=0.0, le=math.pi / 2)


class Ceiling(Section):
    """A camera under the ceiling that sees ArUco tags on the robots.

    eye: the camera; unless a file says otherwise it is 2.5 m up and looks down.
    delay_s: from an exposure to the picture's time stamp, or to its arrival where it has none.
    mains_hz: of the mains that the lamps are on, see `Cameras`.
    """

    mains_hz: Literal[50, 60] = 50
    delay_s: float = Field(0.0, ge=0.0, le=2.0)
    eye: OverheadCamera = OverheadCamera()
    tag_m: float = Field(0.1, gt=0.005, lt=2.0)  # side of a tag's black square
    tag_height_m: float = Field(0.3, ge=0.0, lt=5.0)  # above the floor
    dictionary: Literal["4X4_50", "4X4_100", "5X5_100", "6X6_250"] = "4X4_50"

    @contradiction
    def _tags_below(self) -> None:
        if self.tag_height_m >= self.eye.z_m:
            raise ValueError(
                f"tag_height_m ({self.tag_height_m}) must be less than eye.z_m ({self.eye.z_m}): "
                "the camera looks down on the tags"
            )


class Turret(Section):
    """Where the middle of a teammate's turret is in the frame of its tracked body, `body`."""

    body: int = Field(ge=0, le=2**31 - 1)
    x_m: float = Field(gt=-0.5, lt=0.5)
    y_m: float = Field(gt=-0.5, lt=0.5)


class Mocap(Section):
    """Motion capture: the truth for calibration and evaluation, never for the estimate.

    body: the number of this robot's own body (streaming id, tag); x_m, y_m, heading_rad: where
    that body's origin and x-axis are in the robot frame. Other bodies are teammates, with their
    origins above the middle of their turrets, or where `turrets` say.
    """

    source: Literal["none", "natnet", "ceiling"] = "none"
    body: int = Field(1, ge=0, le=2**31 - 1)
    x_m: float = Field(0.0, gt=-1.0, lt=1.0)
    y_m: float = Field(0.0, gt=-1.0, lt=1.0)
    heading_rad: float = Field(0.0, ge=-math.pi, le=math.pi)
    turrets: Annotated[tuple[Turret, ...], listed] = ()
    natnet: NatNet = NatNet()
    ceiling: Ceiling = Ceiling()

    @contradiction
    def _each_turret_once(self) -> None:
        numbers = [turret.body for turret in self.turrets]
        if len(set(numbers)) < len(numbers) or self.body in numbers:
            raise ValueError(
                f"[[mocap.turrets]] has bodies {', '.join(map(str, numbers))}: each is another "
                f"teammate's, and {self.body} is this robot"
            )

    @contradiction
    def _tags_exist(self) -> None:
        tags = int(self.ceiling.dictionary.rpartition("_")[2])
        beyond = [
            number for number in (self.body, *(t.body for t in self.turrets)) if number >= tags
        ]
        if self.source == "ceiling" and beyond:
            raise ValueError(
                f"body {beyond[0]} is no tag of ceiling.dictionary ({self.ceiling.dictionary}): "
                f"its tags are 0 to {tags - 1}"
            )
