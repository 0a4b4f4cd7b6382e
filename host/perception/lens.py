"""Pixel ↔ ray for lenses that see half of all directions and more, and the camera's mounting.

Camera frame: x right in the picture, y down, z along the axis. Robot frame: x forward, y left, z
up, origin on the floor between the wheels. Pixel (0, 0) is the middle of the upper left one.
A picture plane cannot hold a ray at 90 deg off the axis, so nothing here divides by z: a lens is
the radius at which it draws the angle from the axis, and the way back.
"""

import math

import numpy as np

from host.config import Camera
from host.messages import FloatArray

_TABLE_SIZE = 1024
_MOST_STEPS = 100
_PRECISION = 4e-15  # of a radius, as a share of the largest


def equidistant_radius(angles: FloatArray, k1: float, k2: float) -> FloatArray:
    """Radius in focal lengths at `angles` (rad, any shape): t + k1 t³ + k2 t⁵.

    Kannala and Brandt 2006 eq. 6 with its first three terms, in units of the first.
    """
    square = angles * angles
    return angles * (1.0 + square * (k1 + k2 * square))


def equidistant_slope(angles: FloatArray, k1: float, k2: float) -> FloatArray:
    """Derivative of `equidistant_radius` by the angle."""
    square = angles * angles
    return 1.0 + square * (3.0 * k1 + 5.0 * k2 * square)


def equidistant_limit(k1: float, k2: float) -> float:
    """Angle (rad, at most pi) up to which `equidistant_radius` grows."""
    # The slope is 1 + b u + a u² in u = t²; its first positive root, written so that a = 0 is
    # no special case.
    a, b = 5.0 * k2, 3.0 * k1
    discriminant = b * b - 4.0 * a
    if discriminant <= 0.0:
        return math.pi
    divisor = math.sqrt(discriminant) - b
    return min(math.sqrt(2.0 / divisor), math.pi) if divisor > 0.0 else math.pi


class Lens:
    """The lens of one camera: where a ray meets the picture, and which ray a pixel saw.

    camera: whose focal length, centre, k1, k2 and model ("equidistant", or "orthographic" as Perera
    2021 eq. 34 has it) are used. limit_rad: the farthest angle from the axis that has a pixel,
    where the radius stops growing. The picture's border is not looked at.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._centre = np.array([camera.centre_x_px, camera.centre_y_px])
        if camera.lens == "orthographic":
            self.limit_rad = 0.5 * math.pi
        else:
            self.limit_rad = equidistant_limit(camera.k1, camera.k2)
        self._table = np.linspace(0.0, self.limit_rad, _TABLE_SIZE)
        # Rounding must not make a radius fall where it stops growing: the table is searched.
        self._radii = np.maximum.accumulate(equidistant_radius(self._table, camera.k1, camera.k2))

    def radius(self, angles: FloatArray) -> FloatArray:
        """Radii (px) at `angles` (rad from the axis, any shape); nan where there is none."""
        angles = np.asarray(angles, dtype=float)
        inside = (angles >= 0.0) & (angles <= self.limit_rad)
        angles = np.where(inside, angles, math.nan)
        if self.camera.lens == "orthographic":
            return np.asarray(self.camera.focal_px * np.sin(angles))
        return self.camera.focal_px * equidistant_radius(angles, self.camera.k1, self.camera.k2)

    def angle(self, radii: FloatArray) -> FloatArray:
        """Angles (rad) from the axis at `radii` (px, any shape): the inverse of `radius`."""
        scaled = np.asarray(radii, dtype=float) / self.camera.focal_px
        if self.camera.lens == "orthographic":
            return np.asarray(np.arcsin(np.where(scaled <= 1.0, scaled, math.nan)))
        # The farthest pixel stays inside however its radius was rounded.
        inside = (scaled >= 0.0) & (scaled <= self._radii[-1] * (1.0 + _PRECISION))
        angles = np.full(scaled.shape, math.nan)
        angles[inside] = self._solve(scaled[inside])
        return angles

    def extrapolation_variances(self, pixels: FloatArray) -> FloatArray:
        """Variances (n,) rad² that bearings at `pixels` (n, 2) have beyond the lens's known reach.

        They add to those that a bearing has in any case. 0 within the reach, and where the lens
        draws nothing.
        """
        x, y = (np.asarray(pixels, dtype=float).reshape(-1, 2) - self._centre).T
        beyond = np.maximum(self.angle(np.hypot(x, y)) - self.camera.reach_rad, 0.0)
        return np.nan_to_num((self.camera.beyond_noise_per_rad * beyond**2) ** 2)

    def _solve(self, radii: FloatArray) -> FloatArray:
        """Angles (n,) at `radii` (n,) in focal lengths, all on the growing part.

        Newton's steps from a table, kept between bounds: alone they leave where the radius is
        nearly level.
        """
        k1, k2 = self.camera.k1, self.camera.k2
        cell = np.clip(np.searchsorted(self._radii, radii), 1, _TABLE_SIZE - 1)
        low, high = self._table[cell - 1], self._table[cell]
        angles = np.interp(radii, self._radii, self._table)
        tolerance = _PRECISION * self._radii[-1]
        todo = np.arange(len(radii))
        for _ in range(_MOST_STEPS):
            angle = angles[todo]
            error = equidistant_radius(angle, k1, k2) - radii[todo]
            far = np.abs(error) > tolerance
            if not far.any():
                break
            todo, angle, error = todo[far], angle[far], error[far]
            low[todo] = np.where(error < 0.0, angle, low[todo])
            high[todo] = np.where(error > 0.0, angle, high[todo])
            slope = np.maximum(equidistant_slope(angle, k1, k2), 1e-12)
            newton = angle - error / slope
            within = (newton > low[todo]) & (newton < high[todo])
            angles[todo] = np.where(within, newton, 0.5 * (low[todo] + high[todo]))
        return angles

    def project(self, rays: FloatArray) -> FloatArray:
        """Pixels (n, 2) where `rays` (n, 3), camera frame, of any length, meet the picture.

        nan where the model has no pixel: beyond `limit_rad`, straight behind, no ray at all.
        """
        x, y, z = np.ascontiguousarray(np.asarray(rays, dtype=float).T)
        across = np.hypot(x, y)
        radii = self.radius(np.arctan2(across, z))
        on_axis = (across == 0.0) & (z > 0.0)
        with np.errstate(invalid="ignore"):  # no direction across: nan, but for the axis itself
            offset = np.stack((x, y), axis=1) / np.where(on_axis, 1.0, across)[:, None]
        return self._centre + radii[:, None] * offset

    def unproject(self, pixels: FloatArray) -> FloatArray:
        """Unit rays (n, 3), camera frame, that meet the picture at `pixels` (n, 2).

        nan where the model draws nothing: at a radius beyond that of `limit_rad`.
        """
        x, y = np.ascontiguousarray((np.asarray(pixels, dtype=float) - self._centre).T)
        radii = np.hypot(x, y)
        angles = self.angle(radii)
        across = np.sin(angles) / np.where(radii == 0.0, 1.0, radii)
        return np.stack((across * x, across * y, np.cos(angles)), axis=1)


class View:
    """A camera on the robot: its lens and how it is mounted.

    origin (3,) m: the lens in the robot frame. to_robot (3, 3): rotates vectors of the camera frame
    into the robot frame; its columns are the picture's right, its down, and the axis.
    """

    def __init__(self, camera: Camera) -> None:
        self.lens = Lens(camera)
        self.origin = np.array([camera.x_m, camera.y_m, camera.z_m])
        self.to_robot = mounting_rotation(camera.heading_rad, camera.tilt_rad, camera.roll_rad)

    def pixels_of(self, points: FloatArray) -> FloatArray:
        """Pixels (n, 2) of `points` (n, 3) m in the robot frame; nan where there is none."""
        return self.lens.project((np.asarray(points, dtype=float) - self.origin) @ self.to_robot)

    def directions_of(self, pixels: FloatArray) -> FloatArray:
        """Unit vectors (n, 3) in the robot frame in which `pixels` (n, 2) look, from `origin`."""
        return self.lens.unproject(pixels) @ self.to_robot.T


def mounting_rotation(heading_rad: float, tilt_rad: float, roll_rad: float) -> FloatArray:
    """Camera frame → robot frame, (3, 3).

    The camera starts level and looking ahead, is rolled about its axis (clockwise, seen from
    behind), tilted down, and rotated by `heading_rad` about z (counter-clockwise).
    """
    ch, sh = math.cos(heading_rad), math.sin(heading_rad)
    ct, st = math.cos(tilt_rad), math.sin(tilt_rad)
    right = np.array([sh, -ch, 0.0])
    down = np.array([-st * ch, -st * sh, -ct])
    axis = np.array([ct * ch, ct * sh, -st])
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    return np.stack((cr * right + sr * down, cr * down - sr * right, axis), axis=1)
