"""Where in a picture teammates' strips can be, and what each place in it means.

The strip stands at a known height, so at each distance it appears at one elevation: over all
distances in reach that is a narrow band about the horizon (Perera 2021 ch. 5.4).
"""

import math

import numpy as np

from host.config import Camera, Cameras
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, Image
from host.perception.jpeg_decoder import SCALE
from host.perception.lens import View

GREEN_RGB, MAGENTA_RGB = (55, 166, 79), (188, 49, 129)  # sRGB of the two colours, as printed
REACH_M = 0.2  # no teammate's strip comes nearer to a lens
BODY_M = 0.2  # nothing on the floor so near to the robot's middle is but its own body
LEVEL_RAD = 0.05  # a robot pitches and rolls so much as it drives
_BEARINGS, _RANGES = 720, 25


class StripGeometry:
    """What one camera's pixels mean for strips.

    rows: below so many rows of the picture no strip's middle can be. view (centre, half width)
    rad: the bearings in which the picture shows a strip. azimuth, elevation (rad; azimuth from the
    camera's heading) and solid_angle (sr) of each pixel of the reduced picture, (rows, columns);
    drawn: 255 where the lens draws anything, 0 elsewhere, as are the others there.
    """

    def __init__(self, cameras: Cameras, camera: Camera) -> None:
        self._cameras, self._camera = cameras, camera
        self._view = View(camera)
        self._offset_m = cameras.strip.height_m - camera.z_m
        distances = np.geomspace(REACH_M, cameras.max_range_m, _RANGES)
        elevations = np.arctan2(self._offset_m, distances)
        self.lowest = float(elevations.min()) - LEVEL_RAD
        self.highest = float(elevations.max()) + LEVEL_RAD
        self.rows, self.view = self._survey(distances)
        self.drawn, self.azimuth, self.elevation, self.solid_angle = self._directions()

    def _survey(self, distances: FloatArray) -> tuple[int, tuple[float, float]]:
        """Rows in which strips can be, and the bearings that the picture shows."""
        cameras, camera = self._cameras, self._camera
        offsets = np.linspace(-math.pi, math.pi, _BEARINGS, endpoint=False)
        bearing, distance = np.meshgrid(offsets + camera.heading_rad, distances, indexing="ij")
        x = camera.x_m + distance * np.cos(bearing)
        y = camera.y_m + distance * np.sin(bearing)
        points = np.stack((x, y, np.full_like(x, cameras.strip.height_m)), axis=-1)
        pixels = self._view.pixels_of(points.reshape(-1, 3)).reshape((*points.shape[:2], 2))
        inside = self._in_picture(pixels)
        far = distances >= min(0.5 * cameras.half_range_m, 0.9 * cameras.max_range_m)
        shown = np.asarray(inside[:, far].all(axis=1))
        seen = np.flatnonzero(shown)
        if not len(seen):
            return 2 * SCALE, (camera.heading_rad, 0.0)
        # Corners of the picture see near strips farther aside than others; that is the other
        # camera's part.
        lowest = np.max(pixels[seen, :, 1], where=inside[seen], initial=0.0)
        rows = min(math.ceil(lowest) + 1, camera.height_px)
        if shown.all():
            return rows, (camera.heading_rad, math.pi)
        first, last = _longest_run(shown)
        step = math.tau / _BEARINGS
        centre = float(wrap(camera.heading_rad - math.pi + 0.5 * (first + last) * step))
        return rows, (centre, 0.5 * (last - first) * step)

    def _in_picture(self, pixels: FloatArray) -> BoolArray:
        x, y = pixels[..., 0], pixels[..., 1]
        with np.errstate(invalid="ignore"):  # nan is outside
            return np.asarray(
                (x >= -0.5)
                & (x <= self._camera.width_px - 0.5)
                & (y >= -0.5)
                & (y <= self._camera.height_px - 0.5)
            )

    def _directions(self) -> tuple[Image, FloatArray, FloatArray, FloatArray]:
        rows, columns = -(-self.rows // SCALE), -(-self._camera.width_px // SCALE)
        y, x = np.indices((rows, columns), dtype=float)
        pixels = full_size(np.stack((x, y), axis=-1)).reshape(-1, 2)
        ray = self._view.directions_of(pixels).reshape(rows, columns, 3)
        down, right = np.gradient(ray, axis=0), np.gradient(ray, axis=1)
        solid_angle = np.linalg.norm(np.cross(right, down), axis=-1)
        drawn = np.isfinite(solid_angle)
        ray = np.where(drawn[..., None], ray, 0.0)
        azimuth = wrap(np.arctan2(ray[..., 1], ray[..., 0]) - self._camera.heading_rad)
        elevation = np.arcsin(np.clip(ray[..., 2], -1.0, 1.0))
        mask = np.where(drawn, 255, 0).astype(np.uint8)
        return mask, azimuth, elevation, np.where(drawn, solid_angle, 0.0)

    def reduced_pixels(
        self, azimuth: FloatArray, elevation: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """x, y in the reduced picture of directions (rad, any shape); nan where there is none."""
        bearing, level = azimuth + self._camera.heading_rad, np.cos(elevation)
        rays = (level * np.cos(bearing), level * np.sin(bearing), np.sin(elevation))
        pixels = self._view.lens.project(
            np.stack(rays, axis=-1).reshape(-1, 3) @ self._view.to_robot
        )
        x, y = reduced(pixels).T.reshape(2, *azimuth.shape)
        return x, y

    def pixel(self, azimuth: float, elevation: float) -> tuple[float, float]:
        """x, y in the full picture of one direction (rad)."""
        x, y = self.reduced_pixels(np.array([azimuth]), np.array([elevation]))
        return float(full_size(x)[0]), float(full_size(y)[0])

    def edges(self, distance_m: float) -> tuple[float, float, float]:
        """Elevations (rad) of a strip's upper edge, middle and lower edge, `distance_m` away."""
        half = 0.5 * self._cameras.strip.tall_m
        upper, middle, lower = (
            math.atan2(self._offset_m + side * half, distance_m) for side in (1.0, 0.0, -1.0)
        )
        return upper, middle, lower

    def elevations_at(self, nearest_m: float, farthest_m: float) -> tuple[float, float]:
        """Lowest and highest elevation (rad) of a strip's middle between two distances."""
        ends = [math.atan2(self._offset_m, distance) for distance in (nearest_m, farthest_m)]
        return min(ends) - LEVEL_RAD, max(ends) + LEVEL_RAD

    def on_own_body(self, azimuth: float, elevation: float) -> bool:
        """Whether a ray meets the floor within the robot's own outline."""
        if elevation >= 0.0:
            return False
        bearing, reach = azimuth + self._camera.heading_rad, self._camera.z_m / math.tan(-elevation)
        x = self._camera.x_m + reach * math.cos(bearing)
        y = self._camera.y_m + reach * math.sin(bearing)
        return math.hypot(x, y) < BODY_M

    @property
    def heading_rad(self) -> float:
        """Of the camera: where its azimuth is 0."""
        return self._camera.heading_rad

    def bearing(self, azimuth: float) -> float:
        """Bearing (rad, in [-pi, pi)) in the robot frame (Perera 2021 eq. 37, repaired)."""
        return float(wrap(azimuth + self._camera.heading_rad))


def _longest_run(shown: BoolArray) -> tuple[int, int]:
    """First and last place of the longest run around a circle, of which some but not all is True.

    A camera that is tilted far down shows the horizon on both sides but not ahead; what lies
    between must not pass for shown. The last place may lie beyond the array's end.
    """
    start = int(np.argmin(shown))  # no run goes over it
    ends = np.flatnonzero(np.diff(np.roll(shown, -start).astype(np.int8), append=0)).reshape(-1, 2)
    before, last = ends[np.argmax(ends[:, 1] - ends[:, 0])] + start
    return int(before) + 1, int(last)


def full_size(index: FloatArray) -> FloatArray:
    """Where the middle of a pixel of the reduced picture lies in the full one, px."""
    return SCALE * np.asarray(index, dtype=float) + 0.5 * (SCALE - 1)


def reduced(pixels: FloatArray) -> FloatArray:
    """Where places of the full picture lie in the reduced one: the way back of `full_size`."""
    return (np.asarray(pixels, dtype=float) - 0.5 * (SCALE - 1)) / SCALE
