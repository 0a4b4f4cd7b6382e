"""Where a strip's middle is found in rendered pictures, against its coat sampled point by point."""

import math

import numpy as np
import pytest

from host.config import Camera, Cameras, Strip
from host.messages import FloatArray
from host.perception.lens import View
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.render import Renderer, Surroundings
from host.simulation.pictures.sightings import NOTHING

SCENES = 10


def middle_of_coat(strip: Strip, camera: Camera, place: FloatArray) -> tuple[float, float]:
    """Azimuth and elevation (rad) of what the camera sees of a coat at `place` (2,), on average."""
    viewpoint = np.array([camera.x_m, camera.y_m, camera.z_m])
    around, up = np.linspace(-math.pi, math.pi, 720), np.linspace(-0.5, 0.5, 41)
    normals = np.stack((np.cos(around), np.sin(around)), axis=1)
    points = np.empty((len(around), len(up), 3))
    points[..., :2] = (place + 0.5 * strip.diameter_m * normals)[:, None]
    points[..., 2] = strip.height_m + strip.tall_m * up
    rays = points - viewpoint
    facing = np.maximum(-np.einsum("amk,ak->am", rays[..., :2], normals), 0.0)
    solid = facing / np.linalg.norm(rays, axis=2) ** 3
    elevations = np.arctan2(rays[..., 2], np.hypot(rays[..., 0], rays[..., 1]))
    azimuth = math.atan2(*(place - viewpoint[:2])[::-1])
    return azimuth, float(np.average(elevations, weights=solid))


@pytest.mark.parametrize("pattern", ["two_colours", "one_colour"])
def test_neither_too_low_nor_too_high_above_a_dark_turret(pattern: str) -> None:
    cameras = Cameras.model_validate({"strip": {"pattern": pattern}})
    camera = cameras.front
    view, finder = View(camera), StripFinder(cameras, camera)
    renderer = Renderer(cameras, camera, seed=3)
    random = np.random.default_rng(5)
    too_high = []
    for number in range(SCENES):
        bearing, distance = random.uniform(-1.0, 1.0), random.uniform(0.5, 2.0)
        place = distance * np.array([math.cos(bearing), math.sin(bearing)])
        scene = Surroundings(place[None], NOTHING, np.zeros(3), 3.0)
        (blob,) = [b for b in finder.blobs(renderer.render(scene, number)) if b.kept]
        azimuth, elevation = middle_of_coat(cameras.strip, camera, place)
        rays = np.array(
            [
                [math.cos(azimuth), math.sin(azimuth), math.tan(e)]
                for e in (elevation, elevation + 1e-4)
            ]
        )
        middle, higher = view.pixels_of(view.origin + rays)
        upward = (higher - middle) / np.hypot(*(higher - middle))
        too_high.append(float((np.array([blob.x, blob.y]) - middle) @ upward))
    assert abs(np.mean(too_high)) < 0.15
    assert np.abs(too_high).max() < 1.0
