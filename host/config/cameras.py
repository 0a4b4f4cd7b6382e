"""The cameras' settings of robot.toml: pictures, lens and mounting, and the strip to look for."""

import math
from typing import Any, Literal

from pydantic import Field, model_validator

from host.config.section import Pictures, Section, contradiction


class Camera(Section):
    """One camera: where its pictures come from, its lens, its mounting in the robot frame.

    Pixel (0, 0) is the middle of the upper left one; x to the right, y down. A ray at the angle t
    from the axis meets the picture at the radius focal_px * (t + k1 t^3 + k2 t^5) ("equidistant")
    or focal_px * sin(t) ("orthographic", Perera 2021 eq. 34). The lens is known up to reach_rad off
    its axis. A bearing from farther off has beyond_noise_per_rad * (t - reach_rad)^2 of noise more.
    """

    source: Pictures = "none"
    width_px: int = Field(1920, ge=64, le=8192)
    height_px: int = Field(1080, ge=64, le=8192)
    rate_hz: float = Field(30.0, gt=0.0, le=240.0)
    lens: Literal["equidistant", "orthographic"] = "equidistant"
    focal_px: float = Field(611.15, gt=1.0, lt=10_000.0)
    centre_x_px: float = Field(959.5, gt=-10_000.0, lt=10_000.0)
    centre_y_px: float = Field(539.5, gt=-10_000.0, lt=10_000.0)
    k1: float = Field(0.0, gt=-1.0, lt=1.0)
    k2: float = Field(0.0, gt=-1.0, lt=1.0)
    reach_rad: float = Field(math.pi, gt=0.0, le=math.pi)
    beyond_noise_per_rad: float = Field(0.0, ge=0.0, le=10.0)
    x_m: float = Field(0.0, gt=-1.0, lt=1.0)
    y_m: float = Field(0.0, gt=-1.0, lt=1.0)
    z_m: float = Field(0.25, gt=0.0, lt=10.0)  # of the lens above the floor
    heading_rad: float = Field(0.0, ge=-math.pi, le=math.pi)
    tilt_rad: float = Field(0.7854, ge=-math.pi / 2, le=math.pi / 2)  # downward
    roll_rad: float = Field(0.0, ge=-math.pi, le=math.pi)  # clockwise, seen from behind

    @model_validator(mode="before")
    @classmethod
    def _centre_is_the_middle(cls, data: Any) -> Any:
        """Of a picture of another size, where a file does not say where it is."""
        if not isinstance(data, dict):
            return data
        middles = {
            centre: 0.5 * (data[size] - 1)
            for centre, size in (("centre_x_px", "width_px"), ("centre_y_px", "height_px"))
            if isinstance(data.get(size), int)
        }
        return {**middles, **data}

    @contradiction
    def _lens_before_the_picture(self) -> None:
        if 0.5 * min(self.width_px, self.height_px) > math.pi * self.focal_px:
            raise ValueError(
                f"focal_px ({self.focal_px:g}) is too short for {self.width_px} x "
                f"{self.height_px} px: it is in pixels, not mm"
            )
        if self.lens == "orthographic" and (self.k1 or self.k2):
            raise ValueError(
                'k1 and k2 are of lens = "equidistant": remove them, or change the lens'
            )
        for centre, size in (("centre_x_px", "width_px"), ("centre_y_px", "height_px")):
            if not -0.5 <= getattr(self, centre) <= getattr(self, size) - 0.5:
                raise ValueError(
                    f"{centre} ({getattr(self, centre):g}) must lie in the picture: {size} is "
                    f"{getattr(self, size)}; its middle is {0.5 * (getattr(self, size) - 1):g}"
                )


_ONE_COLOUR = {"height_m": 0.22, "tall_m": 0.04}  # the thesis' strip, where it differs
_COLOUR_KEYS = ("hue_deg", "hue_width_deg", "saturation_min", "value_min")


class Strip(Section):
    """The strip that teammates wear: a cylinder's coat.

    pattern: green over magenta, each half of tall_m ("two_colours"), or one colour in the range of
    HSV that the last four settings give ("one_colour", Perera 2021).
    """

    pattern: Literal["two_colours", "one_colour"] = "two_colours"
    height_m: float = Field(0.2, gt=0.0, lt=2.0)  # of its middle above the floor
    tall_m: float = Field(0.08, gt=0.001, lt=1.0)
    diameter_m: float = Field(0.1, gt=0.005, lt=1.0)
    hue_deg: float = Field(0.0, ge=0.0, lt=360.0)
    hue_width_deg: float = Field(40.0, gt=0.0, le=180.0)
    saturation_min: float = Field(0.45, ge=0.0, le=1.0)
    value_min: float = Field(0.12, ge=0.0, le=1.0)

    @model_validator(mode="before")
    @classmethod
    def _defaults_of_the_pattern(cls, data: Any) -> Any:
        """Fill in the pattern's own size. Files from before there were two name none.

        Where they give a colour they go on as they were; a size alone may be that of either.
        """
        if not isinstance(data, dict) or not data:
            return data
        if "pattern" not in data:
            if not any(key in data for key in _COLOUR_KEYS):
                raise ValueError(
                    'pattern is missing: write pattern = "one_colour" for the red strip, which was '
                    'the only one before, or "two_colours" for green over magenta'
                )
            data = {"pattern": "one_colour", **data}
        return {**_ONE_COLOUR, **data} if data["pattern"] == "one_colour" else data

    @contradiction
    def _above_the_floor(self) -> None:
        if self.height_m < 0.5 * self.tall_m:
            raise ValueError(
                f"height_m ({self.height_m}) of the strip's middle must be half of tall_m "
                f"({self.tall_m}) at least: it cannot reach below the floor"
            )

    @contradiction
    def _colours_are_used(self) -> None:
        given = [k for k in _COLOUR_KEYS if getattr(self, k) != type(self).model_fields[k].default]
        if self.pattern == "two_colours" and given:
            raise ValueError(
                f"{', '.join(given)} describe a strip of one colour: remove them, or write "
                'pattern = "one_colour"'
            )
        for key in ("saturation_min", "value_min"):
            if getattr(self, key) == 1.0:
                raise ValueError(f"{key} (1) must be less than 1: no pixel of a picture is beyond")


class Cameras(Section):
    """The cameras, as sensors of bearings, and what they look for.

    mains_hz: of the mains that the lamps are on; exposures are multiples of its half period.
    search_rate_hz: so many pictures of each camera a second are searched, at the most.
    """

    mains_hz: Literal[50, 60] = 50
    search_rate_hz: float = Field(15.0, ge=0.1, le=240.0)
    delay_s: float = Field(0.15, ge=0.0, le=2.0)
    bearing_noise_rad: float = Field(0.02, gt=0.0, lt=1.0)
    max_range_m: float = Field(6.0, gt=0.1, le=12.0)
    detection_probability: float = Field(0.9, gt=0.0, lt=1.0)
    half_range_m: float = Field(3.0, gt=0.1, lt=12.0)
    range_steepness_per_m: float = Field(5.0, gt=0.0, lt=100.0)
    clutter_per_rad: float = Field(0.05, gt=0.0, lt=100.0)  # false blobs per picture
    use_ranges: bool = True  # ranges from the size of a strip in the picture
    front: Camera = Camera()
    rear: Camera = Camera(heading_rad=math.pi)
    strip: Strip = Strip()

    @model_validator(mode="before")
    @classmethod
    def _rear_looks_back(cls, data: Any) -> Any:
        """Whatever else a file says of the rear camera."""
        if isinstance(data, dict) and isinstance(data.get("rear"), dict):
            data = {**data, "rear": {"heading_rad": math.pi, **data["rear"]}}
        return data
