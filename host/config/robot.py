"""robot.toml → typed configuration: everything about one robot, in one strict file.

Units stand in the names (`_m`, `_rad`, `_s`, ...). An unknown key, a wrong unit or a value out
of range is an error that names the key, the line and the bound. Every value has a working default.
"""

import math
import os
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from host.config.cameras import Cameras
from host.config.errors import explain_settings
from host.config.filters import FilterSettings
from host.config.lidar import Lidar
from host.config.link import LinkSettings
from host.config.mocap import Mocap
from host.config.section import RECORDED, Section, Text, contradiction
from host.config.syntax import explain_toml
from host.config.wheels import Board, Motors, Wheels
from host.errors import UserError

# Settings of `phd` before it had a velocity; recordings of that time hold them.
_ONCE_OF_FILTERS = (
    "motion_noise_m",
    "motion_growth_per_s",
    "obstacle_share",
    "birth_per_m2",
    "report_weight",
    "report_sigma_m",
    "prune_weight",
    "merge_distance",
    "capacity",
)
_FARTHEST_TRACKS = 3  # of a sensor from the origin: robots are hardly longer
_FASTEST_TURN = 4.0  # times what the motors can do: more is deg/s
_LARGEST_FILE = 1_000_000  # characters
_SAME_VIEW_RAD = 0.1  # between the front and the rear camera: less is a slip


class RobotConfig(Section):
    """robot.toml: one robot."""

    name: Text = "cherokey"
    wheels: Wheels = Wheels()
    motors: Motors = Motors()
    board: Board = Board()
    lidar: Lidar = Lidar()
    camera: Cameras = Cameras()
    filter: FilterSettings = FilterSettings()
    mocap: Mocap = Mocap()
    link: LinkSettings = LinkSettings()

    @contradiction
    def _a_port_for_each(self) -> None:
        first: dict[str, str] = {}
        for key, port in (
            ("board.port", self.board.port),
            ("lidar.port", self.lidar.port),
            ("camera.front.source", self.camera.front.source),
            ("camera.rear.source", self.camera.rear.source),
            ("mocap.ceiling.eye.source", self.mocap.ceiling.eye.source),
        ):
            device = os.path.realpath(port)  # it may have several names
            if port not in ("auto", "none") and first.setdefault(device, key) != key:
                raise ValueError(f"{key} is that of {first[device]}, too ({port})")
        frames_come_to = self.mocap.natnet.data_port if self.mocap.source == "natnet" else None
        if self.link.on and self.link.port == frames_come_to:
            raise ValueError(f"link.port is that of mocap.natnet.data_port, too ({frames_come_to})")

    @contradiction
    def _two_views(self) -> None:
        front, rear = self.camera.front, self.camera.rear
        apart = math.remainder(front.heading_rad - rear.heading_rad, math.tau)
        if "none" not in (front.source, rear.source) and abs(apart) < _SAME_VIEW_RAD:
            raise ValueError(
                f"camera.front.heading_rad ({front.heading_rad:g}) and camera.rear.heading_rad "
                f"({rear.heading_rad:g}) must differ: as it is, both look the same way"
            )

    @contradiction
    def _sensors_are_on_the_robot(self) -> None:
        most = _FARTHEST_TRACKS * self.wheels.track_m
        for name, part in (
            ("lidar", self.lidar),
            ("camera.front", self.camera.front),
            ("camera.rear", self.camera.rear),
            ("mocap", self.mocap),
        ):
            distance = math.hypot(part.x_m, part.y_m)
            if distance > most:
                raise ValueError(
                    f"{name}.x_m ({part.x_m:g}) and {name}.y_m ({part.y_m:g}) are {distance:.3g} m "
                    f"from the robot's origin, more than {_FARTHEST_TRACKS} times wheels.track_m "
                    f"({self.wheels.track_m:g}): they are in m, in the robot frame"
                )

    @contradiction
    def _motors_are_fast_enough(self) -> None:
        wheels, full = self.wheels, self.motors.full_speed_mps
        if wheels.max_speed_mps > full:
            raise ValueError(
                f"wheels.max_speed_mps ({wheels.max_speed_mps:g}) must be motors.full_speed_mps "
                f"({full:g}) at most: no wheel is faster"
            )
        if 0.5 * wheels.track_m * wheels.max_turn_rate_radps > _FASTEST_TURN * full:
            raise ValueError(
                f"wheels.max_turn_rate_radps ({wheels.max_turn_rate_radps:g}) is far beyond "
                f"motors.full_speed_mps ({full:g}): it is in rad/s, not deg/s"
            )

    @contradiction
    def _something_is_seen_to_the_end(self) -> None:
        if self.filter.survival_range_m <= self.lidar.min_range_m:
            raise ValueError(
                f"filter.survival_range_m ({self.filter.survival_range_m:g}) must be more than "
                f"lidar.min_range_m ({self.lidar.min_range_m:g}): else teammates fade at once"
            )
        mains, ceiling = self.camera.mains_hz, self.mocap.ceiling
        seen = {self.camera.front.source, self.camera.rear.source} != {"none"}
        if seen and self.mocap.source == "ceiling" and ceiling.mains_hz != mains:
            raise ValueError(
                f"camera.mains_hz ({mains}) and mocap.ceiling.mains_hz ({ceiling.mains_hz}) must "
                "be equal: the lamps are the same"
            )


def recorded_config(content: dict[str, Any]) -> RobotConfig:
    """The configuration of a recording, without settings that filters had once.

    Contradictions between settings are kept: what was recorded under them stays readable. Raises
    pydantic's ValidationError for anything else that it cannot be.
    """
    settings = content.get("filter")
    if isinstance(settings, dict):
        kept = {key: value for key, value in settings.items() if key not in _ONCE_OF_FILTERS}
        content = {**content, "filter": kept}
    return RobotConfig.model_validate(content, context=RECORDED)


def load_config(path: str | Path) -> RobotConfig:
    """Read robot.toml. Raises UserError naming key, line and bound for whatever is wrong in it."""
    try:
        with Path(path).open(encoding="utf-8") as file:
            text = file.read(_LARGEST_FILE + 1)
    except OSError as error:
        raise UserError(
            f"cannot read the configuration {path}",
            error.strerror or str(error),
            "write one with `swarmloc init FILE` and pass it with --robot FILE",
        ) from error
    except UnicodeDecodeError as error:
        raise UserError(
            f"{path}, line {error.object.count(10, 0, error.start) + 1}: no text in UTF-8",
            f"byte {error.start} is not"
            + ("; it looks like UTF-16" if error.object[:2] in (b"\xff\xfe", b"\xfe\xff") else ""),
            "save it as UTF-8",
        ) from error
    if len(text) > _LARGEST_FILE:
        raise UserError(
            f"cannot read the configuration {path}",
            f"it is longer than {_LARGEST_FILE} characters, and no robot.toml is",
            "name a robot.toml with --robot FILE",
        )
    return parse_config(text, str(path))


def parse_config(text: str, name: str = "robot.toml") -> RobotConfig:
    """Check and convert the text of a robot.toml; `name` is what errors call it."""
    try:
        return RobotConfig.model_validate(tomllib.loads(text))
    except ValidationError as error:
        raise UserError(
            f"{name}: {error.error_count()} setting(s) cannot be used",
            explain_settings(error, RobotConfig, text),
        ) from error
    except ValueError as error:  # TOML's own, or a whole number of thousands of digits
        raise UserError(f"{name} is not valid TOML", explain_toml(error, text)) from error
    except RecursionError as error:
        raise UserError(
            f"{name} cannot be read",
            "brackets or tables are nested hundreds deep",
            "write it as in robots/cherokey.toml",
        ) from error
