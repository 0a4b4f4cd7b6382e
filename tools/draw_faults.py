"""Draws docs/faults.svg: GOSPA over time while sensors fail, from the published results."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from host.calibration.report import diagram
from host.calibration.result import ReportPicture, Series
from host.experiments.trials import Record, without_seed
from tools.figure_tables import FAULTS


def picture(records: Sequence[Record], filter_name: str) -> str:
    """A curve for each fault, the mean over its seeds, as SVG. Raises ImportError: matplotlib."""
    curves: dict[str, list[list[list[float]]]] = defaultdict(list)
    for record in records:
        if record["filter"] == filter_name:
            curves[without_seed(record["source"])].append(record["over_time"])
    series = []
    for fault, setting in FAULTS.items():
        of_seeds = [np.array(curve) for curve in curves[f"arena4:seconds=60{setting}"]]
        times = of_seeds[0][:, 0]
        gospa = np.mean([curve[: len(times), 1] for curve in of_seeds], axis=0)
        series.append(Series(x=times, y=gospa, label=fault, style="line"))
    return diagram.svg(
        ReportPicture(
            title="GOSPA over time while sensors fail",
            axes=("time (s)", f"{filter_name}: GOSPA (m), mean over seeds"),
            series=tuple(series),
        ),
        0,
    )
