"""The error measures of Belaroussi 2024 (section 6.2.1), and GOSPA over time, for any source."""

import math
from collections.abc import Callable, Iterator

from host.calibration.result import ReportPicture
from host.evaluation import curves
from host.evaluation.curves import Bins, PairErrors
from host.experiments.paper_figure import Cell, PaperFigure, label, line
from host.sessions.offline.evaluating import Scored

GOSPA_BIN_S = 5.0


def figures(scored: Scored) -> Iterator[PaperFigure]:
    """RMSE and 67th percentile, cumulative error, error over distance, angle and time."""
    found = {key: curves.pair_errors(each.instants) for key, each in scored.scores.items()}
    yield _measures(found)
    yield _cumulative(found)
    yield _binned(found, "distance", _over_distance, 1.0, "distance of the robot (m)")
    yield _binned(found, "angle", curves.over_angle, math.degrees(1.0), "bearing of the robot (°)")
    yield _gospa(scored)


Found = dict[tuple[str, str], PairErrors]


def _measures(found: Found) -> PaperFigure:
    rows: list[list[Cell]] = []
    for (name, sensors), pairs in found.items():
        rows.append([name, sensors, len(pairs.errors), pairs.rmse_m, pairs.p67_m])
    return PaperFigure("rmse_and_p67", ("filter", "sensors", "pairs", "RMSE m", "p67 m"), rows)


def _cumulative(found: Found) -> PaperFigure:
    rows: list[list[Cell]] = []
    series = []
    for (name, sensors), pairs in found.items():
        edges, shares = curves.cumulative(pairs.errors)
        rows += [[name, sensors, float(e), float(s)] for e, s in zip(edges, shares, strict=True)]
        series.append(line(edges, shares, label(name, sensors)))
    return PaperFigure(
        "cumulative_error",
        ("filter", "sensors", "error m", "share of pairs"),
        rows,
        ReportPicture(
            title="Cumulative error (Belaroussi 2024, section 6.2.1)",
            axes=("error of a pair (m)", "share of pairs with at most this error"),
            series=tuple(series),
        ),
    )


def _over_distance(pairs: PairErrors) -> Bins:
    return curves.rms_in_bins(pairs.distances, pairs.errors, curves.DISTANCE_BIN_M)


def _binned(
    found: Found, what: str, bins_of: Callable[[PairErrors], Bins], scale: float, axis: str
) -> PaperFigure:
    """Error over distance or over angle."""
    rows: list[list[Cell]] = []
    series = []
    for (name, sensors), pairs in found.items():
        bins = bins_of(pairs)
        middles = scale * bins.middles
        for middle, count, rms in zip(middles, bins.counts, bins.rms_m, strict=True):
            rows.append([name, sensors, float(middle), int(count), float(rms)])
        series.append(line(middles, bins.rms_m, label(name, sensors)))
    return PaperFigure(
        f"error_over_{what}",
        ("filter", "sensors", axis, "pairs", "RMSE m"),
        rows,
        ReportPicture(
            title=f"Error over {what} (Belaroussi 2024, section 6.2.1)",
            axes=(axis, "RMSE of pairs (m)"),
            series=tuple(series),
        ),
    )


def _gospa(scored: Scored) -> PaperFigure:
    rows: list[list[Cell]] = []
    series = []
    for (name, sensors), each in scored.scores.items():
        times, means = curves.gospa_over_time(each.instants, GOSPA_BIN_S)
        rows += [[name, sensors, float(t), float(m)] for t, m in zip(times, means, strict=True)]
        series.append(line(times, means, label(name, sensors)))
    return PaperFigure(
        "gospa_over_time",
        ("filter", "sensors", "time s", "GOSPA m"),
        rows,
        ReportPicture(
            title=f"GOSPA over time, mean of each {GOSPA_BIN_S:g} s",
            axes=("time (s)", "GOSPA (m)"),
            series=tuple(series),
        ),
    )
