"""robot.toml → typed configuration: the names that other rooms use."""

from host.config.cameras import Camera, Cameras, Strip
from host.config.filters import FilterSettings, PmbSettings
from host.config.lidar import BlindSector, Lidar
from host.config.link import LinkSettings
from host.config.mocap import Ceiling, Mocap, NatNet, OverheadCamera
from host.config.robot import RobotConfig, load_config, parse_config, recorded_config
from host.config.section import Section
from host.config.wheels import Board, Motors, Wheels

__all__ = [
    "BlindSector",
    "Board",
    "Camera",
    "Cameras",
    "Ceiling",
    "FilterSettings",
    "Lidar",
    "LinkSettings",
    "Mocap",
    "Motors",
    "NatNet",
    "OverheadCamera",
    "PmbSettings",
    "RobotConfig",
    "Section",
    "Strip",
    "Wheels",
    "load_config",
    "parse_config",
    "recorded_config",
]
