"""What the cameras of one robot would find, without pictures: bearings of teammates."""

import math
from dataclasses import replace

import numpy as np

from host.config import Strip
from host.geometry import to_frame, to_parent, wrap
from host.messages import Bearings, BoolArray, FloatArray, IntArray
from host.simulation.world.arena import TURRET_RADIUS_M, Arena
from host.simulation.world.raycast import Beams, meet_boxes
from host.simulation.world.scenarios import Scenario
from host.simulation.world.sensors import robots_own

_STEREO_STEPS_M = np.array([4.0, 7.0])
_STEREO_NOISE = np.array([0.02, 0.04, 0.06])
_FALSE_RANGE_M = (0.3, 6.0)  # by the size of a blob that is no teammate


class SimulatedCamera:
    """The two fisheye cameras of one robot, as one sensor of bearings all around."""

    def __init__(self, arena: Arena, observer: int, scenario: Scenario) -> None:
        self._arena = arena
        self._observer = observer
        self._others = np.delete(np.arange(arena.count), observer)
        self._scenario = scenario
        furniture = arena.furniture
        self._standing = np.concatenate((arena.posts, furniture.legs))
        self._radii = np.append(np.full(len(arena.posts), TURRET_RADIUS_M), furniture.leg_radii)
        # Sight lines run about as high as the strips are.
        self._boxes_hide = furniture.box_top_m > Strip().height_m
        # No filter is given an exact bearing.
        self._variance = math.radians(max(scenario.bearing_noise_deg, 0.1)) ** 2
        self._half_view = 0.5 * math.radians(scenario.camera_view_deg)
        own = robots_own(observer)
        self._random = scenario.generator("camera" + own)
        self._sizes = scenario.generator("strip sizes" + own)

    def bearings(self, time: float) -> Bearings:
        """Return what an image pair taken at `time` (s) shows; call once a frame, in order.

        The variances are those of the scenario's noise. False blobs have identity -1.
        """
        scenario = self._scenario
        (poses,) = self._arena.poses(np.array([time]))
        own = poses[self._observer]
        teammates = to_frame(poses[self._others, :2], own)
        hidden = self._hidden(teammates, own)
        chance = self._detection_probability(teammates) * ~hidden
        seen = self._random.random(len(chance)) < chance
        true = np.arctan2(teammates[:, 1], teammates[:, 0])
        seen &= np.abs(true) <= self._half_view
        noise = math.radians(scenario.bearing_noise_deg) * self._random.standard_normal(len(chance))
        blobs = self._random.uniform(-math.pi, math.pi, self._random.poisson(scenario.false_blobs))
        blobs = blobs[np.abs(blobs) <= self._half_view]
        bearings = np.concatenate((wrap(true + noise)[seen], blobs))
        identities: IntArray = np.concatenate((self._others[seen], np.full(len(blobs), -1)))
        order = self._random.permutation(len(bearings))
        ranges = np.hypot(*teammates[seen].T)
        found = Bearings(
            time,
            bearings[order],
            np.full(len(bearings), self._variance),
            identities=identities[order],
            view=(0.0, self._half_view),
        )
        measured = scenario.stereo or scenario.strip_range_noise
        return self._with_ranges(found, ranges, order) if measured else found

    def _with_ranges(self, found: Bearings, true: FloatArray, order: IntArray) -> Bearings:
        """The readings with ranges by stereo or the strips' sizes; those of false blobs are random.

        true (k,) m: of the teammates, which are the first in `order`.
        """
        noise = self._range_noise(true)
        measured = true * np.maximum(1.0 + noise * self._sizes.standard_normal(len(true)), 0.1)
        false = self._sizes.uniform(*_FALSE_RANGE_M, len(order) - len(true))
        ranges = np.concatenate((measured, false))[order]
        sigmas = self._range_noise(ranges) * ranges
        return replace(found, ranges=ranges, range_variances=sigmas**2)

    def _range_noise(self, ranges: FloatArray) -> FloatArray:
        """Standard deviations (k,) of ranges (k,) m, as shares of them.

        By stereo those of an OAK-D: 2 % below 4 m, 4 % below 7 m, 6 % beyond (Belaroussi 2024,
        section 4.1.2).
        """
        if not self._scenario.stereo:
            return np.full(len(ranges), self._scenario.strip_range_noise)
        return np.asarray(_STEREO_NOISE[np.searchsorted(_STEREO_STEPS_M, ranges, side="right")])

    def _hidden(self, teammates: FloatArray, own: FloatArray) -> BoolArray:
        """Which teammates (n, 2) are behind another, a post, a leg or a box, from `own` (3,)."""
        standing = to_frame(self._standing, own)
        radii = np.concatenate((np.full(len(teammates), TURRET_RADIUS_M), self._radii))
        hidden = hidden_by_cylinders(teammates, np.concatenate((teammates, standing)), radii)
        if self._boxes_hide:
            starts = np.broadcast_to(own[:2], teammates.shape)
            ways = to_parent(teammates, own) - starts
            lengths = np.hypot(*ways.T)
            beams = Beams(starts, starts, ways / lengths[:, None])
            hidden |= meet_boxes(beams, self._arena.furniture.boxes).distances < lengths
        return hidden

    def _detection_probability(self, positions: FloatArray) -> FloatArray:
        """Perera 2021 eq. 30 with its greatest value and half-point as parameters."""
        scenario = self._scenario
        excess = np.hypot(positions[:, 0], positions[:, 1]) - scenario.camera_half_range_m
        probability: FloatArray = scenario.camera_detection / (
            1.0 + np.exp(np.minimum(scenario.camera_steepness_per_m * excess, 50.0))
        )
        return probability


def hidden_by_cylinders(turrets: FloatArray, cylinders: FloatArray, radii: FloatArray) -> BoolArray:
    """Which turrets (n, 2) have half their width behind one nearer cylinder, seen from the origin.

    cylinders (m, 2) with radii (m,), all in m; the turrets are no cylinders unless among them.
    """
    distance = np.hypot(*turrets.T)[:, None]
    half_width = np.arcsin(np.minimum(TURRET_RADIUS_M / distance, 1.0))
    others = np.hypot(*cylinders.T)
    half_others = np.arcsin(np.minimum(radii / others, 1.0))
    bearings = np.arctan2(*turrets.T[::-1])[:, None] - np.arctan2(*cylinders.T[::-1])
    off = np.abs(wrap(bearings))
    covered = np.minimum(half_width, off + half_others) - np.maximum(-half_width, off - half_others)
    behind: BoolArray = np.any((covered > half_width) & (others < distance), axis=1)
    return behind
