"""Strips whose colour moved away from the calibrated one, in pictures drawn for it."""

import colorsys
import re

import cv2
import numpy as np
import pytest

from host.config import RobotConfig, Strip
from host.messages import Bearings
from host.sources.strip_colour import StripColour

SMALL = {"width_px": 640, "height_px": 360, "focal_px": 203.7}
SMALL |= {"centre_x_px": 319.5, "centre_y_px": 179.5}
PLACES = np.array([[200.0, 180.0], [420.0, 170.0]])


def picture(hue_deg: float, seed: int) -> bytes:
    """Two strips of a hue before a grey and wooden room, with noise."""
    random = np.random.default_rng(seed)
    image = np.full((360, 640, 3), (110.0, 120.0, 125.0))
    image[220:] = (60.0, 110.0, 160.0)
    red, green, blue = colorsys.hsv_to_rgb(hue_deg % 360.0 / 360.0, 0.85, 0.8)
    for x, y in PLACES.astype(int):
        image[y - 8 : y + 8, x - 10 : x + 10] = 255.0 * np.array([blue, green, red])
    noisy = np.clip(image + random.normal(0.0, 5.0, image.shape), 0, 255).astype(np.uint8)
    return bytes(cv2.imencode(".jpg", noisy)[1])


def judged(hue_deg: float, strip: Strip) -> list[str]:
    colour = StripColour(strip, RobotConfig().camera.front.model_copy(update=SMALL))
    assert colour.remarks() == []
    for number in range(4):
        seen = Bearings(float(number), np.zeros(2), np.ones(2), camera="front", pixels=PLACES)
        colour.take(picture(hue_deg, number), seen)
    return colour.remarks()


@pytest.mark.parametrize("calibrated", [0.0, 8.0, 230.0])
@pytest.mark.parametrize("off", [-15.0, -5.0, 0.0, 6.0, 16.0])
def test_a_colour_near_the_end_of_its_range_is_named(calibrated: float, off: float) -> None:
    strip = Strip(pattern="one_colour", hue_deg=calibrated, hue_width_deg=40.0)
    remarks = judged(calibrated + off, strip)
    assert len(remarks) == (abs(off) > 10.0)
    for remark in remarks:
        (said,) = re.findall(r"(\d+) deg off", remark)
        assert int(said) == pytest.approx(abs(off), abs=4)
        assert ": swarmloc calibrate colour" in remark


def test_strips_of_two_colours_have_no_calibrated_one() -> None:
    assert judged(0.0, Strip()) == []
