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
        Series(x=np.zeros(1), y=np.zeros(1), label="pivot", role="reference"),
        Series(x=x, y=y, label="together", role="fitted"),
    ]
    for name, (places, _) in turrets_by_sensor(problem, solution).items():
        x, y = 1e3 * places.reshape(-1, 2).T
        role: Role = "measured" if name == "lidar" else "front"
        series.append(Series(x=x, y=y, label=f"by {name} alone", role=role))
    return (
        ReportPicture(
            title="turrets beside their bodies' pivots",
            x_label="ahead, mm",
            y_label="to the left, mm",
            series=tuple(series),
            caption="each turret in the frame of its body: the three marks of one lie together",
            equal=True,
        ),
    )
