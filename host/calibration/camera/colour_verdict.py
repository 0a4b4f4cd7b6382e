"""Whether a strip's colour will do: what is found with it in the pictures it was learnt from."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.colour import Box, band_of, reduced
from host.calibration.result import Calibration, Check, Fitted, Quantity, at_least, at_most
from host.config import Strip
from host.messages import BoolArray, Image
from host.perception.jpeg_decoder import SCALE
from host.perception.strips.blob import Blob
from host.perception.strips.colour import StripColour
from host.perception.strips.geometry import StripGeometry

LEARNT = {
    "hue_deg": "hue, deg",
    "hue_width_deg": "width of the hues, deg",
    "saturation_min": "least saturation",
    "value_min": "least value",
}
"""The settings of [camera.strip] that are learnt, and what the report calls them."""

_SLACK_PX = 2 * SCALE  # a box may be drawn so close, and the edge of a strip so blurred
_MOST_BACKGROUND = 0.01  # of the band in which strips appear


@dataclass(frozen=True, slots=True)
class SearchedPicture:
    """One picture after the search.

    boxes: around its strips, as somebody gave them; none where nobody did. background (h, w):
    where else in the band of strips the reduced picture has their colour; band_px: how many pixels
    that band has.
    """

    name: str
    boxes: tuple[Box, ...]
    blobs: tuple[Blob, ...]
    background: BoolArray
    band_px: int

    @property
    def strips_found(self) -> int:
        """How many of the boxes hold the middle of something found; of none given, whether any."""
        kept = [blob for blob in self.blobs if blob.kept]
        if not self.boxes:
            return min(len(kept), 1)
        return sum(any(_inside(blob, [box]) for blob in kept) for box in self.boxes)

    @property
    def strips_given(self) -> int:
        """How many there are to find."""
        return max(len(self.boxes), 1)

    @property
    def others(self) -> list[Blob]:
        """What is taken for a strip, but is in none of the boxes given."""
        kept = [blob for blob in self.blobs if blob.kept and self.boxes]
        return [blob for blob in kept if not _inside(blob, self.boxes)]


def searched(
    name: str,
    picture: Image,
    blobs: list[Blob],
    boxes: tuple[Box, ...],
    strip: Strip,
    geometry: StripGeometry,
) -> SearchedPicture:
    """What a picture (h, w, 3), reduced, shows of the background. A strip of two colours: none."""
    band, shown = band_of(geometry), picture[: len(geometry.drawn)]
    background = np.zeros(band.shape, dtype=bool)
    if strip.pattern == "one_colour":
        background = band & (StripColour(strip).mask(shown) > 0)
        for box in boxes or tuple(_boxes_of(blobs)):
            background[reduced(box, _SLACK_PX)] = False
    return SearchedPicture(name, boxes, tuple(blobs), background, int(np.count_nonzero(band)))


def judged(before: Strip, strip: Strip, pictures: list[SearchedPicture]) -> Calibration:
    """The colour with its verdict. before: the strip as it was configured."""
    learnt = strip.pattern == "one_colour"
    given = sum(picture.strips_given for picture in pictures)
    found = sum(picture.strips_found for picture in pictures)
    unboxed = [picture for picture in pictures if not picture.boxes]
    return Calibration(
        kind="colour",
        fitted=tuple(_rows(before, strip)) if learnt else (),
        checks=tuple(_checks(pictures, learnt)),
        residuals=f"{found} of {given} strips found in {len(pictures)} picture(s)",
        warnings=(_UNBOXED,) if unboxed else (),
    )


_UNBOXED = (
    "without --box nobody says which of the things found are strips: look at the pictures drawn, "
    "or give a box around each strip"
)


def _rows(before: Strip, strip: Strip) -> Iterator[Fitted]:
    for key, name in LEARNT.items():
        what = Quantity(f"camera.strip.{key}", name, "", "what is found with the colour is judged")
        yield what.row(getattr(strip, key), math.nan, getattr(before, key))


def _checks(pictures: list[SearchedPicture], learnt: bool) -> Iterator[Check]:
    missed = [picture for picture in pictures if picture.strips_found < picture.strips_given]
    yield at_least(
        "strips found",
        sum(picture.strips_found for picture in pictures),
        sum(picture.strips_given for picture in pictures),
    ).otherwise(
        f"{_names(missed)} shows a strip that is not found: draw its box close around it, see why "
        "it is dropped in the picture drawn, and check height_m, tall_m and diameter_m in "
        "[camera.strip]"
    )
    mistaken = [picture for picture in pictures if picture.others]
    way_out = (
        'take it away, choose another colour for the strips, or pattern = "two_colours"'
        if learnt
        else "take it away, or cover it"
    )
    yield at_most(
        "false detections of strips", sum(len(picture.others) for picture in pictures), 0
    ).otherwise(
        f"what is framed in yellow in {_names(mistaken)} is in no box given, yet found: {way_out}; "
        "if it is a strip, give a box around it, too"
    )
    if learnt:
        shares = [np.count_nonzero(p.background) / max(p.band_px, 1) for p in pictures]
        worst = int(np.argmax(shares))
        yield at_most("background in its colour", max(shares), _MOST_BACKGROUND, "%").otherwise(
            f"what is painted yellow in {_names([pictures[worst]])} has the strip's colour, and "
            f"hides strips before it: {way_out}"
        )


def _names(pictures: list[SearchedPicture]) -> str:
    return ", ".join(picture.name for picture in pictures)


def _inside(blob: Blob, boxes: Sequence[Box]) -> bool:
    return any(
        -_SLACK_PX <= blob.x - left <= width + _SLACK_PX
        and -_SLACK_PX <= blob.y - top <= height + _SLACK_PX
        for left, top, width, height in boxes
    )


def _boxes_of(blobs: list[Blob]) -> Iterator[Box]:
    for blob in blobs:
        if blob.kept:
            left, top = blob.x - 0.5 * blob.width, blob.y - 0.5 * blob.height
            yield round(left), round(top), round(blob.width), round(blob.height)
