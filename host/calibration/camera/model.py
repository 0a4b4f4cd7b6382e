"""Where cameras draw strips of known place, and how that changes with lens, mounting and delay."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.pairs import CAMERAS, Strips
from host.config import Camera, Cameras
from host.messages import BoolArray, FloatArray, IntArray
from host.perception.lens import equidistant_radius, mounting_rotation

NAMES = (
    *("focal_px", "centre_x_px", "centre_y_px", "k1", "k2"),
    *("heading_rad", "tilt_rad", "roll_rad", "x_m", "y_m", "z_m"),
)
LENS_NAMES = 5  # the first so many are the lens, the others its mounting
STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6])
_DELAY_STEP_S = 1e-4
_HIGHER_M = 1e-4
_ROTATION_RAD = 1e-5


@dataclass(frozen=True, slots=True)
class Pairs:
    """Strips (n,) with the teammates they are taken for.

    points (n, 3) m: the strips' true middles in the robot frame, for the delay `delay` (s), and
    velocities (n, 3) m/s there. sigmas (n,) px: what noise of one pixel and that of the reference
    make. paired (n,): False where no teammate was near; mates (n,): which of the reference's it
    is. headings (n,) rad: of the robot on the floor. Rest as in `Strips`.
    """

    strips: Strips
    points: FloatArray
    velocities: FloatArray
    sigmas: FloatArray
    paired: BoolArray
    mates: IntArray
    headings: FloatArray
    delay: float

    def at(self, delay: float) -> FloatArray:
        """The points (n, 3) for a slightly different delay (s)."""
        return self.points - (delay - self.delay) * self.velocities


def equidistant(camera: Camera) -> Camera:
    """A camera whose lens is "equidistant", and draws 90 deg off the axis where the given one does.

    The fit knows no other lens.
    """
    if camera.lens == "equidistant":
        return camera
    focal = camera.focal_px / (0.5 * math.pi)
    return camera.model_copy(
        update={"lens": "equidistant", "focal_px": focal, "k1": 0.0, "k2": 0.0}
    )


def row_of(values: FloatArray, number: int) -> FloatArray:
    """One camera's values (11,) of those of a fit (23,)."""
    return values[len(NAMES) * number :][: len(NAMES)]


def camera_of(values: FloatArray, number: int, cameras: Cameras) -> Camera:
    """A camera as the values (23,) of a fit have it; what these do not hold is as in `camera`."""
    configured: Camera = getattr(cameras, CAMERAS[number])
    row = dict(zip(NAMES, row_of(values, number).tolist(), strict=True))
    # A fit may go round past the rear.
    row["heading_rad"] = math.remainder(row["heading_rad"], math.tau)
    return configured.model_copy(update={"lens": "equidistant", **row})


def draw(values: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of points (n, 3) m by one camera's values (11,); angles (n,) rad off its axis.

    As `lens.View` does, but for lenses that fold back too: a fit passes them on its way.
    """
    focal, k1, k2 = values[0], values[3], values[4]
    rays = (points - values[8:11]) @ mounting_rotation(*values[5:8].tolist())
    across = np.hypot(rays[:, 0], rays[:, 1])
    angles = np.arctan2(across, rays[:, 2])
    radii = focal * equidistant_radius(angles, float(k1), float(k2))
    return values[1:3] + (radii / np.maximum(across, 1e-12))[:, None] * rays[:, :2], angles


def errors(values: FloatArray, pairs: Pairs) -> FloatArray:
    """Drawn minus seen, (n, 2) px."""
    points = pairs.at(float(values[-1]))
    missed = np.empty_like(pairs.strips.pixels)
    for number in range(len(CAMERAS)):
        mine = pairs.strips.cameras == number
        missed[mine] = draw(row_of(values, number), points[mine])[0] - pairs.strips.pixels[mine]
    return missed


def off_by(values: FloatArray, pairs: Pairs) -> FloatArray:
    """How far (n,) each is drawn from where it was seen, in units of the pairs' sigmas."""
    return np.asarray(np.hypot(*errors(values, pairs).T) / pairs.sigmas)


def upward(values: FloatArray, pairs: Pairs) -> FloatArray:
    """The direction (n, 2) in the picture, of length 1, in which each strip would be higher."""
    higher = dataclasses.replace(pairs, points=pairs.points + np.array([0.0, 0.0, _HIGHER_M]))
    moved = errors(values, higher) - errors(values, pairs)
    return np.asarray(moved / np.maximum(np.hypot(*moved.T), 1e-12)[:, None])


def rotated(values: FloatArray, pairs: Pairs) -> FloatArray:
    """Derivatives (n, 2) px/rad of the errors by a rotation of all teammates about the robot."""
    around = np.stack(
        (-pairs.points[:, 1], pairs.points[:, 0], np.zeros(len(pairs.points))), axis=1
    )
    moved = dataclasses.replace(pairs, points=pairs.points + _ROTATION_RAD * around)
    return np.asarray((errors(values, moved) - errors(values, pairs)) / _ROTATION_RAD)


def slopes(values: FloatArray, pairs: Pairs) -> FloatArray:
    """Derivatives (n, 2, 23) of the errors.

    A camera's values move its own strips alone, so one step serves those of both.
    """
    found = np.zeros((len(pairs.paired), 2, len(values)))
    here = errors(values, pairs)
    every = np.arange(len(here))
    for k, step in enumerate(STEPS):
        moved = values.copy()
        moved[k : -1 : len(NAMES)] += step
        found[every, :, k + len(NAMES) * pairs.strips.cameras] = (
            errors(moved, pairs) - here
        ) / step
    moved = values.copy()
    moved[-1] += _DELAY_STEP_S
    found[:, :, -1] = (errors(moved, pairs) - here) / _DELAY_STEP_S
    return found
