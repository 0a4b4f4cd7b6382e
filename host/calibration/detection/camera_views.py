"""Bearings and true paths → every view the cameras had of a teammate, their noise and clutter."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import erf

from host.calibration.detection.lidar_views import LidarSurvey, behind_something
from host.calibration.detection.range_curve import Views
from host.calibration.gathered import Gathered, Tracks, untracked
from host.calibration.robust.statistics import jackknife_sigma, normal_sigma, pieces_of
from host.config import Lidar
from host.geometry import to_frame, wrap
from host.messages import Bearings, BoolArray, FloatArray

GATE_SIGMAS = 3.0  # a bearing is the teammate's this near ...
_CLEAR_SIGMAS = 4.5  # ... and surely not its own beyond this
_CAUGHT = math.erf(GATE_SIGMAS / math.sqrt(2.0))
_NARROWEST_RAD = math.radians(0.3)  # for the noise that gates are made by
_ALONE_RAD = math.radians(45.0)  # so far from others a first look at the noise is safe
_NEAR_M = 2.0
_DIRECTIONS = 720  # in which the part of a picture is measured that is free of teammates
_SCAN_NEAR_S = 0.15  # a scan no older shows what is in the way
_PIECES = 8
_LEAST_SEEN = 16
_LEAST_NOISE_RAD = 5e-4


@dataclass(frozen=True, slots=True)
class CameraSurvey:
    """What one drive's pictures show, held against the truth: pictures (s,), views (n,).

    views: of teammates in view, hidden by nothing and apart from all others. errors (n,) rad: the
    nearest bearing minus the truth, nan where none is in the gate; variances (n,) rad² of it, by
    its pixels alone. gate rad: half its width. times (s,); false (s,): bearings far from every
    teammate; free (s,) rad: how much of the view is. places (f, 2): time (s) and bearing (rad) of
    each false one.
    """

    views: Views
    errors: FloatArray
    variances: FloatArray
    gate: float
    times: FloatArray
    false: FloatArray
    free: FloatArray
    places: FloatArray


class _Pictures:
    """All pictures with the teammates' true positions: (s, m); nan if unknown."""

    def __init__(self, pictures: list[Bearings], tracks: Tracks) -> None:
        self.times = np.array([picture.time for picture in pictures])
        own = tracks.own(self.times)
        known = np.isfinite(own).all(axis=1)
        self.shown = [pictures[k] for k in np.flatnonzero(known)]
        self.times, own = self.times[known], own[known]
        origins = np.array([picture.origin for picture in self.shown]).reshape(-1, 2)
        shape = (len(self.times), len(tracks.identities))
        self.floors = np.zeros((*shape, 2))
        self.distances, self.bearings = np.zeros(shape), np.zeros(shape)
        for j, identity in enumerate(tracks.identities.tolist()):
            self.floors[:, j] = tracks.body(identity, self.times)[:, :2]
            seen = to_frame(self.floors[:, j], own)
            self.distances[:, j] = np.hypot(*seen.T)
            self.bearings[:, j] = np.arctan2(*(seen - origins).T[::-1])
        gaps = np.abs(wrap(self.bearings[:, :, None] - self.bearings[:, None, :]))
        gaps[:, np.arange(shape[1]), np.arange(shape[1])] = math.inf
        # One of whom nothing is known may be anywhere.
        self.gaps = np.where(np.isnan(gaps), 0.0, gaps).min(axis=2, initial=math.inf)
        self.gaps[~np.isfinite(self.bearings)] = 0.0
        # The nearest bearing of each picture to each teammate.
        self.errors, self.variances = np.full(shape, math.inf), np.full(shape, math.nan)
        for s, picture in enumerate(self.shown):
            if len(picture.bearings):
                off = wrap(picture.bearings[:, None] - self.bearings[s])
                best = np.argmin(np.abs(off), axis=0)
                self.errors[s] = np.take_along_axis(off, best[None], axis=0)[0]
                self.variances[s] = picture.variances[best]

    def in_view(self, margin: float) -> BoolArray:
        """Which teammates (s, m) are inside the pictures by a margin (rad)."""
        views = np.array([picture.view for picture in self.shown]).reshape(-1, 2)
        off = np.abs(wrap(self.bearings - views[:, :1]))
        return np.asarray((views[:, 1:] >= math.pi) | (off + margin < views[:, 1:]))

    def spread(self) -> float:
        """Standard deviation (rad) of true bearings, from those near and far from all others."""
        safe = (self.gaps > _ALONE_RAD) & (self.distances < _NEAR_M) & self.in_view(0.1)
        errors = self.errors[safe & (np.abs(self.errors) < 0.5 * _ALONE_RAD)]
        if not len(errors):
            return 0.25 * _ALONE_RAD / GATE_SIGMAS
        return max(normal_sigma(errors), _NARROWEST_RAD)

    def free(self, margin: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """False bearings (s,) and free width (s,) rad of pictures, away from all teammates.

        Third: time and bearing (f, 2) of each. Pictures in which someone's place is unknown give
        none and have no width.
        """
        directions = np.linspace(-math.pi, math.pi, _DIRECTIONS, endpoint=False, dtype=np.float64)
        counts, widths = np.zeros((2, len(self.shown)))
        places: list[tuple[float, float]] = []
        for s, picture in enumerate(self.shown):
            if not np.isfinite(self.bearings[s]).all():
                continue
            free = _away(directions, self.bearings[s], margin)
            centre, half = picture.view
            free &= np.abs(wrap(directions - centre)) <= half
            widths[s] = free.sum() * (math.tau / _DIRECTIONS)
            false = picture.bearings[_away(picture.bearings, self.bearings[s], margin)]
            counts[s] = len(false)
            places.extend((picture.time, float(bearing)) for bearing in false)
        return counts, widths, np.array(places).reshape(-1, 2)


def _away(bearings: FloatArray, teammates: FloatArray, margin: float) -> BoolArray:
    return np.asarray((np.abs(wrap(bearings[:, None] - teammates)) >= margin).all(axis=1))


def survey_cameras(gathered: Gathered, tracks: Tracks, scanned: LidarSurvey | None) -> CameraSurvey:
    """Compare all pictures with motion capture; `scanned` shows what else is in the way.

    Raises UserError where no picture falls into the time in which the robot was tracked.
    """
    pictures = _Pictures(gathered.bearings, tracks)
    if not pictures.shown:
        raise untracked("no picture of the cameras")
    spread = pictures.spread()
    gate = GATE_SIGMAS * spread
    false, free, places = pictures.free(_CLEAR_SIGMAS * spread)
    rate = false.sum() / max(float(free.sum()), 1e-9)
    chosen = np.isfinite(pictures.bearings) & (pictures.gaps > 2.0 * gate)
    chosen &= pictures.in_view(gate)
    chosen &= ~_covered(pictures, scanned, gathered.config.lidar)
    s, j = np.nonzero(chosen)
    seen = np.abs(pictures.errors[s, j]) < gate
    views = Views(
        times=pictures.times[s],
        teammates=tracks.identities[j],
        distances=pictures.distances[s, j],
        bearings=pictures.bearings[s, j],
        seen=seen,
        caught=np.full(len(s), _CAUGHT),
        mistaken=np.full(len(s), 1.0 - math.exp(-rate * 2.0 * gate)),
    )
    known = gathered.config.camera.bearing_noise_rad**2
    return CameraSurvey(
        views,
        np.where(seen, pictures.errors[s, j], math.nan),
        np.maximum(pictures.variances[s, j] - known, 0.0),
        gate,
        pictures.times,
        false,
        free,
        places,
    )


def _covered(pictures: _Pictures, scanned: LidarSurvey | None, lidar: Lidar) -> BoolArray:
    """Which teammates (s, m) are behind something that the scan of that moment shows."""
    covered = np.zeros(pictures.distances.shape, dtype=bool)
    if scanned is None:
        return covered
    # Samples are on average half a revolution older than its end.
    half = 0.5 * float(np.median(np.diff(scanned.times))) if len(scanned.times) > 1 else 0.0
    middle = scanned.times - half
    scan = np.searchsorted(0.5 * (middle[1:] + middle[:-1]), pictures.times, side="right")
    near = np.abs(middle[scan] - pictures.times) < _SCAN_NEAR_S
    for j in range(covered.shape[1]):
        seen = to_frame(pictures.floors[:, j], scanned.robots[scan])
        known = near & np.isfinite(seen).all(axis=1)
        covered[known, j] = behind_something(seen[known], scanned.clearances[scan[known]], lidar)
    return covered


def bearing_noise(survey: CameraSurvey, chosen: BoolArray) -> tuple[float, float]:
    """Noise (rad) beside the pixels' own, and the mean error (rad), of the chosen (n,) views.

    Maximum likelihood of normal errors, cut off at the gate, with a share of false bearings among
    them. nan where too few were seen.
    """
    seen = survey.views.seen & chosen
    if seen.sum() < _LEAST_SEEN:
        return math.nan, math.nan
    errors, variances, gate = survey.errors[seen], survey.variances[seen], survey.gate

    def cost(parameters: FloatArray) -> float:
        noise, mean, logit = parameters
        false = 1.0 / (1.0 + math.exp(-logit))
        total = np.exp(2.0 * noise) + variances
        inside = np.maximum(erf(gate / np.sqrt(2.0 * total)), 1e-9)
        normal = np.exp(-0.5 * (errors - mean) ** 2 / total) / np.sqrt(math.tau * total) / inside
        return -float(np.log((1.0 - false) * normal + false / (2.0 * gate)).sum())

    scale = math.log(gate / GATE_SIGMAS)
    found = minimize(
        cost,
        np.array([scale, 0.0, -4.0]),
        method="L-BFGS-B",
        bounds=((math.log(_LEAST_NOISE_RAD), scale + 2.0), (-gate, gate), (-9.0, 2.0)),
    )
    return math.exp(float(found.x[0])), float(found.x[1])


def bearing_noise_sigma(survey: CameraSurvey) -> float:
    """Standard deviation (rad) of the noise of all views, a jackknife over pieces of the drive."""
    piece = pieces_of(survey.views.times, _PIECES)
    others = [bearing_noise(survey, piece != k)[0] for k in range(_PIECES)]
    return float(jackknife_sigma(np.array(others)))
