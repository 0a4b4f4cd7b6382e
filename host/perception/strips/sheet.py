"""A teammate's strip as a sheet to print: an SVG drawing to scale, in mm."""

import colorsys
import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

from host.config import Strip
from host.errors import UserError
from host.perception.strips.geometry import GREEN_RGB, MAGENTA_RGB

PAPERS_MM = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}  # lying on the long side

_MARGIN_MM = 10.0  # that no printer reaches
_OVERLAP_MM = 10.0  # glued under the next piece
_GAP_MM = 6.0
_RULER_MM, _RULER_TALL_MM = 100.0, 15.0
_WORDS_TALL_MM, _LETTER_MM = 5.0, 3.2
_PRINT_SATURATION, _PRINT_VALUE = 0.85, 0.75  # what printers reach and rooms have not


@dataclass(frozen=True, slots=True)
class _Layout:
    """A strip cut into so many pieces that the paper takes, all of one length."""

    pieces: int
    length_mm: float
    tall_mm: float


def strip_sheet(strip: Strip, paper: str = "A4") -> str:
    """The SVG text of one sheet of `paper` (of PAPERS_MM) with the strip's pieces and a ruler.

    Raises UserError where the strip does not fit.
    """
    wide, tall = PAPERS_MM[paper]
    layout = _layout(strip, paper)
    parts = []
    y = _MARGIN_MM
    for number in range(layout.pieces):
        parts += _piece(strip, layout, y, last=number == layout.pieces - 1)
        y += layout.tall_mm + _GAP_MM
    parts += _ruler(_MARGIN_MM, y)
    parts += _words(strip, layout, _MARGIN_MM + _RULER_MM + 15.0, y)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:g}mm" height="{tall:g}mm" '
        f'viewBox="0 0 {wide:g} {tall:g}">\n' + "\n".join(parts) + "\n</svg>\n"
    )


def _layout(strip: Strip, paper: str) -> _Layout:
    wide, tall = (size - 2.0 * _MARGIN_MM for size in PAPERS_MM[paper])
    around = 1000.0 * math.pi * strip.diameter_m
    pieces = math.ceil(around / (wide - _OVERLAP_MM))
    strip_tall = 1000.0 * strip.tall_m
    if pieces * (strip_tall + _GAP_MM) + _RULER_TALL_MM > tall:
        raise UserError(
            f"the strip does not fit on {paper}",
            f"it is {around:.0f} mm around and {strip_tall:g} mm tall",
            "choose --paper A3, or a smaller diameter_m or tall_m in [camera.strip]",
        )
    return _Layout(pieces, around / pieces + _OVERLAP_MM, strip_tall)


def _bands(strip: Strip) -> list[tuple[int, int, int]]:
    """The strip's colours from the top down, in sRGB."""
    if strip.pattern == "two_colours":
        return [GREEN_RGB, MAGENTA_RGB]
    rgb = colorsys.hsv_to_rgb(strip.hue_deg / 360.0, _PRINT_SATURATION, _PRINT_VALUE)
    red, green, blue = (round(255.0 * value) for value in rgb)
    return [(red, green, blue)]


def _piece(strip: Strip, layout: _Layout, top: float, *, last: bool) -> list[str]:
    """Colours in full, and a mark below the lower edge where the next piece begins."""
    bands = _bands(strip)
    tall = layout.tall_mm / len(bands)
    parts = [
        f'<rect x="{_MARGIN_MM:g}" y="{top + k * tall:.3f}" width="{layout.length_mm:.3f}" '
        f'height="{tall:.3f}" fill="rgb{colour}"/>'
        for k, colour in enumerate(bands)
    ]
    begins = _MARGIN_MM + layout.length_mm - _OVERLAP_MM
    bottom = top + layout.tall_mm
    onto = "first" if last else "next"
    return [
        *parts,
        _line(begins, bottom, begins, bottom + 4.0),
        _text(begins - 1.0, bottom + 4.0, f"the {onto} piece begins here", end=True),
    ]


def _ruler(x: float, y: float) -> list[str]:
    """100 mm with a mark each 10 mm, to check the print by."""
    marks = [
        _line(x + mark, y, x + mark, y + (4.0 if mark % 50 == 0 else 2.5))
        for mark in range(0, round(_RULER_MM) + 1, 10)
    ]
    words = _text(x, y + 9.0, "100 mm: measure it; if it is not, print at 100 %, not fitted")
    return [_line(x, y, x + _RULER_MM, y), *marks, words]


def _words(strip: Strip, layout: _Layout, x: float, y: float) -> list[str]:
    top = "green on top, " if strip.pattern == "two_colours" else ""
    around = f"wrap around {1000.0 * strip.diameter_m:g} mm"
    lines = [
        "matt paper, printed in colour; cut along the colours' edges",
        f"{around}, {top}{layout.pieces} piece(s), glue the ends",
        f"middle {1000.0 * strip.height_m:g} mm above the floor",
    ]
    return [_text(x, y + 4.0 + _WORDS_TALL_MM * k, line) for k, line in enumerate(lines)]


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    return (
        f'<line x1="{x1:.3f}" y1="{y1:.3f}" x2="{x2:.3f}" y2="{y2:.3f}" '
        'stroke="black" stroke-width="0.2"/>'
    )


def _text(x: float, y: float, words: str, *, end: bool = False) -> str:
    anchor = ' text-anchor="end"' if end else ""
    return (
        f'<text x="{x:.3f}" y="{y:.3f}" font-family="sans-serif" font-size="{_LETTER_MM:g}"'
        f"{anchor}>{escape(words)}</text>"
    )
