"""One camera of a simulation, offline: rendered pictures, searched as real ones are."""

import dataclasses
import math
from typing import Literal

import numpy as np

from host.config import Camera, Cameras
from host.geometry import wrap
from host.messages import Bearings, IntArray
from host.perception.strips.finder import StripFinder
from host.simulation.pictures.render import Renderer, Surroundings
from host.simulation.pictures.sightings import Sightings, visible

_SLACK_RAD = math.radians(2.0)


class SearchedCamera:
    """What the search finds in the pictures of one camera, and whom it found, by the truth.

    known: the cameras as the search knows them; true: as they are.
    """

    def __init__(
        self, name: Literal["front", "rear"], known: Cameras, true: Cameras, seed: int
    ) -> None:
        self._strip = true.strip
        known_camera: Camera = getattr(known, name)
        true_camera: Camera = getattr(true, name)
        self._renderer = Renderer(true, true_camera, seed=seed)
        self._finder = StripFinder(known, known_camera, name=name)

    def bearings(
        self, scene: Surroundings, identities: IntArray, time: float, number: int
    ) -> Bearings | None:
        """Search picture `number`, taken of `scene` at `time` (s).

        identities (n,): the teammates of the scene. None if the picture could not be used.
        """
        jpeg = self._renderer.render(scene, number)
        found = self._finder.find(jpeg, time)
        if found is None:
            return None
        truth = visible(
            self._renderer.view,
            self._strip,
            scene.teammates,
            scene.posts,
            scene.furniture,
            scene.bins,
        )
        return dataclasses.replace(found, identities=self._identify(found, truth, identities))

    def _identify(self, found: Bearings, truth: Sightings, identities: IntArray) -> IntArray:
        """The teammate whose strip each bearing (k,) meets, the nearest in view; -1: none."""
        shown = truth.shares > 0.0
        none = np.full(len(found.bearings), -1)
        if not shown.any():
            return none
        half = 0.5 * self._strip.diameter_m / truth.ranges[shown]
        off = np.abs(wrap(found.bearings[:, None] - truth.bearings[shown]))
        # A strip hidden in part is seen beside its middle.
        off = np.where(off < half + _SLACK_RAD, off, np.inf)
        named: IntArray = identities[shown][np.argmin(off, axis=1)]
        return np.where(np.isfinite(off.min(axis=1)), named, none)
