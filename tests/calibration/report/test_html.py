"""A calibration as HTML, JSON and console text: the same figures, whole and without surprises."""

import dataclasses
import json
import math
import sys
import tomllib
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from host.calibration.report.diagram import ROLES
from host.calibration.report.html import as_html, write_html
from host.calibration.report.text import as_json, as_text, check_cells
from host.calibration.result import (
    Calibration,
    Check,
    Fitted,
    ReportPicture,
    Series,
    at_least,
    at_most,
)
from host.errors import UserError

HEADING = Fitted(
    key="lidar.heading_rad",
    name="heading of the lidar",
    value=0.0524,
    sigma=0.0003,
    limit=0.00175,
    before=0.01,
    halves=(0.0522, 0.0527),
    unit="deg",
)
NOISE = Fitted(key="", name="noise", value=0.0041, sigma=math.nan, unbounded="read only", unit="mm")
USED = at_least("pairs used", 0.712, 0.5, "%").otherwise("(never shown)")
FLAT = at_least("delay separate from rotation", 1.2, 3.0, "times").otherwise(
    "drive eights & stop <often>"
)
PICTURES = (
    ReportPicture(
        title="Path $1 <b>",
        axes=("x_1 / m", "$y / m"),
        caption="where & how",
        equal=True,
        series=(
            Series(x=np.linspace(0, 1, 50), y=np.linspace(0, 2, 50), label="robot", style="line"),
            Series(x=np.arange(2000.0), y=np.sin(np.arange(2000.0)), label="_mate <&>"),
        ),
    ),
    ReportPicture(
        title="By range",
        axes=("range / m", "pairs"),
        series=(
            Series(x=np.arange(3.0), y=np.array([1.0, math.nan, math.inf]), style="bars"),
            Series(x=np.zeros(0), y=np.zeros(0), label="none"),
        ),
    ),
)


def calibration(*checks: Check, pictures: tuple[ReportPicture, ...] = ()) -> Calibration:
    return Calibration(
        kind="lidar",
        fitted=(HEADING, NOISE),
        checks=checks,
        residuals="rms 2.1 mm over 812 pairs, 71 % of them used",
        pictures=pictures,
        settings={"lidar.blind_sectors": [{"centre_rad": np.float64(0.5), "width_rad": 0.1}]},
        figures={"share": np.float32(0.25), "by_range_m": {1: math.nan}},
    )


class Page(HTMLParser):
    """The words of a page, and whether its elements close as they should."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            assert name != "src"
            assert name not in ("href", "xlink:href") or (value or "").startswith(("#", "data:"))
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.words.append(data.strip())


def page_of(fit: Calibration, source: str = "run.mcap") -> Page:
    page = Page(as_html(fit, source, "2026-11-22", "robots/mine.toml"))
    assert not page.open
    return page


def svgs(text: str) -> list[str]:
    return [
        part[: part.index("</svg>") + 6] for part in ("<svg" + p for p in text.split("<svg")[1:])
    ]


def test_a_fit_that_passes_says_so_and_shows_every_figure() -> None:
    words = page_of(calibration(USED)).words
    assert "✓ Passed" in words
    for expected in (
        *("Calibration: lidar", "robots/mine.toml · from run.mcap · 2026-11-22"),
        *("heading of the lidar", "lidar.heading_rad", "3.002 ± 0.017 deg", "0.1 deg"),
        *("0.573", "2.991", "3.019", "4.1 mm", "71.2 %", "≥ 50 %"),
        "Residuals: rms 2.1 mm over 812 pairs, 71 % of them used",
    ):
        assert expected in words
    assert "(never shown)" not in " ".join(words)
    (written,) = (word for word in words if "centre_rad" in word)  # may be copied as it stands
    assert tomllib.loads(written) == {
        "lidar": {
            "heading_rad": 0.0524,
            "blind_sectors": [{"centre_rad": 0.5, "width_rad": 0.1}],
        }
    }


def test_a_fit_that_fails_says_why_and_what_to_do() -> None:
    words = page_of(calibration(USED, FLAT)).words
    assert "✗ Refused" in words
    assert "delay separate from rotation: drive eights & stop <often>" in words
    assert words.count("✗ fails") == 1


@given(st.text(), st.text())
def test_words_from_elsewhere_stay_words(source: str, advice: str) -> None:
    check = at_least(source, 1.0, 2.0, "m").otherwise(advice)
    text = as_html(calibration(check), source, "2026-11-22", advice)
    tags = as_html(calibration(FLAT), "", "2026-11-22", "").count("<")
    assert text.count("<") == tags
    assert not Page(text).open


def test_pictures_are_drawn_within_the_page_and_alike_each_time() -> None:
    pytest.importorskip("matplotlib")
    first = as_html(calibration(pictures=PICTURES), "a", "b", "c")
    assert first == as_html(calibration(pictures=PICTURES), "a", "b", "c")
    drawn = svgs(first)
    assert len(drawn) == 2
    ids = []
    for element in drawn:
        tree = ET.fromstring(element)
        ids += [found for part in tree.iter() if (found := part.get("id"))]
    assert len(ids) == len(set(ids))
    assert "2026" not in "".join(drawn)
    words = page_of(calibration(pictures=PICTURES)).words
    assert "Path $1 <b>" in words
    assert "where & how" in words


def test_pictures_hold_every_point_that_is_a_number() -> None:
    pytest.importorskip("matplotlib")
    x = np.array([0.0, 1.0, math.nan, 3.0, math.inf])
    picture = ReportPicture(title="t", axes=("x", "y"), series=(Series(x=x, y=np.arange(5.0)),))
    (element,) = svgs(as_html(calibration(pictures=(picture,)), "a", "b", "c"))
    colour = "#0072b2"
    marks = [
        part
        for part in ET.fromstring(element).iter("{http://www.w3.org/2000/svg}use")
        if f"fill: {colour}" in part.get("style", "")
    ]
    assert len(marks) == 3
    apart = np.diff([float(mark.get("x", "nan")) for mark in marks])
    assert apart[1] == pytest.approx(2.0 * apart[0], abs=1e-3)


def test_a_colour_means_the_same_in_every_picture_and_the_page_says_what() -> None:
    pytest.importorskip("matplotlib")
    x = np.arange(3.0)
    fitted = Series(x=x, y=x, role="fitted", style="line")
    before = Series(x=x, y=x + 1.0, role="before", style="line")
    pictures = tuple(
        ReportPicture(title="t", axes=("x", "y"), series=each)
        for each in ((fitted,), (before, fitted), (before,))
    )
    page = as_html(calibration(pictures=pictures), "a", "b", "c")
    first, second, third = svgs(page)
    green, orange = ROLES["fitted"].colour, ROLES["before"].colour
    assert green in first
    assert green in second
    assert green not in third
    assert orange not in first
    assert orange in second
    assert orange in third
    legend = page.split("<h2>Pictures</h2>")[1].split("<div")[0]
    assert ROLES["fitted"].meaning in legend
    assert ROLES["before"].meaning in legend
    assert ROLES["rear"].meaning not in legend
    assert len({look.colour for look in ROLES.values()}) == len(ROLES)


def test_a_row_has_a_bound_or_says_why_not() -> None:
    with pytest.raises(ValueError, match="give a limit, or say why"):
        Fitted(key="", name="x", value=1.0, sigma=1.0)
    assert "no bound: read only" in page_of(calibration()).words
    assert "sigma at most –: read only" in as_text(calibration())


def test_without_matplotlib_the_page_says_how_to_get_the_pictures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    words = page_of(calibration(USED, pictures=PICTURES)).words
    assert any("pip install matplotlib" in word for word in words)
    assert "✓ Passed" in words


def test_the_file_is_written_or_the_reason_told(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_html(path, calibration(USED), "run\udc80.mcap", "2026-11-22", "mine.toml")
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(UserError, match=r"cannot write the report"):
        write_html(tmp_path / "absent" / "a.html", calibration(), "a", "b", "c")


def test_a_value_that_is_not_observable_is_said_to_be_so_without_a_number() -> None:
    for sigma in (math.inf, math.nan):
        row = dataclasses.replace(HEADING, sigma=sigma)
        assert row.failure == "heading of the lidar is not observable in this drive"


def test_json_has_the_same_figures_and_null_where_there_is_no_number() -> None:
    found: dict[str, Any] = json.loads(
        json.dumps(as_json(calibration(USED, FLAT), "run.mcap", "2026-11-22"), allow_nan=False)
    )
    assert (found["kind"], found["source"]) == ("lidar", "run.mcap")
    assert not found["passed"]
    assert found["failures"] == ["delay separate from rotation: drive eights & stop <often>"]
    heading, noise = found["fitted"]
    assert heading["value"] == HEADING.value
    assert heading["halves"] == list(HEADING.halves or ())
    assert noise["sigma"] is None
    assert found["settings"] == {
        "lidar.heading_rad": HEADING.value,
        "lidar.blind_sectors": [{"centre_rad": 0.5, "width_rad": 0.1}],
    }
    assert found["figures"] == {"share": 0.25, "by_range_m": {"1": None}}
    assert as_json(calibration(USED), "", "")["passed"] is True


@pytest.mark.parametrize("columns", [30, 60, 79])
def test_a_narrow_terminal_gets_the_same_words_in_more_lines(columns: int) -> None:
    narrow, wide = as_text(calibration(USED, FLAT), columns), as_text(calibration(USED, FLAT))
    assert max(map(len, narrow.split("\n"))) <= columns
    assert sorted(narrow.split()) == sorted(wide.split())
    assert as_text(calibration(USED, FLAT), 200.0) == wide


def test_the_console_has_80_columns_and_the_verdict_last() -> None:
    text = as_text(calibration(USED, FLAT))
    lines = text.split("\n")
    assert max(len(line) for line in lines) <= 80
    (heading,) = (line for line in lines if line.startswith("heading"))
    words = " ".join(heading.split())
    assert words == "heading of the lidar 3.002 ± 0.017 deg 0.1 deg 0.573 ok"
    assert text.endswith("refused:\n- delay separate from rotation: drive eights & stop <often>")
    assert as_text(calibration(USED)).endswith("\n\npassed")


@pytest.mark.parametrize(
    ("value", "sigma", "shown"),
    [
        (123.456, 7.0, "123.5 ± 7.0 m"),
        (123.456, 70.0, "123 ± 70 m"),
        (0.00123456, 0.0000012, "0.0012346 ± 0.0000012 m"),
        (5.0, 0.0, "5 m"),
        (5.0, math.inf, "5 m"),
        (math.nan, 0.1, "nan ± 0.10 m"),
    ],
)
def test_a_value_has_the_digits_that_its_sigma_allows(
    value: float, sigma: float, shown: str
) -> None:
    row = Fitted(key="", name="x", value=value, sigma=sigma, unbounded="none", unit="m")
    fit = Calibration(kind="k", fitted=(row,), checks=(), residuals="")
    assert shown in as_text(fit)
    assert shown in as_html(fit, "", "", "")


@pytest.mark.parametrize(
    ("check", "found", "needed"),
    [
        (at_least("c", 4.0, 3.0, "m").otherwise("a"), "4 m", "≥ 3 m ok"),
        (at_least("c", 2.0, 3.0, "m").otherwise("a"), "2 m", "≥ 3 m fails"),
        (at_most("c", 2.0, 3.0, "m").otherwise("a"), "2 m", "≤ 3 m ok"),
        (at_most("c", 4.0, 3.0, "m").otherwise("a"), "4 m", "≤ 3 m fails"),
        (at_most("c", 3.0, 3.0, "m").otherwise("a"), "3 m", "≤ 3 m ok"),
        (at_least("c", 2.99999, 3.0, "m").otherwise("a"), "2.99999 m", "≥ 3 m fails"),
        (at_most("c", 3.00001, 3.0, "m").otherwise("a"), "3.00001 m", "≤ 3 m fails"),
        (at_most("c", math.nan, 3.0, "m").otherwise("a"), "–", "≤ 3 m fails"),
        (at_least("c", math.nan, 3.0, "m").otherwise("a"), "–", "≥ 3 m fails"),
        (at_most("c", math.inf, 0.003, "mm rms").otherwise("a"), "–", "≤ 3 mm rms fails"),
        (at_least("c", math.inf, 3.0, "m").otherwise("a"), "–", "≥ 3 m ok"),
        (at_least("c", 0.02, -math.inf, "ms").otherwise("a"), "20 ms", "ok"),
        (at_least("c", 0.02, math.nan, "ms").otherwise("a"), "20 ms", "fails"),
        (at_most("c", -0.4967, 0.15, "%").otherwise("a"), "-49.67 %", "≤ 15 % ok"),
    ],
)
def test_a_check_shows_its_bound_on_its_own_side_whatever_came_out(
    check: Check, found: str, needed: str
) -> None:
    line = as_text(calibration(check)).split("\nc ")[1].split("\n")[0]
    assert " ".join(line.split()) == f"{found} {needed}"
    side, word = needed.rpartition(" ")[::2]
    words = page_of(calibration(check)).words
    assert {found, side} - {""} <= set(words)
    assert any(each.endswith(word) for each in words)
    (entry,) = as_json(calibration(check), "", "")["checks"]
    assert (entry["side"], entry["passed"]) == (check.side, word == "ok")


def test_a_sigma_just_beyond_its_limit_is_shown_in_digits_enough() -> None:
    row = dataclasses.replace(HEADING, sigma=math.radians(0.1000001), limit=math.radians(0.1))
    assert row.failure == "heading of the lidar is known to 0.1000001 deg only, not to 0.1 deg"


@given(st.floats(1e-6, 1e3), st.floats(1e-6, 1e3), st.floats(-1e3, 1e3), st.floats(0.0, 4.0))
def test_halves_may_differ_by_six_sigmas_or_two_limits(
    sigma: float, limit: float, middle: float, apart: float
) -> None:
    assume(abs(apart - 1.0) > 1e-6 and sigma <= limit)
    bound = max(6.0 * sigma, 2.0 * limit)
    halves = middle, middle + apart * bound
    assume(abs(abs(halves[1] - halves[0]) / bound - apart) < 1e-7)
    row = dataclasses.replace(HEADING, value=middle, sigma=sigma, limit=limit, halves=halves)
    for each in (row, dataclasses.replace(row, halves=halves[::-1])):
        assert ("two halves" in each.failure) == (apart > 1.0)


def test_rounding_errors_of_zero_are_shown_as_zero():
    jitter = at_most("lateness", 3.9e-15, 0.005, "ms").otherwise("(never shown)")
    assert check_cells(jitter) == ("0 ms", "≤ 5 ms", "ok")
