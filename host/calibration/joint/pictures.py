"""The joint fit in the report."""

import numpy as np

from host.calibration.joint.fit import Solution
from host.calibration.joint.problem import Problem
from host.calibration.joint.verdict import turrets_by_sensor
from host.calibration.result import ReportPicture, Role, Series


def pictures(problem: Problem, solution: Solution) -> tuple[ReportPicture, ...]:
    """Where turrets are beside their pivots, by both sensors together and by each alone."""
    part = problem.unknowns.turrets
    x, y = 1e3 * solution.values[part].reshape(-1, 2).T
    series = [
        Series(np.zeros(1), np.zeros(1), "pivot", "reference"),
        Series(x, y, "together", "fitted"),
    ]
    for name, (places, _) in turrets_by_sensor(problem, solution).items():
        role: Role = "measured" if name == "lidar" else "front"
        x, y = 1e3 * places.reshape(-1, 2).T
        series.append(Series(x, y, f"by {name} alone", role))
    return (
        ReportPicture(
            title="turrets beside their bodies' pivots",
            axes=("ahead, mm", "to the left, mm"),
            series=tuple(series),
            caption="each turret in the frame of its body: the three marks of one lie together",
            equal=True,
        ),
    )
