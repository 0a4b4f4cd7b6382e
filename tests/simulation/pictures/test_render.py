"""Rendered pictures against rays cast one by one, and their truth against what is painted."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from host.config import Camera, Cameras, Strip
from host.perception.lens import View
from host.simulation.pictures.painting import Painter
from host.simulation.pictures.render import Look, Renderer, Surroundings, frames
from host.simulation.pictures.sightings import visible
from host.simulation.pictures.solids import Cylinder, strip_of

CAMERAS = Cameras(strip=Strip(pattern="one_colour"))
PLAIN = Look(noise=0.0, light_spread=0.0, floor_patches=0, wall_patches=0)
NOBODY = np.zeros((0, 2))
# A third of the size is painted and searched nine times faster.
SMALL = Camera(
    width_px=640, height_px=360, focal_px=203.7, centre_x_px=319.5, centre_y_px=179.5, x_m=0.05
)
ODD = SMALL.model_copy(
    update={"heading_rad": 2.0, "tilt_rad": 0.6, "roll_rad": 0.3, "k1": -0.02, "x_m": -0.03}
)


def around(camera: Camera, distance: float, bearing: float) -> np.ndarray:
    """The place (2,) at a distance and bearing from the camera, from its heading."""
    angle = camera.heading_rad + bearing
    return np.array(
        [camera.x_m + distance * math.cos(angle), camera.y_m + distance * math.sin(angle)]
    )


def scene(teammates: object = NOBODY, posts: object = NOBODY, **changes: object) -> Surroundings:
    whole = Surroundings(
        np.asarray(teammates, dtype=float).reshape(-1, 2),
        np.asarray(posts, dtype=float).reshape(-1, 2),
        np.array([0.1, -0.2, 0.4]),
        3.6,
    )
    return replace(whole, **changes)


def is_red(picture: np.ndarray) -> np.ndarray:
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    return (red > 60) & (red > 2 * np.maximum(blue, green))


def strips(picture: np.ndarray, camera: Camera) -> np.ndarray:
    """Which pixels are red and not below 30 deg under the horizon, where the own body is."""
    rows, columns = np.nonzero(is_red(picture))
    up = View(camera).directions_of(np.stack((columns, rows), axis=1).astype(float))[:, 2]
    red = np.zeros(picture.shape[:2], dtype=bool)
    red[rows, columns] = up > math.sin(math.radians(-30.0))
    return red


def cast(view: View, place: np.ndarray, fine: int = 4) -> np.ndarray:
    """Centroid (2,) px of the strip's coat: every finer pixel's ray is met with the cylinder."""
    strip, camera = CAMERAS.strip, view.lens.camera
    radius = 0.5 * strip.diameter_m
    start = view.origin[:2] - place
    middle = view.pixels_of(np.array([[*place, strip.height_m]]))[0]
    reach = int(2.0 * camera.focal_px * radius / math.hypot(*start)) + 6
    low = np.floor(middle).astype(int) - reach
    offsets = (np.arange(2 * reach * fine) + 0.5) / fine - 0.5
    x, y = (grid.ravel() for grid in np.meshgrid(low[0] + offsets, low[1] + offsets))
    rays = np.nan_to_num(view.directions_of(np.stack((x, y), axis=1)))
    a = rays[:, 0] ** 2 + rays[:, 1] ** 2
    b = rays[:, :2] @ start
    root = b * b - a * (start @ start - radius**2)
    way = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    height = view.origin[2] + way * rays[:, 2]
    hit = (root > 0.0) & (way > 0.0) & (np.abs(height - strip.height_m) < 0.5 * strip.tall_m)
    hit &= (x > -0.5) & (x < camera.width_px - 0.5) & (y > -0.5) & (y < camera.height_px - 0.5)
    return np.array([x[hit].mean(), y[hit].mean()])


@pytest.mark.parametrize("turn_rad", [0.0, 0.02])
@pytest.mark.parametrize("camera", [CAMERAS.front, CAMERAS.rear, ODD], ids=["front", "rear", "odd"])
def test_a_strips_painted_middle_is_where_rays_meet_it(camera: Camera, turn_rad: float) -> None:
    view = View(camera)
    random = np.random.default_rng(3)
    for _ in range(6):
        distance, bearing = random.uniform(0.4, 3.0), random.uniform(-1.3, 1.3)
        place = around(camera, distance, bearing)
        coat = strip_of(CAMERAS.strip).faces(place, view.origin, 0.0)[1:]  # without the lid
        middle = np.append(place, CAMERAS.strip.height_m)
        sprite = Painter(view).sprite(coat, middle, turn_rad)
        assert sprite is not None
        cover = sprite.bgra[..., 3].astype(float)
        y, x = np.indices(cover.shape)
        found = np.array([(cover * x).sum(), (cover * y).sum()]) / cover.sum()
        found += (sprite.x, sprite.y)
        true = cast(view, place)
        width = camera.focal_px * CAMERAS.strip.diameter_m / distance
        assert np.hypot(*(found - true)) < 0.1 + 0.001 * width


@pytest.mark.parametrize("camera", [CAMERAS.front, CAMERAS.rear], ids=["front", "rear"])
def test_the_red_of_a_picture_lies_in_the_teammates_bearing(camera: Camera) -> None:
    renderer = Renderer(CAMERAS, camera, replace(PLAIN, noise=3.0), seed=2)
    for number, bearing in enumerate((-1.2, -0.5, 0.0, 0.7, 1.3)):
        place = around(camera, 0.5 + 0.5 * number, bearing)
        posts, pose = NOBODY, np.array([0.0, 0.0, 0.3 * number])
        jpeg = renderer.render(Surroundings(place[None], posts, pose, 3.6, 0.0), number)
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (1080, 1920, 3)
        rows, columns = np.nonzero(strips(picture, camera))
        middle = np.array([[columns.mean(), rows.mean()]])
        x, y, _ = renderer.view.directions_of(middle)[0]
        off = math.atan2(y, x) - camera.heading_rad - bearing
        assert abs(math.remainder(off, math.tau)) < math.radians(0.1)
        truth = visible(renderer.view, CAMERAS.strip, place[None], posts)
        assert math.remainder(truth.bearings[0] - camera.heading_rad - bearing, math.tau) == (
            pytest.approx(0.0, abs=1e-9)
        )


def test_truth_of_places_worked_out_by_hand() -> None:
    view = View(SMALL)  # at x = 0.05, looking ahead
    teammates = np.array([[1.05, 0.0], [2.05, 0.01], [0.05, 1.5], [-1.0, 0.3], [1.05, 1.0]])
    seen = visible(view, CAMERAS.strip, teammates, np.array([[0.85, 0.8]]))
    assert np.degrees(seen.bearings) == pytest.approx([0.0, 0.286, 90.0, 164.055, 45.0], abs=1e-3)
    assert seen.ranges == pytest.approx([1.0, 2.0, 1.5, 1.0920, math.sqrt(2.0)], abs=1e-4)
    in_front, behind_it, at_the_edge, at_the_back, behind_the_post = seen.shares
    assert in_front == 1.0
    assert behind_it < 0.1  # a little is seen over the nearer one
    # 90 deg off the axis is at 91.1 deg there, for it is a little below; it is 3.8 deg wide.
    assert at_the_edge == pytest.approx(0.5 + 1.1 / 3.8, abs=0.05)
    assert at_the_back == 0.0
    assert behind_the_post < 0.2


def test_what_a_cylinder_hides_is_what_the_way_to_it_leads_through() -> None:
    random = np.random.default_rng(4)
    cylinder = Cylinder(0.2, 0.1, 0.3, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    axis, viewpoint = np.array([1.0, 0.2]), np.array([0.0, 0.0, 0.25])
    points = np.array([1.5, 0.2, 0.2]) + random.uniform(-0.7, 0.7, (400, 3)) * (1.0, 1.0, 0.5)
    shares = np.linspace(0.0, 1.0, 4001)[:, None, None]
    ways = viewpoint + shares * (points - viewpoint)
    inside = np.hypot(*(ways[..., :2] - axis).transpose(2, 0, 1)) < cylinder.radius_m
    inside &= (ways[..., 2] > cylinder.bottom_m) & (ways[..., 2] < cylinder.top_m)
    hidden = cylinder.between(axis, viewpoint, points)
    assert 50 < hidden.sum() < 350
    # Where a corner is cut, the steps may be too large to tell.
    unsure = np.count_nonzero(inside, axis=0) < 3
    assert np.array_equal(hidden[~unsure], inside.any(axis=0)[~unsure])
    assert not hidden[unsure & ~inside.any(axis=0)].sum() > 2


@pytest.mark.parametrize("offset_m", [0.0, 0.02, 0.035, 0.06, 0.2])
def test_the_visible_share_is_the_share_of_red_that_a_post_leaves(offset_m: float) -> None:
    camera = CAMERAS.front
    renderer = Renderer(CAMERAS, camera, PLAIN)
    teammate, post = np.array([[1.25, 0.3]]), np.array([[0.65, 0.15 + offset_m]])
    open_view = strips(renderer.picture(scene(teammate), 0), camera).sum()
    left = strips(renderer.picture(scene(teammate, post), 0), camera).sum()
    share = visible(renderer.view, CAMERAS.strip, teammate, post).shares[0]
    assert left / open_view == pytest.approx(share, abs=0.05)


def test_a_nearer_robot_covers_a_farther_one_whatever_their_order() -> None:
    low = SMALL.model_copy(update={"z_m": 0.2})  # or the farther strip is seen over the nearer
    renderer = Renderer(CAMERAS, low, PLAIN)
    pair = np.array([[0.6, 0.0], [1.2, 0.02]])
    one, other = (renderer.picture(scene(p), 0) for p in (pair, pair[::-1]))
    assert np.array_equal(one, other)
    alone = [strips(renderer.picture(scene(p), 0), low) for p in (pair[:1], pair[1:])]
    assert np.array_equal(strips(one, low), alone[0])
    assert alone[1].sum() > 20


def test_the_same_seed_and_number_give_the_same_picture_in_any_order() -> None:
    here = scene([[1.0, 0.5]], [[1.5, 0.0]], turn_rate_radps=1.0)
    first, second = (Renderer(CAMERAS, SMALL, seed=5) for _ in range(2))
    in_order = [first.picture(here, number) for number in range(3)]
    backwards = [second.picture(here, number) for number in (2, 1, 0)][::-1]
    assert all(np.array_equal(a, b) for a, b in zip(in_order, backwards, strict=True))
    assert not np.array_equal(in_order[0], in_order[1])
    other_room = Renderer(CAMERAS, SMALL, seed=6).picture(here, 0)
    assert np.abs(other_room.astype(float) - in_order[0]).mean() > 5.0


def test_light_changes_from_picture_to_picture_and_brightness_scales_all() -> None:
    def means(look: Look) -> np.ndarray:
        renderer = Renderer(CAMERAS, SMALL, look)
        return np.array([renderer.picture(scene(), number).mean() for number in range(0, 90, 10)])

    steady, half = means(PLAIN), means(replace(PLAIN, brightness=0.5))
    assert np.ptp(steady) == 0.0
    assert half == pytest.approx(0.5 * steady, rel=0.02)
    changing = means(replace(PLAIN, light_spread=0.2))
    assert 0.1 < np.ptp(changing) / steady.mean() < 0.6


def test_noise_has_the_std_that_was_asked_for() -> None:
    plain, noisy = (
        Renderer(CAMERAS, SMALL, replace(PLAIN, noise=noise)).picture(scene(), 0).astype(float)
        for noise in (0.0, 4.0)
    )
    bright = plain.min(axis=2) > 20.0
    assert np.std((noisy - plain)[bright]) == pytest.approx(4.0, rel=0.05)


def test_turning_smears_strips_and_walls_but_not_the_own_body() -> None:
    camera = CAMERAS.front
    renderer = Renderer(CAMERAS, camera, replace(PLAIN, exposure_s=0.02))
    still, turning = (
        renderer.picture(scene([[1.5, 0.0]], turn_rate_radps=rate), 0).astype(float)
        for rate in (0.0, 2.0)
    )
    spreads = []
    for picture, rate in ((still, 0.0), (turning, 2.0)):
        empty = renderer.picture(scene(turn_rate_radps=rate), 0).astype(float)
        more = (picture - empty)[:300]  # without the own body
        red = np.maximum(more[..., 2] - more[..., 1], 0.0).sum(axis=0)
        columns = np.arange(len(red))
        middle = red @ columns / red.sum()
        spreads.append(red @ (columns - middle) ** 2 / red.sum())
        assert middle == pytest.approx(camera.centre_x_px, abs=1.0)
    # Of a turn by 0.04 rad the camera, nearer than the robot's middle, sees more; across the axis
    # its lens draws an angle larger by t / sin(t). The variance of a box of that width is added.
    off_axis = math.radians(44.0)
    way = 0.04 * 1.5 / 1.45 * camera.focal_px * off_axis / math.sin(off_axis)
    assert spreads[1] - spreads[0] == pytest.approx(way**2 / 12.0, rel=0.1)
    below = View(camera).pixels_of(np.array([[0.1, 0.0, 0.12]]))[0].astype(int)
    own = np.s_[below[1] + 20 : below[1] + 60, below[0] - 60 : below[0] + 60]
    assert np.array_equal(still[own], turning[own])
    steps = [np.abs(np.diff(picture[100:500], axis=1)).mean() for picture in (still, turning)]
    assert steps[1] < steps[0]


def test_red_things_stay_out_of_the_strips_band_unless_asked_for() -> None:
    def red_in_pictures(share: float) -> tuple[int, int]:
        """Red pixels in the band of the strips and outside, but for the own body's."""
        look = replace(PLAIN, floor_patches=12, wall_patches=12, in_band_share=share)
        renderer = Renderer(CAMERAS, SMALL, look, seed=1)
        inside = outside = 0
        for number in range(12):
            pose = np.array([0.1 * number - 0.6, 0.3, 0.55 * number])
            picture = renderer.picture(scene(pose=pose, half_side_m=2.0), number)
            rows, columns = np.nonzero(is_red(picture))
            pixels = np.stack((columns, rows), axis=1).astype(float)
            up = np.degrees(np.arcsin(renderer.view.directions_of(pixels)[:, 2]))
            # From 0.2 m on, a strip of 0.20 to 0.24 m is seen from 0.25 m at -14 to 0 deg.
            inside += np.count_nonzero((up > -14.0) & (up < 0.0))
            outside += np.count_nonzero(((up > -50.0) & (up < -14.0)) | (up > 0.0))
        return inside, outside

    none_inside, seen = red_in_pictures(0.0)
    assert none_inside == 0
    assert seen > 500
    assert red_in_pictures(1.0)[0] > 500


@pytest.mark.parametrize("lens", ["equidistant", "orthographic"])
def test_a_level_camera_is_not_painted_over_by_what_stands_straight_behind(lens: str) -> None:
    focal = 203.7 if lens == "equidistant" else 320.0
    camera = SMALL.model_copy(update={"tilt_rad": 0.0, "lens": lens, "focal_px": focal})
    renderer = Renderer(CAMERAS, camera, PLAIN)
    empty = renderer.picture(scene(), 0)
    behind = renderer.picture(scene([[-0.4, 0.0], [-2.0, 0.01]], [[-0.3, -0.2]]), 0)
    assert np.array_equal(empty, behind)
    ahead = renderer.picture(scene([[1.0, 0.0]]), 0)
    rows, columns = np.nonzero(is_red(ahead))
    assert len(rows) > 20
    assert columns.mean() == pytest.approx(319.5, abs=1.0)


def test_a_picture_whose_size_is_no_multiple_of_four_is_whole() -> None:
    camera = SMALL.model_copy(update={"width_px": 333, "height_px": 251, "centre_x_px": 166.0})
    assert Renderer(CAMERAS, camera).picture(scene([[1.0, 0.2]]), 0).shape == (251, 333, 3)


def test_frames_give_pictures_with_teammates_where_they_were_asked_for() -> None:
    given = list(frames(5, seed=9, camera=SMALL, teammates=4, ranges_m=(0.5, 2.0)))
    assert len(given) == 5
    for jpeg, truth in given:
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (360, 640, 3)
        assert len(truth.bearings) == len(truth.ranges) == len(truth.shares) == 4
        assert np.all((truth.ranges >= 0.5) & (truth.ranges <= 2.0))
        assert np.all((truth.shares >= 0.0) & (truth.shares <= 1.0))
    again = [jpeg for jpeg, _ in frames(5, seed=9, camera=SMALL, teammates=4, ranges_m=(0.5, 2.0))]
    assert again == [jpeg for jpeg, _ in given]
    assert np.mean([truth.shares.max() for _, truth in given]) > 0.9


def test_a_strip_of_two_colours_is_painted_green_over_magenta() -> None:
    cameras = Cameras(strip=Strip(pattern="two_colours"))
    renderer = Renderer(cameras, SMALL, PLAIN)
    picture = renderer.picture(scene([[0.65, 0.1]]), 0).astype(int)
    for height, (blue, green, red) in ((0.22, (79, 166, 55)), (0.18, (129, 49, 188))):
        facing = np.array([[0.65 - 0.05, 0.1 - 0.01, height]])
        column, row = np.rint(renderer.view.pixels_of(facing)[0]).astype(int)
        seen = picture[row, column] / picture[row, column].sum()
        assert seen == pytest.approx(np.array([blue, green, red]) / (blue + green + red), abs=0.02)
