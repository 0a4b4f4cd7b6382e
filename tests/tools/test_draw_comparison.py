"""tools/draw_comparison.py: what stands in the picture is what was evaluated."""

import importlib.util
import math
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from host.errors import UserError

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("draw_comparison", ROOT / "tools/draw_comparison.py")
assert SPEC is not None
assert SPEC.loader is not None
tool = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tool)

SVG = "{http://www.w3.org/2000/svg}"
GOSPA_M = {"lidar": (0.11, 0.19), "lidar+camera": (0.06, 0.10)}  # of seeds 3 and 4


def row(name: str, sensors: str, seed: int, settings: str = "rendered=1") -> dict[str, Any]:
    return {
        "source": f"arena4:seconds=20,seed={seed},{settings}",
        "filter": name,
        "sensors": sensors,
        "gospa_m": GOSPA_M[sensors][seed - 3] * (1.0 if name == "phd" else 10.0),
        "time_over_30cm": 0.02 * seed,
        "false": 1.5,
    }


def rows(settings: str = "rendered=1") -> list[dict[str, Any]]:
    several = [(n, s, k) for k in (4, 3) for n in ("perera2021", "phd") for s in GOSPA_M]
    return [row(*each, settings) for each in several]


def test_bars_are_as_long_as_means_and_dots_stand_at_seeds() -> None:
    root = ElementTree.fromstring(tool.picture(tool.read(rows())))
    panel = tool.PANELS[0]
    bars = [r for r in root.iter(f"{SVG}rect") if r.get("x") == f"{panel.left_px:.1f}"]
    lengths = [float(r.attrib["width"]) for r in bars]
    metre_px = lengths[0] / 1.5
    assert lengths == pytest.approx(
        [1.5 * metre_px, 0.8 * metre_px, 0.15 * metre_px, 0.08 * metre_px], abs=0.1
    )
    dots = [float(c.attrib["cx"]) - panel.left_px for c in root.iter(f"{SVG}circle")]
    assert dots[:2] == pytest.approx([1.1 * metre_px, 1.9 * metre_px], abs=0.2)


def test_what_is_written_is_the_mean_over_seeds() -> None:
    words = [t.text for t in ElementTree.fromstring(tool.picture(tool.read(rows()))).iter()]
    for mean in ("1.500", "0.800", "0.150", "0.080", "7.0", "1.50"):
        assert mean in words
    assert "tools/draw_comparison.py: arena4:seconds=20,seed={3,4},rendered=1" in words


def test_everything_stays_within_the_picture() -> None:
    svg = tool.picture(tool.read(rows()))
    root = ElementTree.fromstring(svg)
    width, height = float(root.attrib["width"]), float(root.attrib["height"])
    for key, limit in (("x", width), ("cx", width), ("y", height), ("cy", height)):
        assert all(0.0 <= float(v) < limit for v in re.findall(rf' {key}="([^"]+)"', svg))


def test_rows_pooled_or_from_recordings_are_left_out() -> None:
    pooled = row("phd", "lidar", 3) | {"source": "arena4 x2", "gospa_m": 99.0}
    recorded = row("phd", "lidar", 3) | {"source": "today.mcap", "gospa_m": 99.0}
    assert tool.picture(tool.read([*rows(), pooled, recorded])) == tool.picture(tool.read(rows()))


@pytest.mark.parametrize(
    ("unfit", "why"),
    [
        ([], "no scenario"),
        (rows("rendered=0"), "rendered=0"),
        ([*rows(), row("phd", "lidar", 3, "rendered=1,posts=9")], "posts=9"),
        (rows()[:-1], "phd has no figures of lidar+camera with seed=3"),
        ([*rows()[:-1], rows()[-1] | {"gospa_m": None}], "phd has no figures"),
    ],
)
def test_what_cannot_be_compared_is_refused(unfit: list[dict[str, Any]], why: str) -> None:
    with pytest.raises(UserError) as refusal:
        tool.read(unfit)
    assert why in refusal.value.why


@pytest.mark.parametrize("top", [0.0, 1e-3, 0.2, 0.21, 1.0, 1.14, 6.0, 61.0, 99.9])
def test_ticks_are_few_and_reach_the_greatest_value(top: float) -> None:
    marks = tool.ticks(top)
    assert 2 <= len(marks) <= 7
    assert marks[0] == 0.0
    assert top <= marks[-1] * (1.0 + 1e-9)
    assert math.isclose(marks[-1], marks[1] * (len(marks) - 1))
