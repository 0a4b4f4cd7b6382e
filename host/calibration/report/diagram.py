"""A calibration's pictures as SVG, drawn by matplotlib (the extra "report")."""

import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from host.calibration.result import ReportPicture, Role, Series
from host.messages import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Look(NamedTuple):
    """How points and lines of one role are drawn, and what the role is called."""

    colour: str
    marker: str
    meaning: str


# Okabe and Ito's colours and two of Tol's, distinct for the colour-blind, too; markers make them
# distinct in grey. A role has the same in every picture of every report.
ROLES: dict[Role, Look] = {
    "measured": Look("#0072b2", "o", "measured"),
    "refused": Look("#d55e00", "x", "measured, and left out"),
    "reference": Look("#1c2733", "D", "the reference"),
    "before": Look("#e69f00", "s", "by the values from before"),
    "fitted": Look("#009e73", "^", "by the fitted values"),
    "front": Look("#56b4e9", "o", "front camera"),
    "rear": Look("#cc79a7", "v", "rear camera"),
    "along": Look("#332288", "o", "along the line of sight"),
    "across": Look("#999933", "v", "across it"),
}
# For pictures whose series have no role: one after another.
_SERIES: tuple[Role, ...] = ("measured", "refused", "fitted", "rear", "front", "before")

_INK, _FAINT = "#1c2733", "#d8dee4"
_SIZE_IN, _SQUARE_IN = (5.4, 3.3), (5.4, 4.6)
_MANY = 1500  # points from here on are painted as one bitmap, so that the file stays small
_STYLE: Any = {
    "svg.fonttype": "path",
    "svg.hashsalt": "swarmloc",  # else the same picture differs from run to run
    "text.parse_math": False,  # a $ in a name is a $
    "font.family": "DejaVu Sans",  # comes with matplotlib, so looks the same everywhere
    "font.size": 9.0,
    "axes.edgecolor": "#8a97a3",
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.8,
    "xtick.color": "#4a5763",
    "ytick.color": "#4a5763",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}
# Nothing in the file changes from run to run.
_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))


def svg(picture: ReportPicture, number: int) -> str:
    """The picture as an <svg> element; `number` keeps its ids apart from other pictures'.

    Raises ImportError where matplotlib is not installed.
    """
    text = io.StringIO()
    with _drawn(picture) as figure:
        figure.savefig(text, format="svg", metadata=_NO_METADATA)
    element = text.getvalue()
    element = element[element.index("<svg") :].strip()
    element = re.sub(r'( id="|url\(#|href="#)', rf"\g<1>p{number}-", element)
    element = re.sub(r"<!--.*?-->\n?", "", element, flags=re.DOTALL)
    return "\n".join(line.strip() for line in element.split("\n"))


def save(picture: ReportPicture, stem: Path) -> None:
    """Write the picture, under its title, to STEM.svg and STEM.png.

    Raises ImportError where matplotlib is not installed, OSError where a file cannot be written.
    """
    with _drawn(picture) as figure:
        figure.suptitle(picture.title, fontsize=9.5, x=0.01, ha="left")
        (axes,) = figure.axes
        if not picture.equal and axes.dataLim.y0 >= 0.0:
            axes.set_ylim(bottom=0.0)
        figure.savefig(f"{stem}.svg", metadata=_NO_METADATA)
        figure.savefig(f"{stem}.png")


@contextmanager
def _drawn(picture: ReportPicture) -> Iterator["Figure"]:
    """The figure, to be saved within this context: its style holds only here."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        size = _SQUARE_IN if picture.equal else _SIZE_IN
        figure = Figure(figsize=size, dpi=150, layout="constrained")
        _draw(figure.add_subplot(), picture)
        yield figure


def _draw(axes: "Axes", picture: ReportPicture) -> None:
    axes.set_xlabel(picture.axes[0])
    axes.set_ylabel(picture.axes[1])
    axes.grid(color=_FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if picture.equal:
        axes.set_aspect("equal", adjustable="datalim")
    bars = [series for series in picture.series if series.style == "bars"]
    drawn = False
    for series, other in zip(picture.series, cycle(_SERIES), strict=False):
        look = ROLES[series.role or other]
        x, y = _finite(series)
        if not np.isfinite(x + y).any():
            continue
        drawn = True
        if series.style == "bars":
            _bars(axes, series, bars, look.colour)
        elif series.style == "line":
            axes.plot(x, y, color=look.colour, linewidth=1.4, label=series.label)
        else:
            _points(axes, x, y, look, series.label)
    if not drawn:
        axes.text(0.5, 0.5, "no data", transform=axes.transAxes, ha="center", color="#4a5763")
    _legend(axes)


def _finite(series: Series) -> tuple[FloatArray, FloatArray]:
    """x and y, with nan (a gap in a line) where one of both is not finite."""
    x, y = (np.asarray(values, dtype=float).ravel() for values in (series.x, series.y))
    good = np.isfinite(x) & np.isfinite(y)
    return np.where(good, x, math.nan), np.where(good, y, math.nan)


def _points(axes: "Axes", x: FloatArray, y: FloatArray, look: Look, label: str) -> None:
    count = int(np.isfinite(x).sum())
    axes.plot(
        x,
        y,
        linestyle="none",
        marker=look.marker,
        markersize=6.0 if count < 10 else 3.6 if count < 300 else 2.2,
        markeredgewidth=1.0 if look.marker == "x" else 0.0,
        color=look.colour,
        alpha=0.9 if count < 300 else 0.45,
        rasterized=count > _MANY,
        label=label,
    )


def _bars(axes: "Axes", series: Series, bars: list[Series], colour: str) -> None:
    """Bars around x; those of several series stand side by side."""
    x, y = _finite(series)
    apart = np.diff(np.unique(x[np.isfinite(x)]))
    width = 0.86 * float(apart.min()) / len(bars) if len(apart) else 0.8 / len(bars)
    place = next(k for k, other in enumerate(bars) if other is series)
    shift = (place - 0.5 * (len(bars) - 1)) * width
    good = np.isfinite(x)
    axes.bar(x[good] + shift, y[good], width=width, color=colour, label=series.label)


def _legend(axes: "Axes") -> None:
    """Above the picture, where it hides nothing; its marks as strong as can be."""
    named, _ = axes.get_legend_handles_labels()
    if not named:
        return
    legend = axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=min(3, len(named)),
        borderaxespad=0.2,
        handletextpad=0.5,
        columnspacing=1.4,
    )
    for mark in legend.get_lines():
        mark.set_alpha(1.0)
        if mark.get_linestyle() == "None":
            mark.set_markersize(5.0)
