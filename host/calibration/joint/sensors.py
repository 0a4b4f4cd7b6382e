"""What each sensor says about the unknowns of the joint fit: the residuals of the single fits.

Wheels are misses of windows of two seconds, the lidar's are turrets beside teammates, the cameras'
strips beside where they are drawn. Each is divided by its own noise, measured from it; where a
fit leaves out or trusts less, so does this.
"""

from functools import partial
from typing import Protocol

import numpy as np

from host.calibration.camera.fit import CameraFit, CameraProblem
from host.calibration.camera.model import NAMES, slopes
from host.calibration.camera.noise import measured
from host.calibration.camera.pairs import Captured
from host.calibration.camera.uncertainty import evidence_of
from host.calibration.gathered import Tracks
from host.calibration.joint.unknowns import Unknowns
from host.calibration.lidar.search import Turrets, places_of, recognised
from host.calibration.robust.evidence import Evidence, correlated
from host.calibration.robust.statistics import plane_sigma
from host.calibration.robust.time_offset import CORRELATED_S, linearise
from host.calibration.wheels.fit import OWN, Fit, WheelProblem
from host.calibration.wheels.model import Drive, misses
from host.messages import FloatArray, IntArray


class Sensor(Protocol):
    """One sensor's readings in the joint fit."""

    def evidence(self, values: FloatArray) -> Evidence:
        """What the readings say near values (p,) of the unknowns."""


class WheelEvidence:
    """Of the wheels' ticks: on their own values, and on how the tracked body lies."""

    def __init__(
        self, unknowns: Unknowns, drives: list[Drive], found: Fit, problem: WheelProblem
    ) -> None:
        self._unknowns, self._drives, self._found = unknowns, drives, found
        self._problem = problem

    def evidence(self, values: FloatArray) -> Evidence:
        """What the windows say; they are those of the single fit, with its sigmas."""
        found, part = self._found, self._unknowns.wheels
        own = values[part]
        wrong = misses(self._drives, found.counts, own, found.windows) / found.sigmas
        rows = self._problem.slopes(own, found.sigmas, found.used)
        size = len(self._unknowns)
        information, scatter = np.zeros((2, size, size))
        gradient = np.zeros(size)
        information[part, part] = OWN * np.einsum("wij,wik->jk", rows, rows)
        scatter[part, part] = OWN**2 * self._problem.scatter(rows, wrong)
        gradient[part] = OWN * np.einsum("wij,wi->j", rows, wrong)
        return Evidence(information, gradient, scatter, np.zeros((size, 0)))


class LidarEvidence:
    """Of turrets that the lidar saw where a teammate was."""

    def __init__(self, unknowns: Unknowns, tracks: Tracks, seen: Turrets) -> None:
        self._unknowns, self._tracks, self._seen = unknowns, tracks, seen

    def evidence(self, values: FloatArray) -> Evidence:
        """What the turrets say, trusted less the farther they are off (Tukey's weights)."""
        seen, part = self._seen, self._unknowns.lidar
        own = values[part]
        tracks = self._unknowns.tracks(self._tracks, values)
        who = recognised(seen, tracks, own)
        truth = partial(places_of, tracks, who)
        off, own_rows, weights, bends = linearise(seen.points, seen.times, seen.sigmas, truth, own)
        known = weights > 0.0
        times = seen.times[known]
        then = times - own[3]
        places = places_of(tracks, who[known], then)
        rows = -self._unknowns.slopes_of_places(tracks, values, who[known], then, places)
        rows[:, :, part] = own_rows[known]
        sigmas = seen.sigmas[known]
        noise = plane_sigma(np.hypot(*off[known].T) / sigmas)
        off, rows = off[known] / sigmas[:, None], rows / sigmas[:, None, None]
        weights, bends = weights[known] / noise**2, bends[known] / noise**2
        pulls = np.einsum("na,nai->ni", off, rows)
        bends = (pulls.T * bends) @ pulls
        rows *= np.sqrt(weights)[:, None, None]
        return correlated(times, weights[:, None] * pulls, rows, CORRELATED_S, bends=bends)


class CameraEvidence:
    """Of strips that the cameras saw where a teammate was."""

    def __init__(
        self, unknowns: Unknowns, tracks: Tracks, problem: CameraProblem, found: CameraFit
    ) -> None:
        self._unknowns, self._tracks, self._problem = unknowns, tracks, problem
        self._noise = found.noise
        self._fitted = np.array(found.fitted)

    def evidence(self, values: FloatArray) -> Evidence:
        """What the strips say that are near a teammate as drawn; their noise is measured again."""
        part = self._unknowns.cameras
        own = values[part]
        tracks = self._unknowns.tracks(self._tracks, values)
        problem = self._problem.against(Captured(tracks))
        pairs, used = problem.chosen(own, self._noise)
        used &= self._fitted[pairs.strips.cameras]
        free = np.append(np.repeat(self._fitted, len(NAMES)), True)
        self._noise = measured(own, pairs, used, free, self._noise)
        cameras, times = pairs.strips.cameras[used], pairs.strips.times[used]
        own_rows = slopes(own, pairs)[used]
        who = tracks.identities[pairs.mates[used]]
        places = pairs.points[used, :2]
        moved = self._unknowns.slopes_of_places(tracks, values, who, times - own[-1], places)
        rows = np.einsum("nij,njk->nik", _by_point(own_rows, cameras), moved)
        rows[:, :, part] = own_rows
        return evidence_of(own, pairs, used, self._noise, rows)


def _by_point(rows: FloatArray, cameras: IntArray) -> FloatArray:
    """Derivatives (n, 2, 2) of errors by a strip's x, y; rows (n, 2, 23): by the cameras' values.

    A strip that moves is drawn as by a camera that moves the other way.
    """
    at = len(NAMES) * cameras + NAMES.index("x_m")
    every = np.arange(len(rows))
    return np.asarray(-np.stack((rows[every, :, at], rows[every, :, at + 1]), axis=2))
