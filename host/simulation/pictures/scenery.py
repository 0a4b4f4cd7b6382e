"""The empty room behind everything: floor and walls, as one camera sees them, without edges."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from host.geometry import rotation, to_parent
from host.messages import FloatArray, Image
from host.perception.lens import View
from host.simulation.pictures.rooms import PLAIN, RoomPaint, as_image
from host.simulation.world.raycast import Beams, meet_walls

Single = NDArray[np.float32]

_BEARINGS = 4096
_WALL_TOP_M = 2.5
_LENS_EDGE_RAD = (1.61, 1.73)  # a 180-degree lens is bright up to the first, dark from the second


class Scenery:
    """Floor and walls of one square room, in one camera's pictures."""

    def __init__(
        self, view: View, half_side_m: float, random: np.random.Generator, paint: RoomPaint = PLAIN
    ) -> None:
        self._half_side_m = half_side_m
        self._coarse = coarse = paint.coarse_px
        self._origin = view.origin
        camera = view.lens.camera
        self._size = (camera.width_px, camera.height_px)
        rows = np.arange(math.ceil(camera.height_px / coarse))
        columns = np.arange(math.ceil(camera.width_px / coarse))
        self._shape = (len(rows), len(columns))
        x, y = np.meshgrid(columns, rows)
        corners = coarse * np.stack((x.ravel(), y.ravel()), axis=1)
        pixels: FloatArray = corners.astype(np.float64) + 0.5 * (coarse - 1)
        self._look_along(view.directions_of(pixels))
        falloff = _falloff(view, pixels).reshape(self._shape)
        self._falloff = np.repeat(falloff[..., None], 3, axis=2)
        self._texture = _Texture(half_side_m, paint, random)

    def _look_along(self, directions: FloatArray) -> None:
        """Keep of the rays what does not depend on where the robot stands."""
        ahead, left, up = np.nan_to_num(directions).T
        across = np.maximum(np.hypot(ahead, left), 1e-6)
        bearings = np.arctan2(left, ahead) + math.pi
        self._bearing = np.rint(bearings * (_BEARINGS / math.tau)).astype(np.intp) % _BEARINGS
        self._slope = (up / across).astype(np.float32)
        # A ray that never meets the floor meets it farther than any wall.
        to_floor = -self._origin[2] / np.minimum(up / across, -1e-4)
        self._to_floor = to_floor.astype(np.float32)
        points = np.stack((ahead, left), axis=1) * (to_floor / across)[:, None]
        self._floor = points.astype(np.float32)  # from below the camera

    def picture(self, pose: FloatArray, turn_rad: float, gain: float) -> Image:
        """The empty room (h, w, 3) from a robot at `pose` (x, y, heading), as bright as `gain`.

        turn_rad: by how much the robot rotates while the picture is exposed.
        """
        steps = min(5, 1 + int(abs(turn_rad) * 0.25 * self._size[0] / self._coarse))
        angles = ((np.arange(steps) + 0.5) / steps - 0.5) * turn_rad
        mean = np.zeros((*self._shape, 3), dtype=np.float32)
        for angle in angles:
            rotated = np.array([pose[0], pose[1], pose[2] + angle])
            cv2.accumulate(self._at(rotated), mean)
        coarse = cv2.convertScaleAbs(cv2.multiply(mean, self._falloff), alpha=gain / steps)
        fine = self._coarse
        large = cv2.resize(coarse, None, fx=fine, fy=fine, interpolation=cv2.INTER_LINEAR)
        width, height = self._size
        return np.asarray(large[:height, :width], dtype=np.uint8)

    def _at(self, pose: FloatArray) -> Image:
        bearings = (np.arange(_BEARINGS) * (math.tau / _BEARINGS) - math.pi) + pose[2]
        (start,) = to_parent(self._origin[None, :2], pose)
        directions = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
        starts = np.broadcast_to(start, directions.shape)
        walls = meet_walls(Beams(starts, starts, directions), self._half_side_m)
        to_wall = walls.distances.astype(np.float32)[self._bearing]
        to_room = rotation(pose[2]).astype(np.float32)
        row, column = self._texture.on_floor(self._floor @ to_room.T + start.astype(np.float32))
        wall = np.flatnonzero(to_wall <= self._to_floor)
        height = np.float32(self._origin[2]) + to_wall[wall] * self._slope[wall]
        along = walls.places.astype(np.float32)[self._bearing[wall]]
        row[wall], column[wall] = self._texture.on_wall(along, height)
        return self._texture.colours(row.reshape(self._shape), column.reshape(self._shape))


class _Texture:
    """Floor and walls in one image: the floor's square above the walls' long band."""

    def __init__(self, half_side_m: float, paint: RoomPaint, random: np.random.Generator) -> None:
        self._half_side_m = half_side_m
        self._per_m = min(paint.per_m, 15.0 * paint.per_m / half_side_m / 2.0)
        side = math.ceil(2.0 * half_side_m * self._per_m)
        tall = math.ceil(_WALL_TOP_M * self._per_m)
        self._side, self._tall = side, tall
        image = np.zeros((side + 1 + tall, 4 * side, 3), dtype=np.uint8)
        image[:side, :side] = as_image(paint.floor((side, side), self._per_m, random))
        image[side] = image[side - 1]  # so that no colour runs over from the walls
        image[:, side] = image[:, side - 1]
        walls = paint.walls((tall, 4 * side), self._per_m, random)
        lit = np.repeat(random.uniform(0.75, 1.0, 4), side)  # each wall unlike the others
        image[side + 1 :] = as_image(walls * lit[None, :, None])
        self._image = image

    def on_floor(self, points: Single) -> tuple[Single, Single]:
        """Rows and columns (n,) of points (n, 2) m of the room's floor."""
        places = (points + np.float32(self._half_side_m)) * np.float32(self._per_m)
        places -= np.float32(0.5)
        return np.ascontiguousarray(places[:, 1]), np.ascontiguousarray(places[:, 0])

    def on_wall(self, along: Single, height: Single) -> tuple[Single, Single]:
        """Rows and columns (n,) of places along the walls and above the floor, m."""
        row = height * np.float32(self._per_m) - np.float32(0.5)
        column = along * np.float32(self._per_m) - np.float32(0.5)
        return np.maximum(row, np.float32(0.0)) + np.float32(self._side + 1), column

    def colours(self, row: Single, column: Single) -> Image:
        """Colours (h, w, 3) at rows and columns (h, w)."""
        found = cv2.remap(
            self._image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(found, dtype=np.uint8)


def _falloff(view: View, pixels: FloatArray) -> Single:
    """How bright (n,) the lens draws `pixels` (n, 2): less towards its edge, nothing beyond."""
    axis = view.to_robot[:, 2]
    cosine = np.clip(view.directions_of(pixels) @ axis, -1.0, 1.0)
    angle = np.arccos(np.nan_to_num(cosine, nan=-1.0))
    bright, dark = _LENS_EDGE_RAD
    edge = np.clip((dark - angle) / (dark - bright), 0.0, 1.0)
    bright_here = edge * (1.0 - 0.1 * np.minimum(angle, 2.0) ** 2)
    return np.asarray(bright_here, dtype=np.float32)
