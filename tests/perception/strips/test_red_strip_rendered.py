"""The search for strips in rendered pictures of both cameras, against the scene's truth."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from host.config import Cameras, Strip
from host.geometry import wrap
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.render import Look, Renderer, Surroundings
from host.simulation.pictures.sightings import visible

SEED = 7
SCENES = 40
RANGES_M = (0.4, 3.0)
TEAMMATES, POSTS = 4, 2
MATCH_RAD = math.radians(5.0)
CAMERAS = Cameras(strip=Strip(pattern="one_colour"))


@dataclass
class Tally:
    """errors: of each bearing that meets a teammate, rad. hit: of the teammates in plain view."""

    errors: list[float] = field(default_factory=list)
    hit: list[bool] = field(default_factory=list)
    false: int = 0
    pictures: int = 0


def scatter(random: np.random.Generator) -> np.ndarray:
    """Places (n, 2) m all around the robot, none in or before another's body."""
    places: list[np.ndarray] = []
    while len(places) < TEAMMATES + POSTS:
        angle, distance = random.uniform(-math.pi, math.pi), random.uniform(*RANGES_M)
        place = distance * np.array([math.cos(angle), math.sin(angle)])
        if all(np.hypot(*(place - other)) > 0.35 for other in places):
            places.append(place)
    return np.array(places)


def search(look: Look, scenes: int) -> Tally:
    """Search both cameras' pictures of random scenes, red things outside the band included."""
    random = np.random.default_rng(SEED)
    both = (CAMERAS.front, CAMERAS.rear)
    renderers = [Renderer(CAMERAS, camera, look, SEED) for camera in both]
    finders = [StripFinder(CAMERAS, camera) for camera in both]
    tally = Tally()
    for number in range(scenes):
        things = scatter(random)
        teammates, posts = things[:TEAMMATES], things[TEAMMATES:]
        pose = np.array([0.1, -0.2, random.uniform(-math.pi, math.pi)])
        turn_rate = random.uniform(-1.0, 1.0)
        scene = Surroundings(teammates, posts, pose, 3.6, turn_rate)
        shown, hit = np.zeros(TEAMMATES), np.zeros(TEAMMATES, dtype=bool)
        for renderer, finder in zip(renderers, finders, strict=True):
            jpeg = renderer.render(scene, number)
            found = finder.find(jpeg, 0.0)
            assert found is not None
            truth = visible(renderer.view, CAMERAS.strip, teammates, posts)
            shown = np.maximum(shown, truth.shares)
            off = np.where(truth.shares > 0.0, 1.0, math.inf) * wrap(
                found.bearings[:, None] - truth.bearings
            )
            nearest = np.argmin(np.abs(off), axis=1)
            error = off[np.arange(len(off)), nearest]
            meets = np.abs(error) < MATCH_RAD
            hit[nearest[meets]] = True
            tally.errors += list(error[meets])
            tally.false += int(np.sum(~meets))
            tally.pictures += 1
        tally.hit += list(hit[shown > 0.6])
    return tally


@pytest.mark.slow
@pytest.mark.parametrize("brightness", [0.5, 1.0, 2.0])
def test_strips_all_around_are_found_where_they_are(brightness: float) -> None:
    tally = search(Look(brightness=brightness), SCENES)
    errors = np.degrees(np.abs(tally.errors))
    figures = (
        f"seed {SEED}: recall {np.mean(tally.hit):.3f} of {len(tally.hit)}, error "
        f"{np.median(errors):.3f} median {np.percentile(errors, 95):.3f} p95 deg, "
        f"{tally.false / tally.pictures:.3f} false a picture"
    )
    print(figures)
    assert len(tally.hit) > 80
    assert np.mean(tally.hit) >= 0.95, figures
    assert np.median(errors) <= 0.3, figures
    assert np.percentile(errors, 95) <= 1.0, figures
    assert tally.false / tally.pictures <= 0.05, figures
