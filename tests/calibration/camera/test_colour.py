"""The strip's colour learnt from drawn pictures."""

import colorsys
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.calibration.camera import colour as strip_colour
from host.config import Cameras, Strip
from host.errors import UserError
from host.perception.jpeg_decoder import decode
from host.perception.strips.finder import StripFinder
from host.perception.strips.geometry import StripGeometry
from tests.perception.strips.drawn_strips import background, draw_coat, draw_strip, encode, place

CAMERA = Cameras(strip=Strip(pattern="one_colour"))
FRONT = CAMERA.front
SIZE = (FRONT.width_px, FRONT.height_px)


def painted(hue_deg: float, saturation: float, value: float) -> tuple[float, ...]:
    red, green, blue = colorsys.hsv_to_rgb(hue_deg / 360.0, saturation, value)
    return 255.0 * blue, 255.0 * green, 255.0 * red


def scene(colour: tuple[float, ...], seed: int = 0) -> bytes:
    picture = background(FRONT, seed)
    for bearing, distance in ((0.3, 0.8), (-0.9, 1.2)):
        draw_strip(picture, CAMERA, FRONT, place(FRONT, bearing, distance), colour)
    return encode(picture)


def reduced(jpeg: bytes) -> strip_colour.Image:
    return decode(jpeg, SIZE, FRONT.height_px)


@pytest.mark.parametrize(
    ("hue", "saturation", "value"), [(358.0, 0.8, 0.8), (12.0, 0.6, 0.4), (340.0, 0.9, 0.6)]
)
def test_the_range_learnt_holds_the_paint_and_its_half_and_double_light(
    hue: float, saturation: float, value: float
) -> None:
    picture = reduced(scene(painted(hue, saturation, value)))
    geometry = StripGeometry(CAMERA, FRONT)
    pixels = strip_colour.pixels_of_best_blob(picture, CAMERA.strip, geometry)
    learnt = strip_colour.learn(pixels, CAMERA.strip)
    off = (learnt.hue_deg - hue + 180.0) % 360.0 - 180.0
    assert abs(off) < 0.25 * learnt.hue_width_deg
    assert 20.0 <= learnt.hue_width_deg < 50.0
    assert 0.4 * saturation < learnt.saturation_min < saturation
    assert learnt.value_min < 0.5 * value
    finder = StripFinder(CAMERA.model_copy(update={"strip": learnt}), FRONT)
    for light in (0.5, 1.0, 2.0):
        lit = scene(painted(hue, saturation, min(light * value, 1.0)), 1)
        found = [blob.bearing_rad for blob in finder.blobs(lit) if blob.kept]
        assert sorted(found) == pytest.approx([-0.9, 0.3], abs=0.01)


def test_a_box_teaches_any_colour_although_it_holds_background() -> None:
    jpeg = scene(painted(215.0, 0.8, 0.7))
    (blob, _) = StripFinder(Cameras(strip=Strip(pattern="one_colour", hue_deg=215.0)), FRONT).blobs(
        jpeg
    )
    box = (round(blob.x) - 60, round(blob.y) - 50, 120, 100)
    learnt = strip_colour.learn(strip_colour.pixels_in_box(reduced(jpeg), box), CAMERA.strip)
    assert learnt.hue_deg == pytest.approx(215.0, abs=5.0)
    assert (learnt.height_m, learnt.tall_m) == (CAMERA.strip.height_m, CAMERA.strip.tall_m)


def test_red_where_no_strip_can_be_teaches_nothing() -> None:
    picture = background(FRONT, 3)
    draw_coat(picture, FRONT, place(FRONT, 0.2, 0.8), (0.0, 0.03), 0.1)
    geometry = StripGeometry(CAMERA, FRONT)
    pixels = strip_colour.pixels_of_best_blob(reduced(encode(picture)), CAMERA.strip, geometry)
    assert len(pixels) == 0
    with pytest.raises(UserError, match="--box"):
        strip_colour.learn(pixels, CAMERA.strip)


def test_a_grey_box_is_refused() -> None:
    grey = np.full((100, 3), 120, np.uint8)
    with pytest.raises(UserError, match="no strip's colour"):
        strip_colour.learn(grey, CAMERA.strip)


def test_the_drawing_boxes_what_is_found() -> None:
    jpeg = scene(painted(0.0, 0.8, 0.8))
    finder = StripFinder(CAMERA, FRONT)
    blobs = finder.blobs(jpeg)
    drawn = strip_colour.annotate(jpeg, blobs, finder.geometry)
    assert drawn.shape == (*SIZE[::-1], 3)
    for blob in blobs:
        x, y = round(blob.x), round(blob.y - 0.5 * blob.height - 6.0)
        blue, green, red = drawn[y - 1 : y + 2, x].astype(int).max(axis=0)
        assert green > red + 30
        assert green > blue + 30
        assert math.isfinite(blob.bearing_rad)


def test_other_kinds_of_pictures_are_turned_into_jpegs(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    picture = background(FRONT, 1)
    path.write_bytes(bytes(cv2.imencode(".png", picture)[1]))
    seen = cv2.imdecode(np.frombuffer(strip_colour.read_picture(path), np.uint8), 1)
    assert np.abs(seen.astype(int) - picture).mean() < 4.0
    for text in (b"", b"no picture"):
        path.write_bytes(text)
        with pytest.raises(UserError, match="not a picture"):
            strip_colour.read_picture(path)
    with pytest.raises(UserError, match="cannot read"):
        strip_colour.read_picture(tmp_path / "absent.jpg")
