"""Furniture in pictures: what it hides, what it is painted over, against rays and ways."""

import math

import numpy as np
import pytest

from host.config import Camera, Cameras, Strip
from host.perception.lens import View
from host.simulation.pictures.blocks import CARDBOARD, STEEL, Block
from host.simulation.pictures.render import Look, Renderer, Surroundings
from host.simulation.pictures.sightings import visible
from host.simulation.world.furniture import SEAT_M, Furniture
from host.simulation.world.raycast import Beams, meet_boxes

CAMERAS = Cameras(strip=Strip(pattern="one_colour"))
SMALL = Camera(
    width_px=640, height_px=360, focal_px=203.7, centre_x_px=319.5, centre_y_px=179.5, x_m=0.05
)
PLAIN = Look(noise=0.0, light_spread=0.0, floor_patches=0, wall_patches=0)
NOBODY = np.zeros((0, 2))


def furniture(boxes=(), chairs=(), legs=(), top_m: float = 0.4) -> Furniture:
    return Furniture(
        legs=np.array(legs, dtype=float).reshape(-1, 2),
        leg_radii=np.full(len(legs), 0.015),
        leg_tops=np.full(len(legs), SEAT_M),
        chairs=np.array(chairs, dtype=float).reshape(-1, 5),
        tables=np.zeros((0, 5)),
        boxes=np.array(boxes, dtype=float).reshape(-1, 5),
        box_top_m=top_m,
    )


def scene(teammates: object, things: Furniture) -> Surroundings:
    places = np.asarray(teammates, dtype=float).reshape(-1, 2)
    return Surroundings(places, NOBODY, np.array([0.1, -0.2, 0.4]), 3.6, furniture=things)


def red_share(teammate: np.ndarray, things: Furniture) -> float:
    """How much of the strip's red a picture keeps where furniture stands in it."""

    def red(there: Furniture) -> int:
        picture = Renderer(CAMERAS, SMALL, PLAIN).picture(scene(teammate, there), 0)
        blue, green, red = np.moveaxis(picture[:200].astype(int), -1, 0)
        return int(np.sum((red > 60) & (red > 2 * np.maximum(blue, green))))

    return red(things) / red(furniture())


def test_what_a_block_hides_is_what_the_way_to_it_leads_through() -> None:
    random = np.random.default_rng(1)
    viewpoint = np.array([0.05, 0.0, 0.25])
    points = random.uniform([-2, -2, 0.0], [2, 2, 0.5], (400, 3))
    rectangle = np.array([0.8, 0.3, 0.7, 0.7, 0.4])
    hidden = Block(0.3, CARDBOARD).between(rectangle, viewpoint, points)
    ways = viewpoint + np.linspace(0, 1, 3000)[:, None, None] * (points - viewpoint)
    c, s = math.cos(0.7), math.sin(0.7)
    along = (ways[..., :2] - rectangle[:2]) @ np.array([[c, -s], [s, c]])
    through = (np.abs(along) < rectangle[3:] / 2).all(axis=-1) & (ways[..., 2] < 0.3)
    assert hidden.sum() > 10
    assert np.mean(hidden == through.any(axis=0)) > 0.99


def test_a_box_is_painted_where_rays_meet_it() -> None:
    boxes = np.array([[1.2, 0.3, 0.4, 0.6, 0.3], [0.9, -0.8, -0.9, 0.5, 0.4]])
    camera = SMALL.model_copy(update={"tilt_rad": 0.0})
    view = View(camera)
    with_boxes = Renderer(CAMERAS, camera, PLAIN).picture(scene(NOBODY, furniture(boxes)), 0)
    without = Renderer(CAMERAS, camera, PLAIN).picture(scene(NOBODY, furniture()), 0)
    changed = np.abs(with_boxes.astype(int) - without).max(axis=2) > 12
    rows, columns = np.mgrid[60:175:3, 60:580:5]
    rays = view.directions_of(np.stack((columns.ravel(), rows.ravel()), axis=1).astype(float))
    level = np.hypot(rays[:, 0], rays[:, 1])
    starts = np.tile(view.origin[:2], (len(rays), 1))
    met = meet_boxes(Beams(starts, starts, rays[:, :2] / level[:, None]), boxes).distances
    with np.errstate(invalid="ignore"):
        height = view.origin[2] + met * rays[:, 2] / level
    expected = np.isfinite(met) & (height < 0.4) & (height > 0.0)
    assert expected.sum() > 200
    agreed = changed[rows.ravel(), columns.ravel()] == expected
    assert np.mean(agreed) > 0.97  # edges, and where cardboard and wall look alike


@pytest.mark.parametrize("distance_m", [0.5, 1.05, 1.6])
def test_a_robot_is_painted_over_a_box_behind_it_and_under_one_before_it(distance_m: float) -> None:
    # A long box along the sight line's left, which begins nearer than the robot and ends beyond it.
    long_box = furniture([[1.1, 0.45, 0.0, 1.6, 0.3]])
    assert red_share(np.array([distance_m, 0.1]), long_box) > 0.95
    across = furniture([[distance_m + 0.3, 0.0, 1.2, 1.2, 0.2]])
    assert red_share(np.array([distance_m, 0.0]), across) > 0.95
    before = furniture([[distance_m - 0.25, 0.0, 1.6, 1.2, 0.1]])
    assert red_share(np.array([distance_m, 0.0]), before) == 0.0


@pytest.mark.parametrize("offset_m", [-0.03, 0.0, 0.025])
def test_the_visible_share_is_the_share_of_red_that_a_leg_leaves(offset_m: float) -> None:
    teammate = np.array([1.0, 0.0])
    things = furniture(legs=[(0.5, offset_m)], chairs=[(0.65, 0.15, 0.0, 0.4, 0.4)])
    share = visible(View(SMALL), CAMERAS.strip, teammate[None], NOBODY, things).shares[0]
    assert 0.3 < share < 0.95
    assert red_share(teammate, things) == pytest.approx(share, abs=0.08)


def test_a_low_box_leaves_the_strip_in_view() -> None:
    teammate = np.array([[1.0, 0.0]])
    for top_m, share in ((0.2, 1.0), (0.4, 0.0)):
        things = furniture([[0.6, 0.0, 0.3, 0.3, 0.2]], top_m=top_m)
        sightings = visible(View(SMALL), CAMERAS.strip, teammate, NOBODY, things)
        assert sightings.shares == pytest.approx(share)
        assert red_share(teammate, things) == pytest.approx(share, abs=0.02)


def test_furniture_is_no_red_thing() -> None:
    for blue, green, red in (CARDBOARD, STEEL):
        assert red < 1.6 * min(blue, green)
