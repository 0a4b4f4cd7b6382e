"""The search for strips of two colours, in pictures drawn at known bearings."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import Camera, Cameras, Strip
from host.geometry import wrap
from host.perception.strips.blob import Blob
from host.perception.strips.finder import StripFinder
from tests.perception.strips.drawn_strips import (
    GREEN_BGR,
    MAGENTA_BGR,
    STRIP_BGR,
    background,
    draw_coat,
    draw_pair,
    draw_quad,
    encode,
    place,
)

CAMERAS = Cameras(strip=Strip(pattern="two_colours"))
FRONT = CAMERAS.front
GREY_BGR = (110.0, 112.0, 115.0)


def looking(heading_deg: float, tilt_deg: float, **changes: float) -> Camera:
    return Camera(heading_rad=math.radians(heading_deg), tilt_rad=math.radians(tilt_deg), **changes)


MOUNTINGS = {
    "front": FRONT,
    "rear": CAMERAS.rear,
    "level": looking(0.0, 0.0),
    "aside, with a lever arm": looking(70.0, 30.0, x_m=0.08, y_m=-0.05),
    "high, a longer lens": looking(-140.0, 35.0, z_m=0.45, focal_px=700.0, centre_x_px=930.0),
    "below the strip": looking(0.0, 20.0, z_m=0.12),
}


def kept(finder: StripFinder, picture: np.ndarray, quality: int = 80) -> list[Blob]:
    return [blob for blob in finder.blobs(encode(picture, quality)) if blob.kept]


@pytest.fixture(scope="module")
def finder() -> StripFinder:
    return StripFinder(CAMERAS, FRONT)


@pytest.mark.parametrize("camera", MOUNTINGS.values(), ids=MOUNTINGS.keys())
def test_bearings_and_distances_are_those_drawn(camera: Camera) -> None:
    search = StripFinder(CAMERAS, camera)
    scenes = [
        [(-1.1, 0.5), (-0.4, 1.0), (0.1, 2.0), (0.6, 3.5), (1.2, 1.5)],
        [(-0.8, 3.0), (-0.2, 0.4), (0.4, 2.6), (0.9, 0.8), (1.3, 4.0)],
    ]
    for seed, strips in enumerate(scenes):
        picture = background(camera, seed)
        for aside, distance in sorted(strips, key=lambda strip: -strip[1]):
            bearing = camera.heading_rad + aside
            draw_pair(picture, CAMERAS, camera, place(camera, bearing, distance))
        blobs = kept(search, picture)
        assert len(blobs) == len(strips)
        for aside, distance in strips:
            off = [float(wrap(b.bearing_rad - camera.heading_rad - aside)) for b in blobs]
            k = int(np.argmin(np.abs(off)))
            assert abs(off[k]) < math.radians(0.25)
            assert abs(off[k]) < 4.0 * math.sqrt(blobs[k].variance_rad2)
            lens_to_coat = math.hypot(distance, camera.z_m - CAMERAS.strip.height_m)
            assert abs(blobs[k].range_m - lens_to_coat) < 3.0 * blobs[k].range_std_m


def test_the_message_has_what_the_filter_needs(finder: StripFinder) -> None:
    picture = background(FRONT, 3)
    draw_pair(picture, CAMERAS, FRONT, place(FRONT, 0.3, 1.2))
    found = finder.find(encode(picture), 4.5)
    assert found is not None
    assert found.time == 4.5
    assert np.degrees(found.bearings) == pytest.approx([math.degrees(0.3)], abs=0.1)
    assert found.variances[0] >= CAMERAS.bearing_noise_rad**2
    assert found.ranges is not None
    assert found.ranges[0] == pytest.approx(1.2, rel=0.15)
    assert found.view == finder.geometry.view


def test_where_no_strip_is_none_is_found(finder: StripFinder) -> None:
    for seed in range(5):
        assert not finder.blobs(encode(background(FRONT, seed), 50))


@pytest.mark.parametrize(
    "colours",
    [
        (MAGENTA_BGR, GREEN_BGR),
        (GREEN_BGR, GREY_BGR),
        (GREY_BGR, MAGENTA_BGR),
        (GREEN_BGR, GREEN_BGR),
        (STRIP_BGR, STRIP_BGR),
        ((30.0, 30.0, 190.0), (190.0, 60.0, 40.0)),
    ],
    ids=["upside down", "green", "magenta", "all green", "red", "red over blue"],
)
@pytest.mark.parametrize("distance", [0.5, 1.2, 2.5])
def test_other_colours_are_no_strip(
    finder: StripFinder, colours: tuple[tuple[float, ...], ...], distance: float
) -> None:
    picture = background(FRONT, 1)
    upper, lower = colours
    draw_pair(picture, CAMERAS, FRONT, place(FRONT, -0.4, distance), (upper, lower))
    assert not kept(finder, picture)


def test_a_wide_band_of_both_colours_is_no_strip(finder: StripFinder) -> None:
    picture = background(FRONT, 1)
    for aside in np.linspace(-0.35, 0.35, 29):  # a wall, a metre away
        draw_pair(picture, CAMERAS, FRONT, place(FRONT, float(aside), 1.0 / math.cos(aside)))
    assert not kept(finder, picture)


def test_tall_things_in_both_colours_are_no_strip(finder: StripFinder) -> None:
    picture = background(FRONT, 1)
    middle = place(FRONT, 0.2, 1.0)
    draw_coat(picture, FRONT, middle, (0.2, 0.36), 0.1, GREEN_BGR)
    draw_coat(picture, FRONT, middle, (0.04, 0.2), 0.1, MAGENTA_BGR)
    assert not kept(finder, picture)


def test_a_strip_before_a_red_wall_is_found_where_it_is(finder: StripFinder) -> None:
    picture = background(FRONT, 2)
    draw_quad(picture, [(300, 40), (1600, 40), (1600, 700), (300, 700)], (60.0, 55.0, 160.0))
    draw_pair(picture, CAMERAS, FRONT, place(FRONT, 0.25, 1.5))
    (blob,) = kept(finder, picture)
    assert math.degrees(blob.bearing_rad - 0.25) == pytest.approx(0.0, abs=0.15)


@pytest.mark.parametrize("light", [(0.5, 0.8, 1.15), (1.2, 0.95, 0.7), (0.3, 0.3, 0.3)])
def test_warm_cold_and_little_light_leave_the_bearing(
    finder: StripFinder, light: tuple[float, float, float]
) -> None:
    picture = background(FRONT, 2)
    for bearing, distance in ((-0.7, 0.7), (0.0, 1.5), (0.8, 2.6)):
        draw_pair(picture, CAMERAS, FRONT, place(FRONT, bearing, distance))
    picture = np.clip(picture * np.array(light), 0.0, 255.0).astype(np.uint8)
    bearings = np.array([blob.bearing_rad for blob in kept(finder, picture)])
    assert np.degrees(bearings[::-1]) == pytest.approx(np.degrees([-0.7, 0.0, 0.8]), abs=0.2)


def test_a_camera_that_sees_all_around_finds_strips_on_the_seam() -> None:
    camera = looking(30.0, 90.0, z_m=0.6, focal_px=250.0)
    search = StripFinder(CAMERAS, camera)
    picture = background(camera, 0)
    for aside in (-math.pi, -1.5, 0.0, 1.5):
        draw_pair(picture, CAMERAS, camera, place(camera, camera.heading_rad + aside, 0.8))
    bearings = np.array([blob.bearing_rad for blob in kept(search, picture)])
    off = np.sort(np.abs(wrap(bearings - camera.heading_rad)))
    assert off == pytest.approx([0.0, 1.5, 1.5, math.pi], abs=math.radians(0.5))


def test_what_is_too_small_for_the_reach_is_dropped() -> None:
    search = StripFinder(CAMERAS.model_copy(update={"max_range_m": 1.0}), FRONT)
    for distance, count in ((0.9, 1), (2.5, 0)):
        picture = background(FRONT, 4)
        draw_pair(picture, CAMERAS, FRONT, place(FRONT, 0.3, distance))
        assert len(kept(search, picture)) == count


@pytest.mark.parametrize("apart_deg", [5.5, 7.0, 12.0])
def test_two_strips_side_by_side_are_two_bearings(finder: StripFinder, apart_deg: float) -> None:
    picture = background(FRONT, 5)
    true = np.radians([-20.0, -20.0 + apart_deg])
    for bearing in true:
        draw_pair(picture, CAMERAS, FRONT, place(FRONT, float(bearing), 1.8))
    bearings = sorted(blob.bearing_rad for blob in kept(finder, picture))
    assert np.degrees(bearings) == pytest.approx(np.degrees(true), abs=0.25)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-1.5, 1.5),
    st.floats(-math.pi, math.pi),
    st.floats(0.05, 1.5),
    st.floats(60.0, 400.0),
    st.floats(0.05, 1.0),
    st.integers(0, 2**32 - 1),
)
def test_any_mounting_and_any_picture_give_finite_answers(
    tilt: float, roll: float, z: float, focal: float, height: float, seed: int
) -> None:
    camera = Camera(
        width_px=320, height_px=180, focal_px=focal, centre_x_px=159.5, centre_y_px=89.5,
        tilt_rad=tilt, roll_rad=roll, z_m=z,
    )  # fmt: skip
    cameras = Cameras(strip=Strip(pattern="two_colours", height_m=height))
    random = np.random.default_rng(seed)
    coarse = random.choice(np.array([GREEN_BGR, MAGENTA_BGR, GREY_BGR]), (18, 32)).astype(np.uint8)
    picture = np.kron(coarse, np.ones((10, 10, 1), dtype=np.uint8))
    found = StripFinder(cameras, camera).find(encode(picture, 90), 0.0)
    assert found is not None
    assert found.ranges is not None
    assert np.isfinite(found.bearings).all()
    assert (found.variances > 0.0).all()
    assert (found.ranges > 0.0).all()
