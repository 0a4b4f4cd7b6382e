"""Red things in the room that are no strips."""

import math
from dataclasses import dataclass

import numpy as np

from host.config import Cameras
from host.geometry import to_frame
from host.messages import FloatArray
from host.simulation.pictures.solids import RED, Face

_NEAREST_M = 0.2  # a strip's nearest way from the camera
_MARGIN_RAD = math.radians(3.0)
_HIGH_M, _LOW_M = (0.6, 1.5), (0.12, 0.35)  # middles of patches on the walls


@dataclass(frozen=True, slots=True)
class Patch:
    """A red polygon, corners (k, 3) m in the room; in_band: it may look like a strip's height."""

    corners: FloatArray
    in_band: bool

    def face(self, pose: FloatArray) -> Face:
        """Return it in the frame of a robot at `pose` (x, y, heading)."""
        level = to_frame(self.corners[:, :2], pose)
        return Face(np.column_stack((level, self.corners[:, 2])), RED)


def red_patches(
    half_side_m: float,
    on_floor: int,
    on_walls: int,
    in_band_share: float,
    random: np.random.Generator,
) -> list[Patch]:
    """Patches at random: discs on the floor, sheets on the walls, high up but for a share."""
    patches = []
    for _ in range(on_floor):
        radius = random.uniform(0.02, 0.1)
        x, y = random.uniform(-half_side_m + 0.15, half_side_m - 0.15, 2)
        around = np.linspace(0.0, 2.0 * math.pi, 32, endpoint=False)
        disc = (x + radius * np.cos(around), y + radius * np.sin(around), np.zeros(32))
        patches.append(Patch(np.stack(disc, axis=1), bool(random.random() < in_band_share)))
    for _ in range(on_walls):
        in_band = bool(random.random() < in_band_share)
        width, height = random.uniform(0.05, 0.2, 2)
        middle = random.uniform(*(_LOW_M if in_band else _HIGH_M))
        along = random.uniform(-half_side_m + 0.15, half_side_m - 0.15)
        patches.append(Patch(_sheet(half_side_m, along, middle, (width, height), random), in_band))
    return patches


def _sheet(
    half_side_m: float,
    along: float,
    middle_m: float,
    size: tuple[float, float],
    random: np.random.Generator,
) -> FloatArray:
    sides = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * size
    corners = np.column_stack(
        (along + sides[:, 0], np.full(4, half_side_m), middle_m + sides[:, 1])
    )
    wall = int(random.integers(4))
    for _ in range(wall):
        corners = np.column_stack((-corners[:, 1], corners[:, 0], corners[:, 2]))
    return corners


def in_band(offsets: FloatArray, cameras: Cameras, camera_height_m: float) -> bool:
    """Does anything at `offsets` (k, 3) m from the camera come where strips in reach appear?"""
    strip = cameras.strip
    ends = strip.height_m - camera_height_m + 0.5 * strip.tall_m * np.array([-1.0, 1.0])
    limits = np.arctan2(ends[:, None], np.array([_NEAREST_M, cameras.max_range_m]))
    elevations = np.arctan2(offsets[:, 2], np.hypot(offsets[:, 0], offsets[:, 1]))
    above: bool = elevations.min() > limits.max() + _MARGIN_RAD
    below: bool = elevations.max() < limits.min() - _MARGIN_RAD
    return not (above or below)
