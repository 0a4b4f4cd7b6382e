"""How well calibrated cameras measure bearings, sector by sector, and which sectors have no views.

Single values of a lens and its mounting say little: height and tilt, or focal length and k1, are
hardly separable and need not be. What counts is the bearing that they give together.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.fit import CameraFit
from host.calibration.camera.model import NAMES, STEPS, row_of
from host.calibration.camera.pairs import CAMERAS
from host.config import Camera, Cameras
from host.geometry import wrap
from host.messages import BoolArray, FloatArray
from host.perception.lens import View

SECTOR_DEG = 15
LEAST_VIEWS = 2  # pairs in a sector
_RANGES_M = np.array([0.5, 1.0, 2.0])  # at which bearings are judged
_SURE = 2.0  # sigmas from which on a mean error is one of the model


@dataclass(frozen=True, slots=True)
class BearingSector:
    """Some of the bearings that one camera shows: from `first_deg` to 15 deg more, robot frame.

    pairs: that the fit used there. sigma_rad: predicted error of a bearing there, and what the
    pairs there are off together (of a lens that is not of the model's family).
    """

    camera: str
    first_deg: int
    pairs: int
    sigma_rad: float

    @property
    def left(self) -> bool:
        """Whether it is on the robot's left."""
        return self.first_deg >= 0

    @property
    def bounds_deg(self) -> tuple[int, int]:
        """Its bounds, counted from straight ahead."""
        other = self.first_deg + SECTOR_DEG
        return (self.first_deg, other) if self.left else (-other, -self.first_deg)

    @property
    def name(self) -> str:
        """Such as "60 to 75 deg left"."""
        low, high = self.bounds_deg
        return f"{low} to {high} deg {'left' if self.left else 'right'}"


def points_around(bearings: FloatArray, height_m: float) -> FloatArray:
    """Points (n, 3, 3) m at three ranges for each of `bearings` (n,) rad, robot frame."""
    x = np.cos(bearings)[:, None] * _RANGES_M
    y = np.sin(bearings)[:, None] * _RANGES_M
    return np.stack((x, y, np.full_like(x, height_m)), axis=-1)


def shown_sectors(camera: Camera, height_m: float) -> list[int]:
    """First bearings (deg) of the sectors in whose middle a camera shows strips, at any range.

    What it shows more than 90 deg aside of its heading, in the picture's corners, is the other
    camera's part.
    """
    firsts = np.arange(-180, 180, SECTOR_DEG)
    middles = np.radians(firsts + 0.5 * SECTOR_DEG)
    points = points_around(middles, height_m)
    inside = in_picture(camera, View(camera).pixels_of(points.reshape(-1, 3)))
    inside = np.asarray(inside.reshape(len(firsts), -1).all(axis=1))
    inside &= np.abs(wrap(middles - camera.heading_rad)) <= 0.5 * math.pi
    kept: list[int] = firsts[inside].tolist()
    return kept


def in_picture(camera: Camera, pixels: FloatArray) -> BoolArray:
    """Which of pixels (n, 2) are in the picture; nan is not."""
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0.0) & (pixels < (camera.width_px, camera.height_px))
    return np.asarray(inside.all(axis=1))


def sectors_of(fit: CameraFit, number: int, cameras: Cameras) -> list[BearingSector]:
    """The sectors of one camera, as it is fitted (where it is not: as it is configured)."""
    off = bearing_errors(fit.cameras[number], fit.pairs.at(fit.delay), fit.pairs.strips.pixels)
    mine = fit.used & (fit.pairs.strips.cameras == number) & np.isfinite(off)
    place = np.degrees(bearings_of(fit)[mine])
    off = off[mine]
    found = []
    for first in shown_sectors(fit.cameras[number], cameras.strip.height_m):
        inside = (place >= first) & (place < first + SECTOR_DEG)
        sigma = math.hypot(_predicted(fit, number, first, cameras), _aside(off[inside]))
        found.append(BearingSector(CAMERAS[number], first, int(np.count_nonzero(inside)), sigma))
    return found


def bearings_of(fit: CameraFit) -> FloatArray:
    """True bearings (n,) rad of all pairs in the robot frame."""
    x, y, _ = fit.pairs.at(fit.delay).T
    return np.asarray(np.arctan2(y, x))


def bearing_errors(camera: Camera, points: FloatArray, pixels: FloatArray) -> FloatArray:
    """Bearings (n,) rad that `pixels` (n, 2) mean, less those of `points` (n, 3)."""
    x, y, _ = View(camera).directions_of(pixels).T
    return np.asarray(
        wrap(np.arctan2(y, x) - np.arctan2(points[:, 1] - camera.y_m, points[:, 0] - camera.x_m))
    )


def pair_errors(fit: CameraFit, cameras: Sequence[Camera], delay: float) -> FloatArray:
    """Errors (n,) rad of all pairs' bearings, had the cameras been these, and so late (s)."""
    strips, points = fit.pairs.strips, fit.pairs.at(delay)
    errors = [bearing_errors(camera, points, strips.pixels) for camera in cameras]
    return np.choose(strips.cameras, errors)


def _predicted(fit: CameraFit, number: int, first: int, cameras: Cameras) -> float:
    """Standard deviation (rad) of bearings in a sector, by the fit's covariance."""
    middle = np.radians(first + SECTOR_DEG * np.array([0.1, 0.5, 0.9]))
    points = points_around(middle, cameras.strip.height_m).reshape(-1, 3)
    sigmas = bearing_sigmas(fit, number, points, View(fit.cameras[number]).pixels_of(points))
    sigmas = sigmas[np.isfinite(sigmas)]
    return math.sqrt(float(np.mean(sigmas**2))) if len(sigmas) else math.inf


def bearing_sigmas(
    fit: CameraFit, number: int, points: FloatArray, pixels: FloatArray
) -> FloatArray:
    """Standard deviations (n,) rad of the bearings of `points` (n, 3) m, drawn at `pixels` (n, 2).

    By the fit's covariance; nan where one camera's lens draws nothing.
    """
    camera, row = fit.cameras[number], row_of(fit.values, number)
    slopes = np.stack(
        [
            bearing_errors(camera.model_copy(update={name: value + step}), points, pixels) / step
            for name, value, step in zip(NAMES, row.tolist(), STEPS.tolist(), strict=True)
        ],
        axis=1,
    )
    start = len(NAMES) * number
    block = fit.covariance[start:, start:][: len(NAMES), : len(NAMES)]
    variances = np.einsum("ni,ij,nj->n", slopes, block, slopes)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def _aside(off: FloatArray) -> float:
    """How far errors (n,) lie aside together, beyond what chance does."""
    if len(off) <= LEAST_VIEWS:
        return 0.0
    chance = _SURE * float(np.std(off)) / math.sqrt(len(off))
    return max(0.0, abs(float(np.median(off))) - chance)


def sectors_without_views(found: Sequence[BearingSector]) -> str:
    """Where one camera has no views, as text; "" where it has all."""
    empty = [sector for sector in found if sector.pairs < LEAST_VIEWS]
    return (
        f"{found[0].camera} camera has no views {sectors_in_words(empty, found)}" if empty else ""
    )


def sectors_in_words(chosen: Sequence[BearingSector], found: Sequence[BearingSector]) -> str:
    """Such as "from 30 to 60 deg left, beyond 110 deg right", of some of the sectors `found`."""
    words = []
    for side, left in (("left", True), ("right", False)):
        end = max((sector.bounds_deg[1] for sector in found if sector.left == left), default=0)
        runs: list[list[int]] = []
        for low, high in sorted(sector.bounds_deg for sector in chosen if sector.left == left):
            if runs and runs[-1][1] == low:
                runs[-1][1] = high
            else:
                runs.append([low, high])
        words += [
            f"beyond {low} deg {side}" if high == end else f"from {low} to {high} deg {side}"
            for low, high in runs
        ]
    return ", ".join(words)


def difference(
    one: CameraFit, other: CameraFit, number: int, chosen: Sequence[BearingSector], height_m: float
) -> FloatArray:
    """Differences (n,) rad of the bearings that two fits of one camera give to the same pixels."""
    if not chosen:
        return np.zeros(0)
    middles = np.radians([sector.first_deg + 0.5 * SECTOR_DEG for sector in chosen])
    points = points_around(middles, height_m).reshape(-1, 3)
    pixels = View(one.cameras[number]).pixels_of(points)
    off = bearing_errors(other.cameras[number], points, pixels)
    known: BoolArray = np.isfinite(off)
    return off[known]
