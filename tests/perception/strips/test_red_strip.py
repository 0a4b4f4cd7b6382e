"""Strips in pictures: bearings against the truth, what is dropped and why, and torn pictures."""

import math
import random

import cv2
import numpy as np
import pytest

from host.config import Camera, Cameras, Strip
from host.geometry import wrap
from host.messages import Image
from host.perception.strips.blob import Blob
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.render import Look, frames
from tests.perception.strips.drawn_strips import (
    STRIP_BGR,
    background,
    draw_coat,
    draw_quad,
    draw_strip,
    encode,
    pixel_of,
    place,
)

CAMERAS = Cameras(strip=Strip(pattern="one_colour"))
FRONT, REAR = CAMERAS.front, CAMERAS.rear


@pytest.fixture(scope="module")
def finder() -> StripFinder:
    return StripFinder(CAMERAS, FRONT)


def kept(blobs: list[Blob]) -> list[Blob]:
    return [blob for blob in blobs if blob.kept]


def apart_deg(found: float, true: float) -> float:
    return math.degrees(abs(float(wrap(found - true))))


@pytest.mark.parametrize("camera", [FRONT, REAR], ids=["front", "rear"])
@pytest.mark.parametrize("brightness", [0.5, 1.0, 2.0])
def test_bearings_all_around_are_the_drawn_ones(camera: Camera, brightness: float) -> None:
    search = StripFinder(CAMERAS, camera)
    numbers = np.random.default_rng(7)
    for picture_number in range(4):
        picture = background(camera, picture_number)
        wanted = camera.heading_rad + np.array([-1.35, -0.7, 0.0, 0.6, 1.3])
        wanted += numbers.uniform(-0.15, 0.15, 5)
        distances = numbers.uniform(0.4, 3.0, 5)
        for bearing, distance in zip(wanted, distances, strict=True):
            draw_strip(picture, CAMERAS, camera, place(camera, bearing, distance))
        picture = np.clip(picture * brightness, 0, 255).astype(np.uint8)
        bearings = search.find(encode(picture), 3.5)
        assert bearings is not None
        assert (bearings.time, bearings.origin) == (3.5, (camera.x_m, camera.y_m))
        assert len(bearings.bearings) == 5
        errors = [min(apart_deg(b, true) for b in bearings.bearings) for true in wanted]
        assert max(errors) < 0.3
        assert np.all(bearings.variances >= CAMERAS.bearing_noise_rad**2)
        assert np.all((bearings.bearings >= -math.pi) & (bearings.bearings < math.pi))
    assert search.counts == {"pictures": 4, "strips": 20}


def test_the_middle_of_a_blob_is_where_the_strip_was_drawn(finder: StripFinder) -> None:
    for bearing, distance in ((0.0, 1.2), (1.2, 1.5), (-0.8, 2.5)):
        picture = background(FRONT, 1)
        draw_strip(picture, CAMERAS, FRONT, place(FRONT, bearing, distance))
        (blob,) = kept(finder.blobs(encode(picture)))
        x, y = pixel_of(np.append(place(FRONT, bearing, distance), 0.22), FRONT)
        assert math.hypot(blob.x - x, blob.y - y) < 1.5


def test_size_tells_the_distance_within_its_std(finder: StripFinder) -> None:
    for distance in (0.4, 0.8, 1.5, 3.0):
        picture = background(FRONT, 2)
        draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.4, distance))
        (blob,) = kept(finder.blobs(encode(picture)))
        assert abs(blob.range_m - distance) < 2.0 * blob.range_std_m
        assert blob.range_std_m < 0.3 * distance


def drop_reasons(finder: StripFinder, picture: Image) -> list[str]:
    blobs = finder.blobs(encode(picture))
    assert not kept(blobs)
    return [blob.reason for blob in blobs]


def test_what_cannot_be_a_strip_is_dropped_with_its_reason(finder: StripFinder) -> None:
    cases = {
        "above_band": (place(FRONT, 1.2, 1.5), (0.5, 0.6), 0.1),
        "below_band": (place(FRONT, 0.2, 0.8), (0.0, 0.03), 0.1),
        "too_large": (place(FRONT, 0.2, 1.0), (0.05, 0.4), 1.2),
        "too_wide": (place(FRONT, 0.2, 2.0), (0.2, 0.24), 0.35),
        "too_tall": (place(FRONT, 0.2, 1.0), (0.13, 0.31), 0.03),
    }
    for reason, (middle, heights, diameter) in cases.items():
        picture = background(FRONT, 3)
        draw_coat(picture, FRONT, middle, heights, diameter)
        assert drop_reasons(finder, picture) == [reason]
        assert finder.counts[f"dropped_{reason}"] == 1


def test_what_is_too_small_for_the_reach_is_dropped() -> None:
    picture = background(FRONT, 3)
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.2, 2.0))
    near_only = StripFinder(CAMERAS.model_copy(update={"max_range_m": 1.0}), FRONT)
    assert drop_reasons(near_only, picture) == ["too_small"]


def test_red_on_the_own_body_is_no_teammate() -> None:
    low = Camera(z_m=0.2, tilt_rad=1.2)  # such a camera has its bonnet in the rows where strips are
    search = StripFinder(CAMERAS, low)
    picture = background(low, 4)
    x, y = pixel_of(np.array([0.16, 0.0, 0.0]), low)
    assert y < search.geometry.rows - 12
    cv2.rectangle(picture, (int(x) - 30, int(y) - 8), (int(x) + 30, int(y) + 8), STRIP_BGR, -1)
    assert drop_reasons(search, picture) == ["own_body"]


def test_a_strip_behind_a_thin_post_is_one_bearing(finder: StripFinder) -> None:
    picture = background(FRONT, 5)
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, -0.5, 0.8))
    draw_coat(picture, FRONT, place(FRONT, -0.5, 0.6), (0.0, 0.5), 0.02, (120, 120, 120))
    (blob,) = finder.blobs(encode(picture))
    assert blob.kept
    assert apart_deg(blob.bearing_rad, -0.5) < 1.0


def test_two_strips_side_by_side_are_two_bearings(finder: StripFinder) -> None:
    picture = background(FRONT, 6)
    for bearing in (0.5, 0.62):
        draw_strip(picture, CAMERAS, FRONT, place(FRONT, bearing, 1.2))
    blobs = kept(finder.blobs(encode(picture)))
    assert sorted(blob.bearing_rad for blob in blobs) == pytest.approx([0.5, 0.62], abs=0.006)


def test_half_a_strip_says_that_its_middle_may_be_aside(finder: StripFinder) -> None:
    picture = background(FRONT, 7)
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.3, 1.0))
    whole = kept(finder.blobs(encode(picture)))[0]
    draw_coat(picture, FRONT, place(FRONT, 0.37, 0.7), (0.0, 0.5), 0.1, (30, 30, 30))
    half = kept(finder.blobs(encode(picture)))[0]
    assert half.variance_rad2 > 10.0 * whole.variance_rad2
    assert abs(half.bearing_rad - 0.3) < 3.0 * math.sqrt(half.variance_rad2)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("aside_deg", [30.0, -30.0, 14.0, 50.0])
def test_a_big_red_thing_does_not_take_over_a_strip_beside_it(
    finder: StripFinder, seed: int, aside_deg: float
) -> None:
    numbers = np.random.default_rng(seed)
    bearing, distance = numbers.uniform(-0.6, 0.6), numbers.uniform(0.4, 3.0)
    picture = background(FRONT, seed)
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, bearing, distance))
    big = place(FRONT, bearing + math.radians(aside_deg), 0.5)
    if distance < 0.7 and abs(aside_deg) < 20.0:
        return  # they would touch
    draw_coat(picture, FRONT, big, (0.0, 0.45), 0.16)
    blobs = finder.blobs(encode(picture))
    (strip,) = kept(blobs)
    assert apart_deg(strip.bearing_rad, bearing) < 0.3
    assert [blob.reason for blob in blobs if not blob.kept] == ["too_tall"]


@pytest.mark.parametrize("thing", [(0.1, 0.34, 0.1), (0.17, 0.27, 0.4), (0.0, 0.3, 1.0)])
def test_no_other_red_thing_takes_a_strip_over_either(
    finder: StripFinder, thing: tuple[float, float, float]
) -> None:
    low, high, diameter = thing
    for gap_deg in (4.0, 15.0, 30.0):
        picture = background(FRONT, 9)
        draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.2, 1.5))
        half_width = math.asin(0.5 * diameter / 2.0) + math.asin(0.05 / 1.5)
        aside = 0.2 - half_width - math.radians(gap_deg)
        draw_coat(picture, FRONT, place(FRONT, aside, 2.0), (low, high), diameter)
        found = [blob.bearing_rad for blob in kept(finder.blobs(encode(picture)))]
        assert min(apart_deg(bearing, 0.2) for bearing in found) < 0.3


def test_half_a_strip_near_by_and_a_whole_one_farther_away_are_two(finder: StripFinder) -> None:
    picture = background(FRONT, 10)
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.3, 0.8))
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.205, 1.9))
    draw_coat(picture, FRONT, place(FRONT, 0.255, 0.6), (0.0, 0.5), 0.026, (30, 30, 30))
    found = [blob.bearing_rad for blob in kept(finder.blobs(encode(picture)))]
    assert len(found) == 2
    assert min(apart_deg(bearing, 0.205) for bearing in found) < 0.3
    assert min(apart_deg(bearing, 0.3) for bearing in found) < 1.5


def test_small_things_on_the_floor_near_by_are_at_no_strips_height(finder: StripFinder) -> None:
    for distance in (1.3, 1.6, 2.0):  # where the floor is within the band of strips
        picture = background(FRONT, 11)
        middle = place(FRONT, 0.3, distance)
        draw_coat(picture, FRONT, middle, (0.0, 0.02), 0.05)
        assert drop_reasons(finder, picture) == ["wrong_height"]


@pytest.mark.parametrize("size_px", [2.0, 3.5, 5.0])
def test_specks_are_no_strips(finder: StripFinder, size_px: float) -> None:
    picture = background(FRONT, 12)
    x, y = pixel_of(np.append(place(FRONT, 0.3, 4.0), 0.22), FRONT)
    left, top = 4 * round(x / 4), 4 * round(y / 4)
    draw_quad(
        picture,
        [(left + dx * size_px, top + dy * size_px) for dx, dy in ((0, 0), (1, 0), (1, 1), (0, 1))],
        STRIP_BGR,
    )
    assert not kept(finder.blobs(encode(picture, 95)))


def test_a_patch_of_a_red_wall_that_passes_by_a_hair_is_background(finder: StripFinder) -> None:
    picture = background(FRONT, 13)
    draw_coat(picture, FRONT, place(FRONT, 0.2, 2.0), (0.0, 0.6), 1.0, (112.0, 112.0, 195.0))
    draw_strip(picture, CAMERAS, FRONT, place(FRONT, 0.2, 1.4), (98.0, 98.0, 195.0))
    assert "like_background" in drop_reasons(finder, picture)


def test_another_colour_by_configuration() -> None:
    cameras = Cameras(strip=Strip(pattern="one_colour", hue_deg=215.0, hue_width_deg=40.0))
    search = StripFinder(cameras, FRONT)
    picture = background(FRONT, 8)
    draw_strip(picture, cameras, FRONT, place(FRONT, 0.3, 1.0), (200, 90, 20))
    draw_strip(picture, cameras, FRONT, place(FRONT, -0.3, 1.0))
    (blob,) = search.blobs(encode(picture))
    assert apart_deg(blob.bearing_rad, 0.3) < 0.3


def test_view_is_what_the_picture_shows_of_the_horizon() -> None:
    centre, half = StripFinder(CAMERAS, FRONT).geometry.view
    assert (centre, half) == pytest.approx((0.0, math.pi / 2), abs=0.02)
    centre, half = StripFinder(CAMERAS, REAR).geometry.view
    assert abs(wrap(centre - math.pi)) < 0.02
    narrow = Camera(
        focal_px=611.15, width_px=1280, centre_x_px=639.5, heading_rad=0.7, tilt_rad=0.0
    )
    centre, half = StripFinder(CAMERAS, narrow).geometry.view
    assert (centre, half) == pytest.approx((0.7, 640 / 611.15), abs=0.02)


@pytest.mark.parametrize("heading", [0.0, 3.1])
def test_what_a_steep_camera_shows_on_both_sides_but_not_ahead_is_not_in_view(
    heading: float,
) -> None:
    camera = Camera(tilt_rad=0.95, heading_rad=heading)
    centre, half = StripFinder(CAMERAS, camera).geometry.view
    assert half > 0.5
    offsets = np.linspace(-math.pi, math.pi, 181)
    for offset in offsets[np.abs(offsets) < half]:
        x, y = pixel_of(np.append(place(camera, centre + offset, 2.0), 0.22), camera)
        assert -0.5 <= x <= camera.width_px - 0.5
        assert -0.5 <= y <= camera.height_px - 0.5


def test_a_short_reach_does_not_widen_the_view() -> None:
    centre, half = StripFinder(CAMERAS.model_copy(update={"max_range_m": 1.0}), FRONT).geometry.view
    assert (centre, half) == pytest.approx((0.0, math.pi / 2), abs=0.06)


def test_a_camera_that_looks_away_from_the_horizon_finds_nothing() -> None:
    search = StripFinder(CAMERAS, Camera(tilt_rad=1.57, focal_px=1200.0))
    bearings = search.find(encode(background(FRONT, 9)), 0.0)
    assert bearings is not None
    assert len(bearings.bearings) == 0
    assert search.geometry.view[1] == 0.0


def small_camera() -> Camera:
    return Camera(width_px=384, height_px=208, focal_px=122.0, centre_x_px=191.5, centre_y_px=103.5)


def small_jpegs(count: int) -> list[bytes]:
    jpegs = []
    for number in range(count):
        picture = background(small_camera(), number)
        for bearing in (-0.6, 0.5):
            draw_strip(picture, CAMERAS, small_camera(), place(small_camera(), bearing, 0.5))
        jpegs.append(encode(picture))
    return jpegs


def test_ten_thousand_damaged_pictures() -> None:
    search, numbers = StripFinder(CAMERAS, small_camera()), random.Random(4)  # the seed
    jpegs = small_jpegs(5)
    true = [[blob.bearing_rad for blob in kept(search.blobs(jpeg))] for jpeg in jpegs]
    assert all(len(bearings) == 2 for bearings in true)
    search.counts.clear()
    for number in range(10_000):
        which = number % len(jpegs)
        jpeg, kind = jpegs[which], number // len(jpegs) % 4
        place_in = numbers.randrange(len(jpeg))
        if kind == 0:
            assert search.find(jpeg[:place_in], 0.0) is None
        elif kind == 1:
            found = search.find(jpeg[:place_in] + b"\xff\xd9", 0.0)
            # Where only rows below the wanted ones are cut off, those above are as they were.
            assert found is None or list(found.bearings) == pytest.approx(true[which])
        elif kind == 2:
            damaged = bytearray(jpeg)
            for _ in range(numbers.randrange(1, 20)):
                damaged[numbers.randrange(len(jpeg))] ^= 1 << numbers.randrange(8)
            search.find(bytes(damaged), 0.0)
        else:
            head = jpeg[: numbers.choice((0, 2, 20, 623))]
            assert search.find(head + numbers.randbytes(place_in), 0.0) is None
    assert search.counts.pop("pictures") == 10_000
    unused = {name: n for name, n in search.counts.items() if name.startswith("pictures_")}
    assert set(unused) <= {
        "pictures_not_jpeg",
        "pictures_torn",
        "pictures_wrong_size",
        "pictures_overfull",
    }
    assert sum(unused.values()) > 7_000


def test_a_picture_all_in_the_strips_colour_is_survived(finder: StripFinder) -> None:
    red = np.full((1080, 1920, 3), STRIP_BGR, np.uint8)
    assert finder.find(encode(red), 0.0) is not None
    speckled = (
        np.random.default_rng(0).integers(0, 2, (270, 480, 1)).astype(np.uint8) * red[::4, ::4]
    )
    speckled = cv2.resize(speckled, (1920, 1080), interpolation=cv2.INTER_NEAREST)
    assert finder.find(encode(speckled), 0.0) is not None


@pytest.mark.parametrize("grey", [0, 128])
def test_grey_that_the_configured_range_lets_in_is_no_strip(grey: int) -> None:
    everything = Strip(pattern="one_colour", hue_width_deg=180.0, saturation_min=0.0, value_min=0.0)
    search = StripFinder(Cameras(strip=everything), small_camera())
    picture = np.full((small_camera().height_px, small_camera().width_px, 3), grey, np.uint8)
    assert drop_reasons(search, picture) == ["colourless"]


@pytest.mark.parametrize("brightness", [0.5, 1.0, 2.0])
def test_rendered_pictures(brightness: float) -> None:
    search = StripFinder(CAMERAS, FRONT)
    errors, asked, false = [], 0, 0
    pictures = list(frames(25, 21, CAMERAS, look=Look(brightness=brightness, noise=4.0)))
    for jpeg, truth in pictures:
        found = np.array([blob.bearing_rad for blob in kept(search.blobs(jpeg))])
        apart = np.degrees(np.abs(wrap(found[:, None] - truth.bearings)))
        false += np.count_nonzero(apart.min(axis=1, initial=180.0) > 5.0)
        for k in np.flatnonzero(truth.shares > 0.9):
            asked += 1
            if apart[:, k].min(initial=180.0) < 3.0:
                errors.append(apart[:, k].min())
    assert len(errors) >= 0.95 * asked > 30
    assert false <= 0.05 * len(pictures)
    assert np.median(errors) <= 0.3
    assert np.percentile(errors, 95) <= 1.0
