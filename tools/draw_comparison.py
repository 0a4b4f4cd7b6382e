"""Draws docs/pixels.svg: each filter with the lidar only (LO) beside lidar and cameras (LC).

The bearings come from rendered pictures, the figures from `swarmloc evaluate`:

    swarmloc evaluate arena4:seconds=120,seed={11,12,13,14,15},rendered=1 --json pixels.json
    .venv/bin/python tools/draw_comparison.py pixels.json > docs/pixels.svg
"""

import argparse
import json
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from host.errors import UserError
from host.messages import FloatArray
from host.registry import SCENARIOS
from host.simulation.world import scenarios
from host.simulation.world.scenarios import Scenario
from host.simulation.world.settings import settings as settings_of

WIDTH, TOP = 900, 112  # of the picture and above the first filter, px
BAR, GROUP = 24, 74  # height of a bar and of a filter's two bars with the gap below, px
INK, SOFT, GRID = "#22313a", "#5b6b73", "#e3e8eb"
# Its white ground makes it legible on a dark page too.
HEADER = f"""\
<svg xmlns="http://www.w3.org/2000/svg" width="{{width}}" height="{{height}}"
 viewBox="0 0 {{width}} {{height}}" font-family="Helvetica, Arial, sans-serif" font-size="13"
 fill="{INK}">
<rect width="{{width}}" height="{{height}}" fill="#fff"/>"""
LABELS = {"lidar": ("LO", "#aebcc4"), "lidar+camera": ("LC", "#e0a030")}  # in the order drawn
ABOUT = {
    "perera2021": "the filter of Perera 2021",
    "clairvoyant": "knows which reading is whose",
}
SMALL = f'fill="{SOFT}" font-size="12"'
BOLD = 'font-weight="bold"'
# White around it keeps a value legible where it crosses a line of the grid.
VALUE = 'font-size="12" paint-order="stroke" stroke="#fff" stroke-width="3"'


class Panel(NamedTuple):
    """One figure of `evaluate` along an axis."""

    key: str
    title: str
    unit: str
    scale: float  # from the figure's unit to the one drawn
    digits: int  # of the mean, behind the point
    left_px: float
    width_px: float


PANELS = (
    Panel("gospa_m", "GOSPA", "m", 1.0, 3, 240.0, 226.0),
    Panel("time_over_30cm", "No estimate within 30 cm", "% of the time", 100.0, 1, 560.0, 190.0),
)
FALSE_PX = 846.0  # middle of the column of false estimates


class Comparison(NamedTuple):
    """Rows of `evaluate`, by filter, sensors and seed, and the scenario without its seed."""

    scenario: str
    seconds: float
    seeds: list[int]
    rows: dict[str, dict[str, dict[int, dict[str, Any]]]]

    def values(self, name: str, sensors: str, key: str) -> list[float]:
        """One figure of one filter, for each seed in order."""
        return [self.rows[name][sensors][seed][key] for seed in self.seeds]


def read(rows: Sequence[dict[str, Any]]) -> Comparison:
    """Sort rows of `evaluate --json`; those pooled over seeds are left out.

    Raises UserError where the rows are not one rendered scenario, with every filter scored on
    every seed with and without cameras.
    """
    found: dict[str, Any] = defaultdict(lambda: defaultdict(dict))
    settings: dict[Scenario, str] = {}
    for row in rows:
        if row["source"].partition(":")[0] not in SCENARIOS.names():
            continue
        scenario = scenarios.parse_scenario(row["source"])
        settings[replace(scenario, seed=0)] = row["source"]
        found[row["filter"]][row["sensors"]][scenario.seed] = row
    if len(settings) != 1 or not next(iter(settings)).rendered:
        raise _unfit(f"it holds {', '.join(settings.values()) or 'no scenario'}")
    (scenario, source), *_ = settings.items()
    seeds = sorted({seed for kinds in found.values() for rows in kinds.values() for seed in rows})
    for name, sensors, seed in product(found, LABELS, seeds):
        row = found[name][sensors].get(seed, {})
        if any(row.get(key) is None for key in (*(panel.key for panel in PANELS), "false")):
            raise _unfit(f"{name} has no figures of {sensors} with seed={seed}")
    which = f"{{{','.join(map(str, seeds))}}}" if len(seeds) > 1 else str(seeds[0])
    given = {**settings_of(source), "seed": which}
    listed = ",".join(f"{key}={value}" for key, value in given.items())
    return Comparison(f"{scenario.name}:{listed}", scenario.seconds, seeds, found)


def _unfit(why: str) -> UserError:
    return UserError(
        "these figures cannot be compared",
        why,
        "evaluate one scenario with rendered=1, only its seeds differing, and both sensors",
    )


def picture(figures: Comparison) -> str:
    """The comparison as SVG."""
    marks = [ticks(highest(figures, panel)) for panel in PANELS]
    bottom = TOP + GROUP * len(figures.rows) - (GROUP - 2 * BAR) + 12
    height, seeds = bottom + 96, len(figures.seeds)
    key = "LO: lidar only. LC: lidar and cameras, whose rendered pictures are searched for "
    key += "teammates. Less is better everywhere."
    drawn = f"Bar and number: mean of {seeds} seed{'s' * (seeds > 1)}, {figures.seconds:g} s each. "
    drawn += "Dot: one seed, the first on top. Teammates within 2 m count."
    parts = [
        HEADER.format(width=WIDTH, height=height),
        text(24, 34, "What the cameras add, from pixels", f'font-size="17" {BOLD}'),
        text(24, 56, key, SMALL),
        text(FALSE_PX, TOP - 38, "False", f'text-anchor="middle" {BOLD}'),
        text(FALSE_PX, TOP - 22, "per scan", f'text-anchor="middle" {SMALL}'),
        text(24, height - 36, drawn, SMALL),
        text(24, height - 16, f"tools/draw_comparison.py: {figures.scenario}", SMALL),
    ]
    for panel, values in zip(PANELS, marks, strict=True):
        parts += axis(panel, values, bottom)
    for k, name in enumerate(figures.rows):
        parts += group(figures, name, [values[-1] for values in marks], TOP + GROUP * k)
    return "\n".join([*parts, "</svg>"])


def highest(figures: Comparison, panel: Panel) -> float:
    """The greatest value of a panel, as drawn."""
    values = [figures.values(n, s, panel.key) for n in figures.rows for s in LABELS]
    return panel.scale * max(max(v) for v in values)


def ticks(top: float) -> list[float]:
    """Round values from 0 to `top` or just beyond, at most seven."""
    if top <= 0.0:
        return [0.0, 1.0]
    power = 10.0 ** math.floor(math.log10(top / 6.0))
    step = next(n * power for n in (1.0, 2.0, 5.0, 10.0) if top <= 6.0 * n * power)
    return [step * k for k in range(math.ceil(top / step - 1e-9) + 1)]


def axis(panel: Panel, marks: list[float], bottom: float) -> list[str]:
    """Title, grid and numbers of a panel."""
    middle = panel.left_px + panel.width_px / 2.0
    parts = [text(panel.left_px, TOP - 22, panel.title, BOLD)]
    for mark in marks:
        x = panel.left_px + panel.width_px * mark / marks[-1]
        line = INK if mark == 0.0 else GRID
        parts.append(f'<path d="M{x:.1f} {TOP - 10}V{bottom}" stroke="{line}"/>')
        parts.append(text(x, bottom + 16, f"{mark:.6g}", f'text-anchor="middle" {SMALL}'))
    parts.append(text(middle, bottom + 33, panel.unit, f'text-anchor="middle" {SMALL}'))
    return parts


def group(figures: Comparison, name: str, ends: list[float], top: float) -> list[str]:
    """The bars of one filter, from `top` px down; `ends`: the greatest value of each axis."""
    parts = [text(24, top + 21, name, BOLD), text(24, top + 38, ABOUT.get(name, ""), SMALL)]
    for k, (sensors, (label, colour)) in enumerate(LABELS.items()):
        y = top + BAR * (k + 0.5)
        for panel, end in zip(PANELS, ends, strict=True):
            values = panel.scale * np.array(figures.values(name, sensors, panel.key))
            parts.append(text(panel.left_px - 28, y + 4.5, label))
            parts += bar(panel, values, end, y, colour)
        false = np.mean(figures.values(name, sensors, "false"))
        parts.append(text(FALSE_PX, y + 4.5, f"{false:.2f}", 'text-anchor="middle" font-size="12"'))
    return parts


def bar(panel: Panel, values: FloatArray, end: float, y: float, colour: str) -> list[str]:
    """The mean of values (n,) as a bar and a number, and each as a dot; `end` ends the axis."""
    x = panel.left_px + panel.width_px * values / end
    length = x.mean() - panel.left_px
    parts = [
        f'<rect x="{panel.left_px:.1f}" y="{y - BAR / 2 + 2:.1f}" width="{length:.1f}" '
        f'height="{BAR - 4}" fill="{colour}"/>'
    ]
    for k, middle in enumerate(x):
        # Spread over the bar's height, so that equal seeds do not hide each other.
        height = y + (BAR - 12) * ((k + 0.5) / len(x) - 0.5)
        parts.append(
            f'<circle cx="{middle:.1f}" cy="{height:.1f}" r="2.6" fill="{INK}" '
            'stroke="#fff" stroke-width="0.8"/>'
        )
    parts.append(text(x.max() + 9, y + 4.5, f"{values.mean():.{panel.digits}f}", VALUE))
    return parts


def text(x_px: float, y_px: float, words: str, style: str = "") -> str:
    """Words at a place."""
    return f'<text x="{x_px:.1f}" y="{y_px:.1f}" {style}>{escape(words)}</text>'


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("figures", type=Path, help="what `swarmloc evaluate --json` wrote")
    try:
        print(
            picture(
                read(json.loads(parser.parse_args().figures.read_text(encoding="utf-8"))["rows"])
            )
        )
    except UserError as error:
        raise SystemExit(str(error)) from None
