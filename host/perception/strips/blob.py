"""What a search for strips finds in a picture."""

import math
from dataclasses import dataclass


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
