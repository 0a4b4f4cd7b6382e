"""Whether the joint fit will do: does it settle, and do lidar and cameras mean the same turrets."""

import math

import numpy as np

from host.calibration.gathered import Gathered
from host.calibration.joint.fit import Solution
from host.calibration.joint.problem import Problem
from host.calibration.result import Check, Fitted, at_most
from host.calibration.robust.evidence import Prior, covariance_of, inverse_of
from host.messages import FloatArray

_SETTLED, _APART = 0.1, 3.0  # sigmas
_MOVED = 3.0
_VAGUE = 1e-2  # of the hold on turrets, where one sensor alone shall say where they are


def verdict(problem: Problem, solution: Solution) -> tuple[Check, ...]:
    """Every condition on the fit."""
    settled = at_most("last step of the fit", solution.last_step, _SETTLED, "sigmas").otherwise(
        "calibrate wheels, lidar and cameras by themselves again: this fit begins with theirs"
    )
    by = turrets_by_sensor(problem, solution)
    if len(by) < 2:
        return (settled,)
    (one, its), (other, others) = by.values()
    off = one - other
    apart = math.sqrt(float(off @ np.linalg.solve(its + others, off)) / len(off))
    lidar_mm, camera_mm = (1e3 * np.hypot(*at.reshape(-1, 2).T).max() for at in (one, other))
    return (
        settled,
        at_most(
            "distance between turrets by the lidar and by the cameras", apart, _APART, "sigmas"
        ).otherwise(
            f"the lidar has turrets up to {lidar_mm:.0f} mm beside their pivots, the cameras up to "
            f"{camera_mm:.0f} mm: the one that is farther off sees something else than turrets, or "
            "moved during the drive"
        ),
    )


def turrets_by_sensor(
    problem: Problem, solution: Solution
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Where lidar alone and cameras alone have the turrets: places (2k,) m, covariance."""
    unknowns, found = problem.unknowns, {}
    part = unknowns.turrets
    information = problem.prior.information.copy()
    information[part, part] *= _VAGUE
    for (name, _), evidence in zip(problem.sensors.items(), solution.evidence, strict=True):
        if name == "wheels":
            continue
        free = np.zeros(len(unknowns), bool)
        free[unknowns.lidar if name == "lidar" else unknowns.cameras] = True
        free[part] = True
        alone = Prior(problem.prior.mean, information, free & problem.prior.free)
        off = solution.values - alone.mean
        step = inverse_of([evidence], alone) @ (evidence.gradient + information @ off)
        found[name] = (
            (solution.values - step)[part],
            covariance_of([evidence], alone)[part, part],
        )
    return found


def moved(rows: tuple[Fitted, ...], gathered: Gathered) -> tuple[str, ...]:
    """Which values moved by more than the single fits' sigmas allow."""
    words = []
    for row in rows:
        if row.key and row.before is not None:
            sigma = math.sqrt(gathered.chain.covariance(gathered.config, (row.key,))[0, 0])
            off = abs(row.value - row.before)
            if sigma and off > _MOVED * sigma:
                words.append(f"{row.name} by {off / sigma:.1f}")
    if not words:
        return ()
    return (
        f"moved by more than {_MOVED:.0f} sigmas of its own fit: {', '.join(words)}; by itself a "
        "fit takes turrets for where their bodies' pivots are",
    )
