"""What a search for strips finds in a picture."""

import math
from dataclasses import dataclass

from host.config import Strip

_PIXEL_STD = 0.1  # std of a strip's middle in reduced pixels
_RANGE_SHARE, _RANGE_PIXELS = 0.1, 0.7  # std of a range by size: of itself; over sqrt(pixels)


@dataclass(frozen=True, slots=True)
class Blob:
    """Something in the strip's colour. x, y (its middle), width, height, area_px: full-size px.

    kept: may be a teammate; reason: why not. bearing_rad in the robot frame, from the camera's
    place, with variance_rad2 (without the camera's own noise). range_m: what its size says of the
    distance from the lens, with its std; a strip hidden in part seems farther away.
    """

    x: float
    y: float
    width: float
    height: float
    area_px: float
    kept: bool
    reason: str = ""
    bearing_rad: float = math.nan
    variance_rad2: float = math.nan
    range_m: float = math.nan
    range_std_m: float = math.nan


def distance_m(strip: Strip, solid_angle: float) -> float:
    """How far from the lens a strip is that covers a solid angle (sr) of the picture."""
    return math.sqrt(strip.diameter_m * strip.tall_m / solid_angle)


def distance_std_m(distance: float, pixels: float) -> float:
    """Standard deviation of a distance (m) by so many reduced pixels."""
    return distance * math.hypot(_RANGE_SHARE, _RANGE_PIXELS / math.sqrt(pixels))


def bearing_variance(pixel_rad: float, aside_rad: float) -> float:
    """Variance (rad²) of the bearing of a strip's middle, which may be aside within `aside_rad`.

    pixel_rad: of a reduced pixel there.
    """
    return (_PIXEL_STD * pixel_rad) ** 2 + aside_rad**2 / 12.0
