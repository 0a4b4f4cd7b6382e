"""Green over magenta in a panorama of the opponent colour, by a matched filter of two boxes.

At each distance of a strip its size is known, and its elevation but for the robot's pitch and
roll. The score of a place is the lesser of the green in the upper box and the magenta in the lower
one, less what of the pattern goes on outside: above, below, or on a side. Sums over boxes are four
values of an integral image (Crow 1984) each.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from host.config import Strip
from host.geometry import wrap
from host.messages import FloatArray, IntArray
from host.perception.panorama import Extent, Panorama, Single
from host.perception.strip_geometry import LEVEL_RAD, StripGeometry

MOST_COLOUR = 0.5  # more of the opponent colour counts as so much: prints and light differ

_NEAREST_M, _FARTHEST_M, _DISTANCES = 0.3, 4.5, 11
_LEAST_SCORE = 0.12
_CORE_WIDE, _CORE_TALL = 0.85, 0.9  # of the strip's size: its edges fill pixels in part
_PLACES = 4  # looked at across a box's width and height
_MOST_PLACES = 400
_ENOUGH_CELLS = 400.0  # more of them make a score no surer
_APART = 0.8  # of their mean width: nearer, two are one
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

    column: of its left edge. green, magenta: means of the boxes.
    """

    template: Template
    row: int
    column: int
    azimuth: float
    elevation: float
    green: float
    magenta: float


class PairFilter:
    """The matched filter for one camera's panorama."""

    def __init__(self, geometry: StripGeometry, strip: Strip, step_rad: float) -> None:
        self.panorama = Panorama(geometry, _extent(geometry), step_rad)
        distances = np.geomspace(_NEAREST_M, _FARTHEST_M, _DISTANCES)
        self._templates = [
            _template(self.panorama, geometry, strip, float(distance)) for distance in distances
        ]
        sizes = [(t.wide, t.upper, t.lower) for t in self._templates]
        self._sizes = np.array(sizes, dtype=np.int64)

    def candidates(self, opponent: Single) -> list[Candidate]:
        """The best place of each thing that looks like a strip, the surest first.

        opponent (rows, columns): the reduced picture's opponent colour.
        """
        grid = self.panorama.of(opponent, MOST_COLOUR)
        sums: Single = np.asarray(cv2.integral(grid, sdepth=cv2.CV_32F), dtype=np.float32)
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
        score = np.minimum(boxes.green, boxes.magenta) - boxes.outside()
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
                    green=float(boxes.green[k]),
                    magenta=float(boxes.magenta[k]),
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


_NEIGHBOURS = np.ones((3, 3), dtype=np.uint8)


class _Boxes:
    """Means of the boxes at places (n,), each of its own size; of `sums`, an integral image."""

    def __init__(
        self,
        sums: Single,
        sizes: IntArray,
        middle: IntArray,
        left: IntArray,
    ) -> None:
        self._sums = sums
        self.wide, self.upper, self.lower = sizes.T
        self.middle, self.left = middle, left
        self.cells = self.wide * (self.upper + self.lower)
        self.green, self.magenta = self._pair(0 * left)

    def outside(self) -> FloatArray:
        """How much of the pattern goes on outside (n,): the most of the four sides."""
        gap = np.maximum(1, self.upper // 3)
        right = self.left + self.wide
        above = self._mean(
            self.middle - 2 * self.upper - gap, self.middle - self.upper - gap, self.left, right
        )
        below = -self._mean(
            self.middle + self.lower + gap, self.middle + 2 * self.lower + gap, self.left, right
        )
        aside = self.wide + np.maximum(1, self.wide // 3)
        sides = [np.minimum(*self._pair(shift)) for shift in (-aside, aside)]
        most: FloatArray = np.maximum.reduce([0.0 * above, above, below, *sides])
        return most

    def _pair(self, shift: IntArray) -> tuple[FloatArray, FloatArray]:
        """Green above and magenta below the middle, the boxes moved aside by `shift` (n,)."""
        left, right = self.left + shift, self.left + shift + self.wide
        green = self._mean(self.middle - self.upper, self.middle, left, right)
        return green, -self._mean(self.middle, self.middle + self.lower, left, right)

    def _mean(self, top: IntArray, bottom: IntArray, left: IntArray, right: IntArray) -> FloatArray:
        height, width = (size - 1 for size in self._sums.shape)
        top, bottom = np.clip(top, 0, height), np.clip(bottom, 0, height)
        left, right = np.clip(left, 0, width), np.clip(right, 0, width)
        s = self._sums
        total = s[bottom, right] - s[top, right] - s[bottom, left] + s[top, left]
        return np.asarray(total / np.maximum((bottom - top) * (right - left), 1), dtype=float)
