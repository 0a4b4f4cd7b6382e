"""What the joint fit says of sensors that do not mean the same turrets."""

import numpy as np
import pytest

from host.calibration.joint.fit import Solution, solve
from host.calibration.joint.pictures import pictures
from host.calibration.joint.problem import Problem
from host.calibration.joint.unknowns import Unknowns
from host.calibration.joint.verdict import turrets_by_sensor, verdict
from host.calibration.robust.evidence import Evidence, Prior
from host.messages import FloatArray

UNKNOWNS = Unknowns(6, [2, 3])
SIZE, SIGMA_M = len(UNKNOWNS), 0.001
TURRETS = np.array([0.004, -0.006, 0.008, 0.002])


class Direct:
    """A sensor that sees each of its own values, and each turret with SIGMA_M."""

    def __init__(self, part: slice, turrets: FloatArray) -> None:
        self.weights, self.target = np.zeros(SIZE), np.zeros(SIZE)
        self.weights[part], self.weights[UNKNOWNS.turrets] = 1.0, SIGMA_M**-2.0
        self.target[UNKNOWNS.turrets] = turrets

    def evidence(self, values: FloatArray) -> Evidence:
        information = np.diag(self.weights)
        return Evidence(
            information, self.weights * (values - self.target), information, np.zeros(SIZE)
        )


def solved(apart_m: float) -> tuple[Problem, Solution]:
    prior = np.zeros((SIZE, SIZE))
    prior[UNKNOWNS.turrets, UNKNOWNS.turrets] = 0.01**-2.0 * np.eye(4)
    free = np.full(SIZE, True)
    free[UNKNOWNS.wheels] = False
    problem = Problem(
        UNKNOWNS,
        Prior(np.zeros(SIZE), prior, free),
        np.zeros(SIZE),
        np.zeros(SIZE),
        [],
        {
            "lidar": Direct(UNKNOWNS.lidar, TURRETS),
            "camera": Direct(UNKNOWNS.cameras, TURRETS + apart_m),
        },
    )
    return problem, solve(list(problem.sensors.values()), problem.prior, problem.start)


@pytest.mark.parametrize("sigmas", [0.0, 2.0, 4.0])
def test_sensors_that_mean_other_turrets_fail_by_how_many_sigmas_they_are_apart(
    sigmas: float,
) -> None:
    problem, solution = solved(sigmas * 2.0**0.5 * SIGMA_M)
    settled, apart = verdict(problem, solution)
    assert settled.passed
    # The weak hold on pivots takes a hundredth off.
    assert apart.value == pytest.approx(sigmas, rel=0.02, abs=1e-6)
    assert apart.passed == (sigmas < 3.0)
    assert "the lidar has turrets up to 8 mm beside their pivots" in apart.advice


def test_each_sensor_alone_and_both_together_are_shown() -> None:
    problem, solution = solved(0.003)
    alone = turrets_by_sensor(problem, solution)
    assert alone["lidar"][0] == pytest.approx(TURRETS, abs=1e-5)
    assert alone["camera"][0] == pytest.approx(TURRETS + 0.003, abs=1e-5)
    (picture,) = pictures(problem, solution)
    together = next(series for series in picture.series if series.role == "fitted")
    both = np.stack((together.x, together.y), axis=1).ravel()
    # Halfway, and by the hold towards the pivots by 1 in 200.
    assert both == pytest.approx(1e3 * (TURRETS + 0.0015) / 1.005, abs=1e-3)
