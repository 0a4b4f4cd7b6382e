"""Which teammate each reading measured, from truth: the input of the clairvoyant filter."""

import bisect
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from host.geometry import wrap
from host.messages import (
    Bearings,
    FloatArray,
    IntArray,
    Positions,
    Truth,
)

POSITION_GATE_M = 0.25
BEARING_GATE_SIGMA = 4.0


def label(measurement: Positions | Bearings, truth: Truth) -> Positions | Bearings:
    """The measurement with identities: the robot of each reading, -1 for none.

    truth: the other robots in the same frame at the measurement's time. Readings and robots are
    paired one to one at the least total cost, within 0.25 m or 4 standard deviations of bearing.
    """
    if isinstance(measurement, Positions):
        distances = np.linalg.norm(measurement.positions[:, None] - truth.positions[None], axis=2)
        return replace(measurement, identities=_assign(distances / POSITION_GATE_M, truth))
    from_origin = truth.positions - np.array(measurement.origin)
    directions = np.arctan2(from_origin[:, 1], from_origin[:, 0])
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


class TruthTrack:
    """Truth over time: samples in time order, interpolated in between.

    Straight lines in the observer's frame, so samples must be close while the observer rotates.
    """

    def __init__(self, samples: Sequence[Truth]) -> None:
        self._samples = samples
        self._times = [sample.time for sample in samples]

    def at(self, time: float) -> Truth | None:
        """Truth at `time` (s), of the robots both neighbours know; None outside the samples."""
        after = bisect.bisect_left(self._times, time)
        if after == len(self._times):
            return None
        later = self._samples[after]
        if later.time == time:
            return later
        if after == 0:
            return None
        earlier = self._samples[after - 1]
        share = (time - earlier.time) / (later.time - earlier.time)
        who, i, j = np.intersect1d(earlier.identities, later.identities, return_indices=True)
        positions = (1.0 - share) * earlier.positions[i] + share * later.positions[j]
        return Truth(time=time, identities=who, positions=positions)


def label_by_track(measurement: Positions | Bearings, track: TruthTrack) -> Positions | Bearings:
    """The measurement labelled from truth at its time; without truth every label is -1.

    Identities that a simulated camera or a dataset knows are kept.
    """
    if measurement.identities is not None:
        return measurement
    truth = track.at(measurement.time)
    if truth is None:
        truth = Truth(measurement.time, np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    return label(measurement, truth)
