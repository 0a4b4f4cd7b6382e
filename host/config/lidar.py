"""The settings of the lidar in robot.toml."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field

from host.config.section import Port, Section, contradiction, listed, registered
from host.registry import LIDARS


class BlindSector(Section):
    """A direction in which a pillar of the robot's own camera holder blocks the lidar's view."""

    centre_rad: float = Field(ge=-math.pi, le=math.pi)
    width_rad: float = Field(gt=0.0, lt=math.pi)


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

    model: Annotated[str, AfterValidator(registered(LIDARS))] = "x4"
    port: Port = "auto"
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
    blind_sectors: Annotated[tuple[BlindSector, ...], listed] = Field(default_factory=_pillars)

    @contradiction
    def _ranges_and_a_view(self) -> None:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"min_range_m ({self.min_range_m}) must be less than max_range_m "
                f"({self.max_range_m}): with these values nothing is ever detected"
            )
        if self.half_range_m <= self.min_range_m:
            raise ValueError(
                f"half_range_m ({self.half_range_m}) must be more than min_range_m "
                f"({self.min_range_m}): with these values hardly anything is ever detected"
            )
        if self.range_noise_m >= self.target_diameter_m:
            raise ValueError(
                f"range_noise_m ({self.range_noise_m}) must be less than target_diameter_m "
                f"({self.target_diameter_m}): no turret is recognized in such noise"
            )
        if _free_view(self.field_of_view_rad, self.blind_sectors) < _LEAST_VIEW_RAD:
            raise ValueError(
                "blind_sectors hide all of field_of_view_rad: nothing is ever detected"
            )
