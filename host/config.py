"""robot.toml → typed configuration: everything about one robot, in one strict file.

Units stand in the names (`_m`, `_rad`, `_s`, ...). An unknown key, a wrong unit or a value out
of range is an error that names the key, the line and the bound. Every value has a working default.
"""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from host.config_cameras import Camera, Cameras, Section, Strip, Text
from host.config_errors import NOT_REGISTERED, explain_settings, explain_toml
from host.config_link import LinkSettings
from host.config_mocap import Ceiling, Mocap, NatNet
from host.errors import UserError
from host.registry import BOARDS, FILTERS, LIDARS, Registry

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
    "PmbSettings",
    "RobotConfig",
    "Section",
    "Strip",
    "Wheels",
    "load_config",
    "parse_config",
    "recorded_config",
]


def _registered(registry: Registry) -> Callable[[str], str]:
    """A check that a name is in the registry."""

    def check(name: str) -> str:
        if name not in registry.names():
            known = ", ".join(registry.names())
            raise PydanticCustomError(
                NOT_REGISTERED,
                "no {kind} is called so; known: {known}; one of your own needs --plugin",
                {"kind": registry.kind, "known": known},
            )
        return name

    return check


class Wheels(Section):
    """The differential drive (Perera 2021 eq. 31–32) and the noise of its odometry.

    The noise is that of a random walk: its standard deviation grows with the square root of the
    distance driven or of the angle turned.
    """

    left_radius_m: float = Field(0.0325, gt=0.005, lt=0.5)
    right_radius_m: float = Field(0.0325, gt=0.005, lt=0.5)
    track_m: float = Field(0.144, gt=0.02, lt=2.0)
    counts_per_turn: int = Field(1920, ge=4, le=100_000)
    periods_per_turn: int = Field(960, ge=0, le=50_000)  # of an encoder channel; 0: not known
    distance_noise_m: float = Field(0.02, ge=0.0, lt=1.0)  # std after 1 m
    heading_noise_rad: float = Field(0.05, ge=0.0, lt=1.0)  # std of the heading after 1 rad
    drift_noise_rad: float = Field(0.0158, ge=0.0, lt=1.0)  # std of the heading after 1 m
    max_speed_mps: float = Field(0.4, gt=0.0, lt=5.0)
    max_turn_rate_radps: float = Field(3.0, gt=0.0, lt=50.0)


class Board(Section):
    """The board that counts ticks and drives the motors; port "auto": found by its USB ids."""

    model: Annotated[str, AfterValidator(_registered(BOARDS))] = "romeo"
    port: Text = "auto"
    report_rate_hz: int = Field(50, ge=10, le=100)


class Motors(Section):
    """Which motors and encoders are wired the other way round, and how speeds are controlled.

    The host sends these settings to the board at each connection. duty = (v + proportional * e +
    integral_per_s * sum of e over time) / full_speed, with the commanded speed v and the speed
    error e.
    """

    left_reversed: bool = False
    right_reversed: bool = False
    left_encoder_reversed: bool = False
    right_encoder_reversed: bool = False
    full_speed_mps: float = Field(0.54, gt=0.02, lt=5.0)  # at full duty, running freely
    proportional: float = Field(2.0, ge=0.0, lt=15.95)
    integral_per_s: float = Field(8.0, ge=0.0, lt=15.95)
    acceleration_mps2: float = Field(1.5, ge=0.05, le=20.0)
    runaway_s: float = Field(0.3, ge=0.0, le=60.0)  # 0: never, for boards without encoders


class BlindSector(Section):
    """A direction in which a pillar of the robot's own camera holder blocks the lidar's view."""

    centre_rad: float = Field(ge=-math.pi, le=math.pi)
    width_rad: float = Field(gt=0.0, lt=math.pi)


# TOML has lists; the configuration, which does not change, has tuples.
BlindSectors = Annotated[
    tuple[BlindSector, ...],
    BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value),
]


_LEAST_VIEW_RAD = 0.05


def _free_view(field_rad: float, sectors: tuple[BlindSector, ...]) -> float:
    """How much (rad) of a field of view, centred ahead, blind sectors leave."""
    free, end = 0.0, -0.5 * field_rad
    turned = [
        (s.centre_rad + whole - 0.5 * s.width_rad, s.centre_rad + whole + 0.5 * s.width_rad)
        for s in sectors
        for whole in (-math.tau, 0.0, math.tau)
    ]
    for first, last in [*sorted(turned), (0.5 * field_rad, 0.5 * field_rad)]:
        free += max(min(first, 0.5 * field_rad) - end, 0.0)
        end = max(end, last)
    return free


def _pillars() -> tuple[BlindSector, ...]:
    degrees = (45.0, 135.0, -135.0, -45.0)
    return tuple(
        BlindSector(centre_rad=round(math.radians(d), 4), width_rad=0.1047) for d in degrees
    )


class Lidar(Section):
    """The lidar: model, port, mounting in the robot frame, and what it sees of a teammate."""

    model: Annotated[str, AfterValidator(_registered(LIDARS))] = "x4"
    port: Text = "auto"
    x_m: float = Field(0.0, gt=-1.0, lt=1.0)
    y_m: float = Field(0.0, gt=-1.0, lt=1.0)
    heading_rad: float = Field(0.0, ge=-math.pi, le=math.pi)
    delay_s: float = Field(0.0, ge=-0.5, le=1.0)
    target_diameter_m: float = Field(0.065, gt=0.01, lt=1.0)
    range_noise_m: float = Field(0.0016, gt=0.0, lt=0.5)  # std of one sample at 1 m
    min_range_m: float = Field(0.12, ge=0.0, lt=5.0)
    max_range_m: float = Field(2.5, gt=0.1, le=12.0)  # detections beyond are not used
    field_of_view_rad: float = Field(math.tau, gt=0.0, le=math.tau)  # centred ahead
    detection_probability: float = Field(0.95, gt=0.0, lt=1.0)  # close by, in plain view
    half_range_m: float = Field(3.2, gt=0.1, lt=1000.0)  # where it has fallen to one half
    range_steepness_per_m: float = Field(6.0, gt=0.0, lt=100.0)
    clutter_per_m2: float = Field(0.02, gt=0.0, lt=100.0)  # false detections per revolution
    blind_sectors: BlindSectors = Field(default_factory=_pillars)

    @model_validator(mode="after")
    def _ranges_and_a_view(self) -> Self:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"min_range_m ({self.min_range_m}) must be less than max_range_m "
                f"({self.max_range_m}): as it is, nothing is ever seen"
            )
        if _free_view(self.field_of_view_rad, self.blind_sectors) < _LEAST_VIEW_RAD:
            raise ValueError(
                "blind_sectors hide all of field_of_view_rad: as it is, nothing is ever seen"
            )
        return self


class PmbSettings(Section):
    """What `pmb` and `phd` take teammates and the things around them for (docs/filters.md)."""

    speed_mps: float = Field(0.2, gt=0.0, le=5.0)  # of teammates that move, std per axis
    appear_per_m2_s: float = Field(0.01, gt=0.0, lt=100.0)  # things that appear
    obstacle_share: float = Field(0.9, ge=0.0, lt=1.0)  # of the things that appear
    report_error_m: float = Field(0.5, gt=0.0, lt=100.0)  # an error as bad as no report


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


class FilterSettings(Section):
    """Which filter runs, and its settings (chosen in docs/filters.md)."""

    profile: Annotated[str, AfterValidator(_registered(FILTERS))] = "pmb"
    survival_range_m: float = Field(2.5, gt=0.1, le=50.0)  # beyond, teammates fade in about 1 s
    survival_s: float = Field(30.0, gt=0.1, le=1e6)  # mean time before an unseen teammate fades
    forget_weight: float = Field(0.15, gt=0.0, lt=1.0)  # of `phd`: kept in the report until then
    gate: float = Field(25.0, gt=1.0, le=100.0)  # squared Mahalanobis
    pmb: PmbSettings = PmbSettings()


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


def recorded_config(content: dict[str, Any]) -> RobotConfig:
    """The configuration of a recording, without settings that filters had once.

    Raises pydantic's ValidationError for anything else that it cannot be.
    """
    settings = content.get("filter")
    if isinstance(settings, dict):
        kept = {key: value for key, value in settings.items() if key not in _ONCE_OF_FILTERS}
        content = {**content, "filter": kept}
    return RobotConfig.model_validate(content)


def load_config(path: str | Path) -> RobotConfig:
    """Read robot.toml. Raises UserError naming key, line and bound for whatever is wrong in it."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"cannot read the configuration {path}",
            error.strerror or str(error),
            "write one with `swarmloc init FILE` and pass it with --robot FILE",
        ) from error
    except UnicodeDecodeError as error:
        raise UserError(
            f"{path}, line {error.object.count(10, 0, error.start) + 1}: no text in UTF-8",
            f"byte {error.start} is not",
            "save it as UTF-8",
        ) from error
    return parse_config(text, str(path))


def parse_config(text: str, name: str = "robot.toml") -> RobotConfig:
    """Check and convert the text of a robot.toml; `name` is what errors call it."""
    try:
        return RobotConfig.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{name} is not valid TOML", explain_toml(error, text)) from error
    except RecursionError as error:
        raise UserError(
            f"{name} cannot be read",
            "brackets or tables are nested hundreds deep",
            "write it as in robots/cherokey.toml",
        ) from error
    except ValidationError as error:
        lines = explain_settings(error, RobotConfig, text)
        raise UserError(
            f"{name}: {len(lines)} setting(s) cannot be used", "\n".join(lines[:5])
        ) from error
