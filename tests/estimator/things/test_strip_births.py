"""Teammates that only the cameras see: where strips may be, and how well `pmb` knows them."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from host.config import Cameras, FilterSettings, PmbSettings
from host.estimator.pmb import PmbFilter
from host.estimator.things.strip_births import StripBirths
from host.messages import Bearings, Displacement, Positions

BEARING_STD, SIZE_STD = math.radians(2.0), 0.1
PICTURE_S = 0.1


def picture(time, place, random, sizes=True):
    """A strip at `place` (2,) m in the robot's frame."""
    bearing = math.atan2(place[1], place[0]) + BEARING_STD * random.standard_normal()
    distance = np.hypot(*place) * (1.0 + SIZE_STD * random.standard_normal())
    seen = Bearings(time, np.array([bearing]), np.array([BEARING_STD**2]))
    if not sizes:
        return seen
    ranges = np.array([distance])
    return replace(seen, ranges=ranges, range_variances=(SIZE_STD * ranges) ** 2)


def places_of(births, picture):
    return births.places(picture, births.elapsed(picture))


def test_a_size_gives_a_place_with_the_spread_of_bearing_and_range():
    seen = Bearings(
        1.0,
        np.array([2.5]),
        np.array([0.01**2]),
        origin=(0.3, -0.2),
        ranges=np.array([1.5]),
        range_variances=np.array([0.05**2]),
    )
    places = places_of(StripBirths(Cameras(), 0.001), seen)
    random = np.random.default_rng(1)
    bearings = 2.5 + 0.01 * random.standard_normal(200_000)
    ranges = 1.5 + 0.05 * random.standard_normal(200_000)
    drawn = np.stack((0.3 + ranges * np.cos(bearings), -0.2 + ranges * np.sin(bearings)))
    assert places.positions[0] == pytest.approx(drawn.mean(axis=1), abs=1e-3)
    assert places.covariances[0] == pytest.approx(np.cov(drawn), rel=0.02, abs=1e-5)


@pytest.mark.parametrize("revolutions", [-140, -2, -1, 1, 140])
def test_a_bearing_need_not_be_wrapped(revolutions):
    """Messages may hold angles up to 1000 rad: they mean the same place."""
    plain = picture(1.0, (-1.0, 0.4), np.random.default_rng(1))
    wound = replace(plain, bearings=plain.bearings + revolutions * math.tau)
    births = [places_of(StripBirths(Cameras(), 0.1), each) for each in (plain, wound)]
    for of_plain, of_wound in zip(astuple(births[0]), astuple(births[1]), strict=True):
        assert of_wound == pytest.approx(of_plain, abs=1e-9)


def test_the_pieces_of_a_ray_cover_what_teammates_may_be_on_it():
    """Whoever appears in the view is on a piece: the intensity is that of the piece's area."""
    everywhere = Cameras(half_range_m=10.0, detection_probability=0.98, range_steepness_per_m=50.0)
    births = StripBirths(everywhere, appear_per_m2_s=0.5)
    places_of(births, Bearings(0.0, np.zeros(0), np.zeros(0)))
    places = places_of(births, Bearings(0.2, np.array([0.4]), np.array([0.01])))
    distances = np.hypot(*places.positions.T)
    nearest, farthest = 0.3, 0.3 * 2.0**3.5
    assert nearest < distances.min() < distances.max() < farthest
    expected = 0.5 * 0.2 * 0.98 * 0.5 * (farthest**2 - nearest**2)
    assert places.of_readings(1) == pytest.approx([expected])


def test_the_same_picture_again_begins_nobody():
    births = StripBirths(Cameras(), 0.001)
    random = np.random.default_rng(2)
    places_of(births, picture(1.0, (1.0, 0.5), random))
    assert places_of(births, picture(1.0, (1.0, 0.5), random)).of_readings(1) == pytest.approx(
        [0.0]
    )


def test_while_the_lidar_scans_strips_begin_nobody():
    filter_, random = PmbFilter(), np.random.default_rng(3)
    for step in range(30):
        time = PICTURE_S * step
        filter_.predict(Displacement(time, PICTURE_S, 0.0, 0.0, 0.0))
        filter_.update(Positions(time, np.zeros((0, 2)), np.zeros((0, 2, 2))))
        filter_.update(picture(time, (1.0, 0.5), random))
    assert len(filter_.estimate().positions) == 0


def test_who_is_seen_by_cameras_alone_is_known_as_well_as_its_covariance_says():
    """NEES of a teammate that drives past, over 20 runs: 2 dof, so 2 on average."""
    nees = []
    for seed in range(20):
        filter_, random = PmbFilter(), np.random.default_rng(seed)
        place, velocity = np.array([1.5, -0.8]), np.array([-0.05, 0.2])
        for step in range(60):
            time = PICTURE_S * step
            filter_.predict(Displacement(time, PICTURE_S, 0.0, 0.0, 0.0))
            filter_.update(picture(time, place + velocity * time, random))
        estimate = filter_.estimate()
        assert len(estimate.positions) == 1, f"seed {seed}"
        off = estimate.positions[0] - place - velocity * time
        assert np.hypot(*off) < 0.4, f"seed {seed}"
        assert estimate.ages[0] < 0.2, f"seed {seed}"
        nees.append(off @ np.linalg.solve(estimate.covariances[0], off))
    assert 0.4 < np.mean(nees) < 3.2


def test_without_sizes_a_teammate_is_known_as_badly_as_its_covariance_says():
    """By bearings alone one that may drive has no sure range, even from a robot that drives by.

    It is not reported where 0.5 m count as badly as none; where 3 m do, it is.
    """
    patient = FilterSettings(pmb=PmbSettings(report_error_m=3.0))
    good, runs = 0, 10
    for seed in range(runs):
        usual, filter_, random = PmbFilter(), PmbFilter(patient), np.random.default_rng(seed)
        place, speed = np.array([0.3, 1.2]), 0.3
        for step in range(60):
            time = PICTURE_S * step
            seen = picture(time, place - (speed * time, 0.0), random, sizes=False)
            for each in (usual, filter_):
                each.predict(Displacement(time, PICTURE_S, speed * PICTURE_S, 0.0, 0.0))
                each.update(seen)
        assert len(usual.estimate().positions) == 0, f"seed {seed}"
        estimate = filter_.estimate()
        assert len(estimate.positions) == 1, f"seed {seed}"
        off = estimate.positions[0] - place + (speed * time, 0.0)
        good += off @ np.linalg.solve(estimate.covariances[0], off) < 5.99  # 95 %
    assert good >= 8
