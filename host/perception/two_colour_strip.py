"""Strips of two colours, green over magenta, in a reduced picture.

A matched filter (`pair_filter`) says where one may be, and how large. There the pixels themselves
are weighed by how much of each colour they have: the halves' middles, widths and areas say whether
it is a strip, its bearing and, by its area, its distance.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.config import Camera, Cameras
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, Image
from host.perception.blob import Blob
from host.perception.jpeg_decoder import SCALE
from host.perception.pair_filter import Candidate, PairFilter
from host.perception.panorama import OpponentColour, Single
from host.perception.strip_geometry import StripGeometry, full_size

_EDGE = 0.2  # of the half's colour: less is taken for the background
_PIXEL_STD = 0.1  # std of a strip's middle in reduced pixels
_WINDOW_WIDE, _WINDOW_TALL = 0.9, 1.5  # half sizes, in the strip's width and a half's height
_BESIDE = 0.75  # of the strip's width from its middle: no more of it, but the background
_ASIDE = 0.35  # most of a strip's width between the middles of its halves


@dataclass(frozen=True, slots=True)
class _Half:
    """One colour's part of a strip: area (sr), middle, std of the azimuths; rad."""

    area: float
    azimuth: float
    elevation: float
    spread: float


class TwoColourSearch:
    """Finds strips of two colours in one camera's reduced pictures. For one thread."""

    def __init__(self, cameras: Cameras, camera: Camera, geometry: StripGeometry) -> None:
        self._cameras, self._geometry = cameras, geometry
        self._colour = OpponentColour(geometry.drawn.shape)
        self._filter = PairFilter(geometry, cameras.strip, SCALE / camera.focal_px)
        pixels = full_size(np.indices(geometry.drawn.shape, dtype=float)[::-1])
        self._pixels = pixels.astype(np.float32)

    def blobs_in(self, picture: Image) -> list[Blob]:
        """Everything that looks like a strip, left to right. picture (rows, columns, 3) BGR."""
        opponent = self._colour.of(picture)
        found = [
            self._measured(candidate, opponent) for candidate in self._filter.candidates(opponent)
        ]
        return sorted((blob for blob in found if blob is not None), key=lambda blob: blob.x)

    def _measured(self, candidate: Candidate, opponent: Single) -> Blob | None:
        """Weigh the pixels about a candidate; None where nothing of one colour is left."""
        box = self._box(candidate)
        if box is None:
            return None
        template, geometry = candidate.template, self._geometry
        azimuth = wrap(geometry.azimuth[box] - candidate.azimuth)
        elevation = geometry.elevation[box] - candidate.elevation
        solid = geometry.solid_angle[box]
        aside = np.abs(azimuth) / template.wide_rad
        level = elevation < _WINDOW_TALL * template.upper_rad
        level &= elevation > -_WINDOW_TALL * template.lower_rad
        o = opponent[box]
        green, magenta = (
            _share(colour, half & (aside < _WINDOW_WIDE), half & (aside > _BESIDE))
            for colour, half in (
                (o, level & (elevation > -0.5 * template.lower_rad)),
                (-o, level & (elevation < 0.5 * template.upper_rad)),
            )
        )
        features = np.stack(
            [solid * v for v in (1.0, azimuth, elevation, azimuth**2, *self._pixels[:, *box])]
        ).reshape(6, -1)
        sums = np.stack((green, magenta)).reshape(2, -1) @ features.T
        if not (sums[:, 0] > 0.0).all():
            return None
        return self._blob(candidate, sums, math.sqrt(float(solid.mean())))

    def _box(self, candidate: Candidate) -> tuple[slice, slice] | None:
        """The pixels about a candidate."""
        t = candidate.template
        top = max(candidate.row - round(1.6 * t.upper) - 1, 0)
        left = max(candidate.column - t.wide // 2 - 1, 0)
        return self._filter.panorama.pixels_of(
            slice(top, candidate.row + round(1.6 * t.lower) + 2),
            slice(left, candidate.column + t.wide + t.wide // 2 + 2),
        )

    def _blob(self, candidate: Candidate, sums: FloatArray, pixel_rad: float) -> Blob:
        halves = [
            _Half(area, x / area, y / area, math.sqrt(max(xx / area - (x / area) ** 2, 0.0)))
            for area, x, y, xx in sums[:, :4].tolist()
        ]
        total = sums.sum(axis=0)
        strip = self._cameras.strip
        distance = math.sqrt(strip.diameter_m * strip.tall_m / float(total[0]))
        middle = float(total[1] / total[0])
        pixels = float(total[0]) / pixel_rad**2
        apart = abs(halves[0].azimuth - halves[1].azimuth)
        reason = self._reason(candidate, halves, pixel_rad)
        width, height = (
            SCALE * angle / pixel_rad
            for angle in (
                candidate.template.wide_rad,
                candidate.template.upper_rad + candidate.template.lower_rad,
            )
        )
        return Blob(
            x=float(total[4] / total[0]),
            y=float(total[5] / total[0]),
            width=width,
            height=height,
            area_px=SCALE * SCALE * pixels,
            kept=not reason,
            reason=reason,
            bearing_rad=self._geometry.bearing(candidate.azimuth + middle),
            variance_rad2=(_PIXEL_STD * pixel_rad) ** 2 + apart**2 / 12.0,
            range_m=distance,
            range_std_m=distance * math.hypot(0.1, 0.7 / math.sqrt(pixels)),
        )

    def _reason(self, candidate: Candidate, halves: list[_Half], pixel_rad: float) -> str:
        """Why a candidate cannot be a strip; nothing where it can."""
        template = candidate.template
        green, magenta = halves
        wide = template.wide_rad + pixel_rad
        reasons = {
            "halves_apart": abs(green.azimuth - magenta.azimuth) > _ASIDE * wide,
        }
        return next((reason for reason, applies in reasons.items() if applies), "")


def _share(colour: Single, inside: BoolArray, beside: BoolArray) -> FloatArray:
    """How much of each pixel `inside` a half fills, 0 to 1.

    0 is what the background `beside` it has of its colour, 1 what the strongest pixels have.
    """
    strength = np.where(inside, np.maximum(colour, 0.0), 0.0)
    full = float((strength * strength).sum()) / max(float(strength.sum()), 1e-9)
    none = max(float(colour[beside].mean()), 0.0) if beside.any() else 0.0
    share = np.clip((strength - none) / max(full - none, 1e-3), 0.0, 1.0)
    share[share < _EDGE] = 0.0
    return np.asarray(share, dtype=float)
