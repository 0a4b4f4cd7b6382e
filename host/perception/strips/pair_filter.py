"""Green over magenta in a panorama of the opponent colour, by a matched filter of two boxes.

At each distance of a strip its size is known, and its elevation but for the robot's pitch and
roll. The score of a place is the lesser of the green in the upper box and the magenta in the lower
one, less what of the pattern goes on outside: above, below or on a side. Sums over boxes are four
values of an integral image (Crow 1984) each.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from host.config import Cameras, Strip
from host.geometry import wrap
from host.messages import FloatArray, Image, IntArray
from host.perception.strips.geometry import LEVEL_RAD, StripGeometry
from host.perception.strips.panorama import Extent, Panorama, Single, opponent

_NEAREST_M, _FARTHEST_M, _DISTANCES = 0.3, 4.5, 11
_MOST_COLOUR = 140  # more green or magenta counts as so much: prints and light differ
_LEAST_SCORE = 24.0
_CORE_WIDE, _CORE_TALL = 0.85, 0.9  # of the strip's size: its edges fill pixels in part
_PLACES = 4  # looked at across a box's width and height
_MOST_PLACES = 400
_LEAST_THIRDS = 6  # cells across, from which a box has thirds
_ENOUGH_CELLS = 400.0  # more of them make a score no surer
_APART = 0.8  # of their mean width: nearer, two are one
_NEIGHBOURS = np.ones((3, 3), dtype=np.uint8)
_MARGIN_RAD = 0.15  # the panorama beyond the bearings that the picture shows


@dataclass(frozen=True, slots=True)
class Template:
    """A strip at one distance: its size in rad, and its boxes in cells of the panorama.

    rows: of the middle, first and behind the last. strides: cells between two places, down and
    across.
    """

    distance_m: float
    wide_rad: float
    upper_rad: float
    lower_rad: float
    wide: int
    upper: int
    lower: int
    rows: tuple[int, int]
    strides: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place that looks like a strip: azimuth, elevation (rad) of its middle, row and column.

    column: of its left edge.
    """

    template: Template
    row: int
    column: int
    azimuth: float
    elevation: float


class PairFilter:
    """The matched filter for one camera's panorama."""

    def __init__(self, geometry: StripGeometry, cameras: Cameras, step_rad: float) -> None:
        self.panorama = Panorama(geometry, _extent(geometry), step_rad)
        farthest = max(min(_FARTHEST_M, cameras.max_range_m), 2.0 * _NEAREST_M)
        distances = np.geomspace(_NEAREST_M, farthest, _DISTANCES)
        self._templates = [
            _template(self.panorama, geometry, cameras.strip, float(distance))
            for distance in distances
        ]
        sizes = [(t.wide, t.upper, t.lower) for t in self._templates]
        self._sizes = np.array(sizes, dtype=np.int64)

    def candidates(self, picture: Image, cast: float) -> list[Candidate]:
        """The best place of each thing that looks like a strip, the surest first.

        picture (rows, columns, 3): the reduced one, BGR; cast: of the light on grey in it.
        """
        colour = opponent(self.panorama.of(picture), cast)
        pair = np.clip(colour, -_MOST_COLOUR, _MOST_COLOUR)
        sums: Single = np.asarray(cv2.integral(pair, sdepth=cv2.CV_32F), dtype=np.float32)
        places = [
            (np.full(len(rows), number), rows, columns)
            for number, template in enumerate(self._templates)
            for rows, columns in _peaks(sums, template)
        ]
        if not places:
            return []
        number, row, column = (np.concatenate(parts) for parts in zip(*places, strict=True))
        return self._best(_Boxes(sums, self._sizes[number], row, column), number)

    def _best(self, boxes: "_Boxes", number: IntArray) -> list[Candidate]:
        score = boxes.score - boxes.outside
        strength = score * np.sqrt(np.minimum(boxes.cells, _ENOUGH_CELLS))
        strength[score < _LEAST_SCORE] = 0.0
        panorama = self.panorama
        azimuth = panorama.azimuth[0] + panorama.step_rad * (boxes.left + 0.5 * boxes.wide - 0.5)
        wide = np.array([self._templates[k].wide_rad for k in number])
        best: list[Candidate] = []
        while strength.any():
            k = int(np.argmax(strength))
            near = np.abs(wrap(azimuth - azimuth[k])) < _APART * 0.5 * (wide + wide[k])
            strength[near] = 0.0
            best.append(
                Candidate(
                    template=self._templates[number[k]],
                    row=int(boxes.middle[k]),
                    column=int(boxes.left[k]),
                    azimuth=float(azimuth[k]),
                    elevation=float(panorama.elevation[0])
                    - panorama.step_rad * (int(boxes.middle[k]) - 0.5),
                )
            )
        return best


def _extent(geometry: StripGeometry) -> Extent:
    """What the panorama has to show for strips from the nearest to the farthest."""
    centre, half = geometry.view
    azimuth = float(wrap(centre - geometry.heading_rad))
    edges = [geometry.edges(distance) for distance in (_NEAREST_M, _FARTHEST_M)]
    taller = max(upper - middle for upper, middle, _ in edges)
    highest = max(upper for upper, _, _ in edges) + LEVEL_RAD + 0.5 * taller
    lowest = min(lower for _, _, lower in edges) - LEVEL_RAD
    aside = half + _MARGIN_RAD
    return Extent((azimuth - aside, azimuth + aside), (lowest, highest))


def _template(
    panorama: Panorama, geometry: StripGeometry, strip: Strip, distance: float
) -> Template:
    upper, middle, lower = geometry.edges(max(distance - 0.4 * strip.diameter_m, 0.05))
    wide_rad = 2.0 * math.asin(min(0.5 * strip.diameter_m / distance, 0.9))
    step = panorama.step_rad
    wide = max(1, round(_CORE_WIDE * wide_rad / step))
    above, below = (
        max(1, round(_CORE_TALL * angle / step)) for angle in (upper - middle, middle - lower)
    )
    first = max(math.floor(panorama.row_of(middle + LEVEL_RAD)), above)
    end = min(math.ceil(panorama.row_of(middle - LEVEL_RAD)), len(panorama.elevation) - below)
    strides = (max(1, min(above, below) // _PLACES), max(1, wide // _PLACES))
    size = (wide_rad, upper - middle, middle - lower)
    return Template(distance, *size, wide, above, below, (first, end), strides)


def _peaks(sums: Single, template: Template) -> Iterator[tuple[IntArray, IntArray]]:
    """Rows of the middle and columns of the left edge where the score has a local maximum."""
    (first, end), (down, across) = template.rows, template.strides
    wide, upper, lower = template.wide, template.upper, template.lower
    if end <= first or sums.shape[1] <= wide:
        return
    band = sums[first - upper : end + lower]
    columns = band[:, wide::across] - band[:, : sums.shape[1] - wide : across]
    count = end - first
    middle = columns[upper : upper + count : down]
    green = (middle - columns[:count:down]) * (1.0 / (wide * upper))
    magenta = (middle - columns[upper + lower : upper + lower + count : down]) * (
        1.0 / (wide * lower)
    )
    score = np.minimum(green, magenta)
    if not score.max() > _LEAST_SCORE:
        return
    peak = (score >= cv2.dilate(score, _NEIGHBOURS)) & (score > _LEAST_SCORE)
    rows, places = np.nonzero(peak)
    yield first + down * rows[:_MOST_PLACES], across * places[:_MOST_PLACES]


class _Boxes:
    """Means of the boxes at places (n,), each of its own size; of `sums`, an integral image.

    score (n,): the least of green and magenta in the thirds of the strip's halves, so that two
    strips side by side are not one of twice the size. outside (n,): how much of the pattern goes
    on above, below or on a side, the most of them. cells (n,): of both halves.
    """

    def __init__(self, sums: Single, sizes: IntArray, middle: IntArray, left: IntArray) -> None:
        self.wide, upper, lower = sizes.T
        self.middle, self.left = middle, left
        self.cells = self.wide * (upper + lower)
        third = np.where(self.wide >= _LEAST_THIRDS, self.wide // 3, self.wide)
        centre, right = left + (self.wide - third) // 2, left + self.wide - third
        gap, step = np.maximum(1, upper // 3), self.wide + np.maximum(1, self.wide // 3)
        columns = np.stack((left, centre, right, left - step, left + step))
        widths = np.stack((third, third, third, self.wide, self.wide))
        green = _means(sums, middle - upper, upper, columns, widths)
        magenta = -_means(sums, middle, lower, columns, widths)
        pairs = np.minimum(green, magenta)
        above = _means(sums, middle - 2 * upper - gap, upper, left, self.wide)
        below = -_means(sums, middle + lower + gap, lower, left, self.wide)
        self.score = pairs[:3].min(axis=0)
        self.outside = np.maximum.reduce([0.0 * above, *pairs[3:], above, below])


def _means(
    sums: Single, tops: IntArray, heights: IntArray, lefts: IntArray, wide: IntArray
) -> FloatArray:
    """Means over boxes (n,) or (k, n), cut where the panorama ends; 0 of those outside it."""
    rows, columns = (size - 1 for size in sums.shape)
    bottoms, rights = np.clip(tops + heights, 0, rows), np.clip(lefts + wide, 0, columns)
    tops, lefts = np.clip(tops, 0, rows), np.clip(lefts, 0, columns)
    total = sums[bottoms, rights] - sums[tops, rights] - sums[bottoms, lefts] + sums[tops, lefts]
    return np.asarray(total / np.maximum((bottoms - tops) * (rights - lefts), 1), dtype=float)
