"""Strips of two colours in rendered rooms that imitate one: recall, false ones, bearings.

A cheap part of what tools/strip_scenes.py measures; the seeds are not those of its figures.
"""

import math

import cv2
import numpy as np
import pytest

from host.config import Cameras
from host.geometry import wrap
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.scenes import scene_frames

SEED, PICTURES = 31, 3
ROOMS = ("brick", "carpet", "orange_floor", "shelves", "warm_wood", "cold", "dark", "fringes")
FOUND_RAD = math.radians(3.0)


@pytest.mark.slow
def test_strips_are_found_and_nothing_else_is() -> None:
    cameras = Cameras()
    assert cameras.strip.pattern == "two_colours"
    cv2.setNumThreads(1)
    finder = StripFinder(cameras, cameras.front)
    errors: list[float] = []
    asked = false = 0
    for room in ROOMS:
        for jpeg, truth in scene_frames(room, PICTURES, SEED, cameras):
            found = np.array([blob.bearing_rad for blob in finder.blobs(jpeg) if blob.kept])
            seen = truth.bearings[truth.shares > 0.0]
            apart = np.abs(wrap(found[:, None] - seen))
            false += int(np.sum(apart.min(axis=1, initial=math.inf) > FOUND_RAD))
            for bearing in truth.bearings[truth.shares >= 0.95]:
                asked += 1
                error = float(np.abs(wrap(found - bearing)).min(initial=math.inf))
                if error <= FOUND_RAD:
                    errors.append(math.degrees(error))
    figures = f"seed {SEED}: {len(errors)} of {asked} found, {false} false, errors {errors}"
    assert asked > 45, figures
    assert len(errors) >= 0.95 * asked, figures
    assert false <= 0.1 * len(ROOMS) * PICTURES, figures
    assert np.percentile(errors, 95) <= 0.3, figures
