"""The settings of the wheels, the board that drives them and its motors, in robot.toml."""

from typing import Annotated

from pydantic import AfterValidator, Field

from host.config.section import Port, Section, contradiction, registered
from host.registry import BOARDS

_LARGEST_RADIUS_RATIO = 1.5  # of a robot's left and right wheels


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

    @contradiction
    def _one_robot(self) -> None:
        small, large = sorted((self.left_radius_m, self.right_radius_m))
        if large > _LARGEST_RADIUS_RATIO * small:
            raise ValueError(
                f"left_radius_m ({self.left_radius_m}) and right_radius_m ({self.right_radius_m}) "
                "differ too much for one robot: is one of them a diameter?"
            )
        if large >= self.track_m:
            raise ValueError(
                f"track_m ({self.track_m}) must be more than the radius of a wheel ({large}): it "
                "is the distance between the left and the right wheels"
            )
        if self.counts_per_turn < self.periods_per_turn:
            raise ValueError(
                f"counts_per_turn ({self.counts_per_turn}) must be periods_per_turn "
                f"({self.periods_per_turn}) at least; 0 periods: not known"
            )


class Board(Section):
    """The board that counts ticks and drives the motors; port "auto": found by its USB ids."""

    model: Annotated[str, AfterValidator(registered(BOARDS))] = "romeo"
    port: Port = "auto"
    report_rate_hz: int = Field(50, ge=10, le=100)


class Motors(Section):
    """Which motors and encoders are reversed, and how speeds are controlled.

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
