"""Pixel ↔ ray against single rays in plain Python, OpenCV's fisheye model, and round trips."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from host.config import Camera
from host.messages import FloatArray
from host.perception.lens import Lens, View

LENSES = {
    "as built": Camera(),
    "barrel": Camera(k1=-0.08, k2=0.004),
    "pincushion": Camera(k1=0.06, k2=0.01, focal_px=300.0, centre_x_px=500.0, centre_y_px=410.0),
    "grows, then folds": Camera(k1=0.05, k2=-0.01),
    "folds before 90 deg": Camera(k1=-0.2),
    "nearly level midway": Camera(k1=-0.447, k2=0.1),
    "orthographic": Camera(lens="orthographic", focal_px=960.0),
}
every_lens = pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
EQUIDISTANT = [camera for camera in LENSES.values() if camera.lens == "equidistant"]


def ray(off_axis_rad: float, around_rad: float) -> FloatArray:
    """A unit ray at an angle from the axis, towards a direction of the picture (0 is right)."""
    across = math.sin(off_axis_rad)
    return np.array(
        [across * math.cos(around_rad), across * math.sin(around_rad), math.cos(off_axis_rad)]
    )


def pixel_by_hand(camera: Camera, off_axis: float, around: float) -> tuple[float, float]:
    if camera.lens == "orthographic":
        radius = camera.focal_px * math.sin(off_axis)
    else:
        radius = camera.focal_px * (off_axis + camera.k1 * off_axis**3 + camera.k2 * off_axis**5)
    return (
        camera.centre_x_px + radius * math.cos(around),
        camera.centre_y_px + radius * math.sin(around),
    )


def fold_by_search(camera: Camera) -> float:
    """Where the radius stops growing, by looking at small steps."""
    if camera.lens == "orthographic":
        return math.pi / 2
    angles = np.linspace(0.0, math.pi, 200_001)
    radii = angles + camera.k1 * angles**3 + camera.k2 * angles**5
    falling = np.flatnonzero(np.diff(radii) <= 0.0)
    return float(angles[falling[0]]) if len(falling) else math.pi


@every_lens
def test_single_rays_meet_the_picture_where_the_formula_says(camera: Camera) -> None:
    lens = Lens(camera)
    for off_axis in np.linspace(0.0, lens.limit_rad - 1e-6, 19):
        for around in (-2.5, -0.3, 0.0, 0.7, math.pi / 2, 3.0):
            expected = pixel_by_hand(camera, off_axis, around)
            length = 0.01 + 100.0 * abs(around)  # a ray's length does not matter
            (pixel,) = lens.project(length * ray(off_axis, around)[None])
            np.testing.assert_allclose(pixel, expected, atol=1e-8)


@every_lens
def test_the_limit_is_where_the_radius_stops_growing(camera: Camera) -> None:
    assert Lens(camera).limit_rad == pytest.approx(fold_by_search(camera), abs=4e-5)


@given(
    camera=st.sampled_from(list(LENSES.values())),
    off_axis=st.floats(0.0, math.pi),
    around=st.floats(-math.pi, math.pi),
)
def test_a_ray_comes_back_from_its_pixel(camera: Camera, off_axis: float, around: float) -> None:
    lens = Lens(camera)
    assume(off_axis < lens.limit_rad - 1e-3)  # the inverse is as steep as one likes at the fold
    expected = ray(off_axis, around)
    pixels = lens.project(expected[None])
    (found,) = lens.unproject(pixels)
    np.testing.assert_allclose(found, expected, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(found), 1.0, atol=1e-12)


@given(
    k1=st.floats(-0.99, 0.99),
    k2=st.floats(-0.99, 0.99),
    share=st.floats(0.0, 1.0),
    around=st.floats(-math.pi, math.pi),
)
def test_every_pixel_up_to_the_farthest_comes_back_from_its_ray(
    k1: float, k2: float, share: float, around: float
) -> None:
    lens = Lens(Camera(k1=k1, k2=k2))
    angle = share * lens.limit_rad
    radius = float(lens.radius(np.array([angle]))[0])
    assert radius >= 0.0
    (found,) = lens.angle(np.array([radius]))
    assert 0.0 <= found <= lens.limit_rad
    assert lens.radius(np.array([found]))[0] == pytest.approx(radius, rel=1e-12, abs=1e-9)
    pixels = np.array([pixel_by_hand(lens.camera, angle, around)])
    rays = lens.unproject(pixels)
    assume(angle < math.pi - 1e-6)  # straight behind is a circle of pixels
    if np.isfinite(rays).all():  # the pixel itself is rounded, at the fold perhaps outwards
        # The pixel is known to 1e-13 of its place; the ray's direction moves it by its radius.
        np.testing.assert_allclose(lens.project(rays), pixels, rtol=1e-9, atol=1e-6)
    else:
        assert share > 1.0 - 1e-6


@every_lens
def test_beyond_the_limit_there_is_neither_pixel_nor_ray(camera: Camera) -> None:
    lens = Lens(camera)
    if lens.limit_rad < math.pi:
        outside = np.array([ray(lens.limit_rad + d, 1.0) for d in (1e-9, 0.01, 0.3)])
        assert np.isnan(lens.project(outside)).all()
    farthest = float(lens.radius(np.array([lens.limit_rad]))[0])
    beyond = lens.unproject(
        np.array([[camera.centre_x_px + farthest * 1.0001, camera.centre_y_px]])
    )
    assert np.isnan(beyond).all()
    within = lens.unproject(
        np.array([[camera.centre_x_px + farthest * 0.9999, camera.centre_y_px]])
    )
    assert np.isfinite(within).all()


def test_what_is_no_direction_has_no_pixel_and_harms_no_other() -> None:
    lens = Lens(Camera())
    rays = np.array(
        [[0, 0, 0], [0, 0, -1], [math.nan, 0, 1], [math.inf, math.inf, 1], [0, 0, 2], [1, 0, 0]],
        dtype=float,
    )
    pixels = lens.project(rays)
    assert np.isnan(pixels[:4]).any(axis=1).all()
    np.testing.assert_allclose(pixels[4:], [[959.5, 539.5], [959.5 + 611.15 * math.pi / 2, 539.5]])
    rays = lens.unproject(np.array([[math.nan, 0.0], [math.inf, 0.0], [959.5, 539.5]]))
    assert np.isnan(rays[:2]).all()
    np.testing.assert_array_equal(rays[2], [0.0, 0.0, 1.0])
    assert lens.project(np.zeros((0, 3))).shape == (0, 2)
    assert lens.unproject(np.zeros((0, 2))).shape == (0, 3)


@pytest.mark.parametrize("camera", EQUIDISTANT)
def test_opencv_draws_the_same_below_80_deg(camera: Camera) -> None:
    lens = Lens(camera)
    rng = np.random.default_rng(4)
    off_axis = rng.uniform(0.0, min(math.radians(80.0), lens.limit_rad), 500)
    rays = np.array([ray(a, b) for a, b in zip(off_axis, rng.uniform(-3.1, 3.1, 500), strict=True)])
    matrix = np.array(
        [
            [camera.focal_px, 0, camera.centre_x_px],
            [0, camera.focal_px, camera.centre_y_px],
            [0, 0, 1],
        ]
    )
    theirs, _ = cv2.fisheye.projectPoints(
        rays[:, None], np.zeros(3), np.zeros(3), matrix, np.array([camera.k1, camera.k2, 0.0, 0.0])
    )
    np.testing.assert_allclose(lens.project(rays), theirs[:, 0], atol=1e-7)


def pixel(camera: Camera, x: float, y: float, z: float) -> FloatArray:
    return View(camera).pixels_of(np.array([[x, y, z]], dtype=float))[0]


LEVEL = Camera(x_m=0.0, y_m=0.0, z_m=0.25, tilt_rad=0.0)
TILTED = LEVEL.model_copy(update={"tilt_rad": math.radians(45.0)})
QUARTER_PX = 611.15 * math.pi / 4  # what 45 deg are in the picture


def test_left_is_left_and_up_is_up() -> None:
    np.testing.assert_allclose(pixel(LEVEL, 1, 0, 0.25), [959.5, 539.5], atol=1e-9)
    np.testing.assert_allclose(pixel(LEVEL, 1, 1, 0.25), [959.5 - QUARTER_PX, 539.5], atol=1e-9)
    np.testing.assert_allclose(pixel(LEVEL, 1, -1, 0.25), [959.5 + QUARTER_PX, 539.5], atol=1e-9)
    np.testing.assert_allclose(pixel(LEVEL, 1, 0, 1.25), [959.5, 539.5 - QUARTER_PX], atol=1e-9)
    np.testing.assert_allclose(pixel(LEVEL, 0.25, 0, 0), [959.5, 539.5 + QUARTER_PX], atol=1e-9)


def test_a_tilt_of_45_deg_puts_the_horizon_ahead_at_its_row() -> None:
    np.testing.assert_allclose(pixel(TILTED, 9, 0, 0.25), [959.5, 539.5 - QUARTER_PX], atol=1e-9)
    np.testing.assert_allclose(pixel(TILTED, 0.25, 0, 0), [959.5, 539.5], atol=1e-9)
    # The floor below the lens, and the horizon to the sides: at 90 deg, to left and right.
    np.testing.assert_allclose(pixel(TILTED, 0, 0, 0), [959.5, 539.5 + QUARTER_PX], atol=1e-9)
    np.testing.assert_allclose(
        pixel(TILTED, 0, 3, 0.25), [959.5 - 2 * QUARTER_PX, 539.5], atol=1e-9
    )


def test_the_rear_camera_sees_the_robots_left_on_its_right() -> None:
    rear = Camera(x_m=-0.05, heading_rad=math.pi, tilt_rad=0.0)
    np.testing.assert_allclose(pixel(rear, -1.05, 0, 0.25), [959.5, 539.5], atol=1e-9)
    np.testing.assert_allclose(pixel(rear, -1.05, 1, 0.25), [959.5 + QUARTER_PX, 539.5], atol=1e-9)


def test_rolled_clockwise_the_picture_turns_the_other_way() -> None:
    rolled = LEVEL.model_copy(update={"roll_rad": math.pi / 2})
    # Up in the room is left in the picture of a camera that lies on its right side.
    np.testing.assert_allclose(pixel(rolled, 1, 0, 1.25), [959.5 - QUARTER_PX, 539.5], atol=1e-9)
    np.testing.assert_allclose(pixel(rolled, 1, 1, 0.25), [959.5, 539.5 + QUARTER_PX], atol=1e-9)


def turn(axis: str, angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


@given(
    heading=st.floats(-math.pi, math.pi),
    tilt=st.floats(-math.pi / 2, math.pi / 2),
    roll=st.floats(-math.pi, math.pi),
)
def test_the_mounting_is_three_turns_one_after_the_other(
    heading: float, tilt: float, roll: float
) -> None:
    level = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # right is -y, down is -z, axis is x
    expected = turn("z", heading) @ turn("y", tilt) @ turn("x", roll) @ level
    view = View(Camera(heading_rad=heading, tilt_rad=tilt, roll_rad=roll))
    np.testing.assert_allclose(view.to_robot, expected, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(view.to_robot), 1.0, atol=1e-12)


@given(
    heading=st.floats(-math.pi, math.pi),
    tilt=st.floats(-1.5, 1.5),
    x=st.floats(60.0, 1860.0),
    y=st.floats(0.0, 1079.0),
    distance=st.floats(0.05, 10.0),
)
def test_a_point_along_a_pixels_direction_is_drawn_at_the_pixel(
    heading: float, tilt: float, x: float, y: float, distance: float
) -> None:
    view = View(
        Camera(x_m=0.07, y_m=-0.03, z_m=0.31, heading_rad=heading, tilt_rad=tilt, roll_rad=0.2)
    )
    pixels = np.array([[x, y]])
    points = view.origin + distance * view.directions_of(pixels)
    np.testing.assert_allclose(view.pixels_of(points), pixels, atol=1e-6)


def test_bearings_beyond_the_known_angle_carry_its_noise() -> None:
    lens = Lens(Camera(focal_px=500.0, reach_rad=1.0, beyond_noise_per_rad=2.0))
    radii = np.array([0.0, 450.0, 499.9, 550.0, 700.0])
    pixels = np.column_stack((959.5 + radii * 0.6, 539.5 - radii * 0.8))
    expected = [0.0, 0.0, 0.0, (2.0 * 0.1**2) ** 2, (2.0 * 0.4**2) ** 2]
    np.testing.assert_allclose(lens.extrapolation_variances(pixels), expected, atol=1e-12)
    folded = Lens(Camera(k1=-0.2, reach_rad=0.5, beyond_noise_per_rad=1.0))
    assert folded.extrapolation_variances(np.array([[0.0, 0.0]])).tolist() == [0.0]
    assert not Lens(Camera()).extrapolation_variances(pixels).any()
    assert lens.extrapolation_variances(np.zeros((0, 2))).shape == (0,)
