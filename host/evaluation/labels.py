"""Who was measured, told from truth: what the clairvoyant filter needs where no dataset tells."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from host.geometry import wrap
from host.messages import Bearings, FloatArray, IntArray, Positions, Truth

POSITION_GATE_M = 0.25
BEARING_GATE_SIGMA = 4.0

AnyReading = TypeVar("AnyReading", Positions, Bearings)


def label(measurement: AnyReading, truth: Truth) -> AnyReading:
    """The measurement with identities filled in: each reading's robot, -1 where it is nobody's.

    truth: the other robots in the same frame at the measurement's time. Readings and robots are
    paired one to one at the least total cost, within 0.25 m or 4 standard deviations of bearing.
    """
    if isinstance(measurement, Positions):
        distances = np.linalg.norm(measurement.positions[:, None] - truth.positions[None], axis=2)
        return replace(measurement, identities=_assign(distances / POSITION_GATE_M, truth))
    directions = np.arctan2(truth.positions[:, 1], truth.positions[:, 0])
    errors = np.abs(wrap(measurement.bearings[:, None] - directions[None]))
    gate = BEARING_GATE_SIGMA * np.sqrt(measurement.variances)
    return replace(measurement, identities=_assign(errors / gate[:, None], truth))


def _assign(cost: FloatArray, truth: Truth) -> IntArray:
    """Identities (n,) for cost (n, m) in units of the gate; a cost of 1 and more is no pair."""
    identities = np.full(len(cost), -1, dtype=np.int64)
    i, j = linear_sum_assignment(np.minimum(cost, 1.0) ** 2)
    under = cost[i, j] < 1.0
    identities[i[under]] = truth.identities[j[under]]
    return identities


def between(before: Truth, after: Truth, time: float) -> Truth:
    """Truth at `time`, interpolated for the robots that both neighbours in time know.

    Straight lines in the observer's frame: keep the neighbours close while the observer turns.
    """
    span = after.time - before.time
    share = min(max((time - before.time) / span, 0.0), 1.0) if span > 0.0 else 0.0
    identities, i, j = np.intersect1d(before.identities, after.identities, return_indices=True)
    positions = (1.0 - share) * before.positions[i] + share * after.positions[j]
    return Truth(time=time, identities=identities, positions=positions)
