"""The strip's sheet, measured in its drawing."""

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from host.cli.main import main
from host.config import Strip
from host.errors import UserError
from host.perception.strips.sheet import PAPERS_MM, strip_sheet

SVG = "{http://www.w3.org/2000/svg}"
OVERLAP_MM = 10.0
GREEN, MAGENTA = "rgb(55, 166, 79)", "rgb(188, 49, 129)"


def rectangles(sheet: str) -> list[tuple[float, float, float, float, str]]:
    """x, y, width, height (mm) and colour of each."""
    found = ET.fromstring(sheet).iter(f"{SVG}rect")
    return [
        (*(float(r.attrib[k]) for k in ("x", "y", "width", "height")), r.attrib["fill"])
        for r in found
    ]


def test_the_default_strip_goes_around_its_robot_on_a4() -> None:
    sheet = strip_sheet(Strip())
    root = ET.fromstring(sheet)
    assert (root.attrib["width"], root.attrib["height"]) == ("297mm", "210mm")
    assert root.attrib["viewBox"] == "0 0 297 210"  # so that a unit is a millimetre
    bands = rectangles(sheet)
    assert [band[4] for band in bands] == [GREEN, MAGENTA] * 2
    around = sum(width - OVERLAP_MM for _, _, width, _, colour in bands if colour == GREEN)
    assert around == pytest.approx(100.0 * math.pi, abs=0.01)
    for upper, lower in zip(bands[::2], bands[1::2], strict=True):
        assert (upper[3], lower[3]) == (40.0, 40.0)
        assert upper[1] + 40.0 == lower[1]
        assert (upper[0], upper[2]) == (lower[0], lower[2])


def test_the_ruler_is_100_mm_long() -> None:
    lines = [
        [float(line.attrib[k]) for k in ("x1", "y1", "x2", "y2")]
        for line in ET.fromstring(strip_sheet(Strip())).iter(f"{SVG}line")
    ]
    (ruler,) = [line for line in lines if line[1] == line[3]]
    assert ruler[2] - ruler[0] == 100.0
    marks = sorted(x1 for x1, y1, x2, _ in lines if x1 == x2 and y1 == ruler[1])
    assert marks == [ruler[0] + 10.0 * k for k in range(11)]


def test_a_strip_of_one_colour_is_one_band_of_it() -> None:
    red = rectangles(strip_sheet(Strip(pattern="one_colour")))
    assert {band[3] for band in red} == {40.0}
    r, g, b = map(int, re.findall(r"\d+", red[0][4]))
    assert r > 150
    assert g == b < 60


@given(
    st.floats(0.01, 0.4),
    st.floats(0.005, 0.3),
    st.sampled_from(sorted(PAPERS_MM)),
    st.sampled_from(["one_colour", "two_colours"]),
)
def test_any_strip_is_whole_on_the_paper_or_refused(
    diameter: float, tall: float, paper: str, pattern: str
) -> None:
    strip = Strip.model_validate({"pattern": pattern, "diameter_m": diameter, "tall_m": tall})
    wide, high = PAPERS_MM[paper]
    pieces = math.ceil(1000.0 * math.pi * diameter / (wide - 30.0))
    if pieces * (1000.0 * tall + 6.0) + 15.0 > high - 20.0:
        with pytest.raises(UserError, match="does not fit"):
            strip_sheet(strip, paper)
        return
    sheet = strip_sheet(strip, paper)
    bands = rectangles(sheet)
    colours = 2 if pattern == "two_colours" else 1
    assert sum(band[2] - OVERLAP_MM for band in bands[::colours]) == pytest.approx(
        1000.0 * math.pi * diameter, abs=0.01
    )
    for x, y, width, height, _ in bands:
        assert x >= 10.0
        assert x + width <= wide - 10.0 + 1e-3
        assert y + height <= high - 10.0 + 1e-3


def test_the_command_writes_it_and_says_how_to_print(tmp_path: Path) -> None:
    output = tmp_path / "strip.svg"
    result = CliRunner().invoke(main, ["print", "strip", "--output", str(output)])
    assert result.exit_code == 0, result.output
    assert output.read_text(encoding="utf-8") == strip_sheet(Strip())
    assert "100 %" in result.output


def test_a_file_that_cannot_be_written_is_said_in_words(tmp_path: Path) -> None:
    result = CliRunner().invoke(
        main, ["print", "strip", "--output", str(tmp_path / "no" / "a.svg")]
    )
    assert result.exit_code == 1
    assert "cannot write" in result.output
