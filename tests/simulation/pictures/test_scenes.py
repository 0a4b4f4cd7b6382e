"""Scenes by name: what lamps, lenses and things in them do to a picture, and the search on them."""

import itertools
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import scipy.ndimage

from host.config import Camera, Cameras, Strip
from host.geometry import wrap
from host.messages import Image
from host.perception.lens import View
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.render import Look, Renderer, Surroundings, frames
from host.simulation.pictures.rooms import ROOMS
from host.simulation.pictures.scenes import SCENES, scene_frames
from tests.perception.strips.drawn_strips import pixel_of, place

RED = Cameras(strip=Strip(pattern="one_colour"))
SMALL = Camera(width_px=640, height_px=360, focal_px=203.7, centre_x_px=319.5, centre_y_px=179.5)
STILL = Look(noise=0.0, light_spread=0.0, floor_patches=0, wall_patches=0)
POSE = np.array([0.1, -0.2, 0.4])
NOBODY = np.zeros((0, 2))


def picture(look: Look, camera: Camera = SMALL, **things: np.ndarray) -> Image:
    scene = Surroundings(things.pop("teammates", NOBODY), NOBODY, POSE, 1.5, **things)
    return Renderer(RED, camera, look, 3).picture(scene, 0)


def test_rooms_are_unlike_each_other_and_the_same_again() -> None:
    seen = {name: picture(replace(STILL, room=name)) for name in (*ROOMS, "brick")}
    assert (seen["brick"] == picture(replace(STILL, room="brick"))).all()
    for name, other in itertools.combinations(sorted(ROOMS), 2):
        assert (seen[name] != seen[other]).mean() > 0.02
    assert {scene.look.room for scene in SCENES.values()} == set(ROOMS)


def test_lamps_multiply_each_colour_by_their_own_factor() -> None:
    plain = picture(STILL).astype(float)
    lit = picture(replace(STILL, light=(0.5, 0.75, 1.0))).astype(float)
    bright = plain.min(axis=2) > 60.0
    assert np.mean(lit[bright] / plain[bright], axis=0) == pytest.approx((0.5, 0.75, 1), abs=0.01)


def test_fringes_draw_red_farther_out_and_blue_farther_in() -> None:
    fringe, teammate = 0.02, place(SMALL, 1.1, 0.6)[None]
    plain = picture(STILL, teammates=teammate)
    seen = picture(replace(STILL, fringe=fringe), teammates=teammate)
    rows, columns = np.indices(plain.shape[:2], dtype=float)
    for channel, scale in ((0, 1.0 - fringe), (1, 1.0), (2, 1.0 + fringe)):
        places = [179.5 + (rows - 179.5) / scale, 319.5 + (columns - 319.5) / scale]
        moved = scipy.ndimage.map_coordinates(plain[..., channel].astype(float), places, order=1)
        assert np.abs(moved - seen[..., channel]).mean() < 0.5


@pytest.mark.parametrize("bearing", [-0.6, 0.2])
def test_a_bin_is_red_from_the_floor_up(bearing: float) -> None:
    camera = RED.front
    seen = picture(STILL, camera, bins=place(camera, bearing, 0.5)[None]).astype(int)
    for height, aside, is_red in (
        (0.27, 0.0, True),
        (0.03, 0.0, True),
        (0.2, 0.06, True),
        (0.2, 0.1, False),
        (0.2, -0.1, False),
    ):
        ahead = place(camera, bearing, 0.44)
        side = aside * np.array([-math.sin(bearing), math.cos(bearing)])
        x, y = map(round, pixel_of(np.append(ahead + side, height), camera))
        blue, green, red = seen[y, x]
        assert (red > 2 * max(blue, green)) == is_red, (height, aside)


def test_the_bin_of_a_scene_stands_30_deg_beside_a_teammate() -> None:
    found = 0
    for jpeg, truth in frames(6, 8, RED, RED.front, replace(STILL, quality=95), beside_bin=True):
        seen = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
        red = (seen[..., 2] > 60) & (seen[..., 2] > 2 * np.maximum(seen[..., 0], seen[..., 1]))
        rows, columns = np.nonzero(red)
        ray = View(RED.front).directions_of(np.stack((columns, rows), axis=1).astype(float))
        below = (ray[:, 2] < -0.2) & (ray[:, 2] > -0.35)  # lower than any strip
        bearing = np.arctan2(ray[below, 1], ray[below, 0])
        if len(bearing):
            found += 1
            middle = 0.5 * (bearing.min() + bearing.max())
            apart = np.degrees(np.abs(wrap(truth.bearings - middle)))
            assert np.abs(apart - 30.0).min() < 1.0
    assert found >= 3


@pytest.mark.parametrize("seed", [31, 32])
@pytest.mark.parametrize("name", ["warm", "dark", "fringes", "bin"])
def test_one_colour_is_found_in_rooms_that_are_not_red(name: str, seed: int) -> None:
    finder = StripFinder(RED, RED.front)
    hits, errors, false = [], [], 0
    for jpeg, truth in scene_frames(name, 5, seed, RED):
        found = np.array([blob.bearing_rad for blob in finder.blobs(jpeg) if blob.kept])
        apart = np.degrees(np.abs(wrap(found[:, None] - truth.bearings)))
        false += int(np.sum(apart.min(axis=1, initial=180.0) > 3.0))
        for k in np.flatnonzero(truth.shares > 0.95):
            hits.append(apart[:, k].min(initial=180.0) < 3.0)
            if hits[-1]:
                errors.append(apart[:, k].min())
    assert len(hits) > 5
    assert np.mean(hits) > 0.9
    assert false <= 1, "0.2 a picture"
    assert np.median(errors) < 0.1
    assert np.percentile(errors, 95) < 0.3
