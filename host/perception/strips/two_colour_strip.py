"""Strips of two colours, green over magenta, in a reduced picture.

A matched filter (`pair_filter`) says where one may be, and how large. There the pixels themselves
are weighed by how much of each colour they have: the halves' middles, widths and areas say whether
it is a strip, its bearing and, by its area, its distance.
"""

import math

import numpy as np

from host.config import Camera, Cameras
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, Image
from host.perception.jpeg_decoder import SCALE
from host.perception.strips.blob import Blob, bearing_variance, distance_m, distance_std_m
from host.perception.strips.geometry import StripGeometry
from host.perception.strips.pair_filter import Candidate, PairFilter, Template
from host.perception.strips.panorama import Single, by_light, cast_of, colour_and_light

_EDGE = 0.2  # of the half's colour: less is taken for the background
_WINDOW_WIDE, _WINDOW_TALL = 0.65, 1.2  # half sizes, in the strip's width and a half's height
_OVERLAP = 0.5  # of a half's height that the other half's window reaches into it
_BESIDE = 0.6  # of the strip's width from its middle: no more of it, but the background
_APART = 0.35  # most of a strip's width between the middles of its halves
_SAME = 0.4  # of a strip's size between two middles: less is one strip
_BEYOND = 1.3  # times the reach: what a size may say of the distance
_LEAST_RATIO, _MOST_RATIO = 0.5, 1.6  # of the distances that area and filter say


class TwoColourSearch:
    """Finds strips of two colours in one camera's reduced pictures. For one thread."""

    def __init__(self, cameras: Cameras, camera: Camera, geometry: StripGeometry) -> None:
        self._cameras, self._geometry = cameras, geometry
        self._filter = PairFilter(geometry, cameras, SCALE / camera.focal_px)

    def blobs_in(self, picture: Image) -> list[Blob]:
        """Everything that looks like a strip, left to right. picture (rows, columns, 3) BGR."""
        cast = cast_of(picture)
        found: list[Blob] = []
        for candidate in self._filter.candidates(picture, cast):
            blob = self._measured(candidate, picture, cast)
            if blob is not None and not _seen_already(blob, found):
                found.append(blob)
        return sorted(found, key=lambda blob: blob.x)

    def _measured(self, candidate: Candidate, picture: Image, cast: float) -> Blob | None:
        """Weigh the pixels about a candidate; None where nothing of one colour is left."""
        box = self._box(candidate)
        if box is None:
            return None
        template = candidate.template
        azimuth = wrap(self._geometry.azimuth[box] - candidate.azimuth)
        elevation = self._geometry.elevation[box] - candidate.elevation
        aside = np.abs(azimuth)
        inside, beside = (
            aside < _WINDOW_WIDE * template.wide_rad,
            aside > _BESIDE * template.wide_rad,
        )
        upper = (elevation < _WINDOW_TALL * template.upper_rad) & (
            elevation > -_OVERLAP * template.lower_rad
        )
        lower = (elevation > -_WINDOW_TALL * template.lower_rad) & (
            elevation < _OVERLAP * template.upper_rad
        )
        colour, light = colour_and_light(picture[box], cast)
        halves = ((1.0, upper & inside, upper & beside), (-1.0, lower & inside, lower & beside))
        # Light on a strip differs from side to side, not from top to bottom. There what is darker
        # than the strip, the turret below it, would pass for the strip if colour were by light.
        across, upright = (
            np.stack([_share(np.maximum(side * of, 0.0), *half).ravel() for side, *half in halves])
            for of in (by_light(colour, light), colour)
        )
        solid = self._geometry.solid_angle[box]
        sums = across @ np.stack((solid, solid * azimuth)).reshape(2, -1).T
        high = upright @ np.stack((solid, solid * elevation)).reshape(2, -1).T
        if not (sums[:, 0] > 0.0).all() or not high[:, 0].all():
            return None
        level = candidate.elevation + float(high[:, 1].sum() / high[:, 0].sum())
        return self._blob(candidate, sums, level, math.sqrt(float(solid.mean())))

    def _box(self, candidate: Candidate) -> tuple[slice, slice] | None:
        """The pixels about a candidate."""
        t = candidate.template
        top = max(candidate.row - round(0.3 * t.upper) - t.upper - 1, 0)
        left = max(candidate.column - round(0.35 * t.wide) - 1, 0)
        return self._filter.panorama.pixels_of(
            slice(top, candidate.row + t.lower + round(0.3 * t.lower) + 2),
            slice(left, candidate.column + t.wide + round(0.35 * t.wide) + 2),
        )

    def _blob(
        self, candidate: Candidate, sums: FloatArray, elevation: float, pixel_rad: float
    ) -> Blob:
        """sums (2, 2): of green and magenta, solid angle and its product with azimuth."""
        template, strip = candidate.template, self._cameras.strip
        solid = float(sums[:, 0].sum())
        azimuth = candidate.azimuth + float(sums[:, 1].sum()) / solid
        distance = distance_m(strip, solid)
        pixels = solid / pixel_rad**2
        halves = sums[:, 1] / sums[:, 0]
        apart = abs(float(halves[0] - halves[1]))
        reason = _reason(
            template, apart / (template.wide_rad + pixel_rad), distance, self._cameras.max_range_m
        )
        tall_rad = template.upper_rad + template.lower_rad
        x, y = self._geometry.pixel(azimuth, elevation)
        return Blob(
            x=x,
            y=y,
            width=SCALE * template.wide_rad / pixel_rad,
            height=SCALE * tall_rad / pixel_rad,
            area_px=SCALE * SCALE * pixels,
            kept=not reason,
            reason=reason,
            bearing_rad=self._geometry.bearing(azimuth),
            variance_rad2=bearing_variance(pixel_rad, apart),
            range_m=distance,
            range_std_m=distance_std_m(distance, pixels),
        )


def _seen_already(blob: Blob, surer: list[Blob]) -> bool:
    """Whether its pixels were those of a surer blob, beside which the filter had it."""
    return any(
        abs(blob.x - other.x) < _SAME * max(blob.width, other.width)
        and abs(blob.y - other.y) < _SAME * max(blob.height, other.height)
        for other in surer
    )


def _reason(template: Template, apart: float, distance: float, reach: float) -> str:
    """Why a candidate cannot be a strip; nothing where it can. apart: of the halves, in widths."""
    if apart > _APART:
        return "halves_apart"
    if distance > _BEYOND * reach:
        return "too_small"
    ratio = distance / template.distance_m
    if not _LEAST_RATIO < ratio < _MOST_RATIO:
        return "too_large" if ratio < 1.0 else "too_small"
    return ""


def _share(colour: Single, inside: BoolArray, beside: BoolArray) -> FloatArray:
    """How much of each pixel `inside` a half fills, 0 to 1.

    0 is what the background `beside` it has of its colour, 1 what the strongest pixels have.
    """
    strength = np.where(inside, colour, np.float32(0.0))
    full = float(np.vdot(strength, strength)) / max(float(strength.sum()), 1e-9)
    none = float(colour[beside].mean()) if beside.any() else 0.0
    share = np.clip((strength - none) / max(full - none, 1.0), 0.0, 1.0)
    share[share < _EDGE] = 0.0
    return np.asarray(share, dtype=float)
