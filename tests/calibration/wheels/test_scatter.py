"""How the scatter of windows that overlap is found again from their residuals, over draws."""

import numpy as np

from host.calibration.robust.statistics import bent_factor
from host.calibration.wheels.fit import _REACH_S, OWN, STRIDE_S, WINDOW_S, WheelProblem
from host.calibration.wheels.model import Drive, Windows

COUNT, VALUES, DRAWS = 240, 8, 150


def test_what_the_fit_takes_of_the_scatter_is_made_up_for() -> None:
    random = np.random.default_rng(7)
    overlap, reach = round(WINDOW_S / STRIDE_S), round(_REACH_S / STRIDE_S)
    starts = STRIDE_S * np.arange(COUNT)
    windows = Windows(
        np.repeat([0, 1], COUNT // 2), starts, starts + WINDOW_S, np.zeros((COUNT, 3))
    )
    nothing = Drive(np.zeros(0), np.zeros((0, 2), np.int64), np.zeros(0), np.zeros((0, 3)))
    problem = WheelProblem([nothing], 1, windows, np.ones(VALUES))
    # What is driven changes every few seconds, and the values' sensitivities with it.
    slopes = np.repeat(random.normal(size=(COUNT // 16, 3, VALUES)), 16, axis=0)
    design = slopes.reshape(-1, VALUES)
    inverse = np.linalg.inv(OWN * design.T @ design + np.diag(problem.held))
    found, true = np.zeros((2, VALUES, VALUES))
    for _ in range(DRAWS):
        steps = random.normal(size=(2, COUNT // 2 + overlap - 1, 3)) / np.sqrt(overlap)
        sums = [steps[:, k : k + COUNT // 2] for k in range(overlap)]
        errors = np.sum(sums, axis=0).reshape(COUNT, 3)
        score = design.T @ errors.ravel()
        true += np.outer(score, score) / DRAWS
        left = errors.ravel() - OWN * design @ (inverse @ score)
        found += problem.scatter(slopes, left.reshape(COUNT, 3)) / DRAWS
    student = bent_factor(1.5 * COUNT / reach, 2.0)
    ratio = np.trace(inverse @ found) / student / np.trace(inverse @ true)
    assert abs(ratio - 1.0) < 0.15, ratio
