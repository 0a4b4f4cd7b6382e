"""How estimates are scored where truth is known at every time: scenarios and mocap recordings."""

import math
from collections.abc import Iterable

import numpy as np

from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import CUT_OFF_M, Accumulator, Instant, gospa_pairs
from host.messages import Estimate, FloatArray, Truth

RANGE_M = 2.0  # the sensing range of the thesis: who is nearer is to be reported
BAND_M = 0.5  # a report from this border beyond the range is never false
WARM_UP_S = 5.0  # for the first teammates to be found


def score_by_track(
    estimates: Iterable[Estimate],
    track: TruthTrack,
    scored: Accumulator,
    range_m: float = RANGE_M,
    band_m: float = BAND_M,
    warm_up_s: float = WARM_UP_S,
) -> None:
    """Add every estimate that has truth to `scored`, in time order.

    Teammates within range_m are to be reported; those beyond may be. What is estimated in the
    band_m beyond range_m is never false. The first warm_up_s after the first estimate are left
    out.
    """
    begin = None
    for estimate in estimates:
        begin = estimate.time if begin is None else begin
        truth = track.at(estimate.time)
        if truth is None or estimate.time - begin < warm_up_s:
            continue
        inside = np.linalg.norm(truth.positions, axis=1) <= range_m
        wanted, beyond = truth.positions[inside], truth.positions[~inside]
        border = _spare_in_border(wanted, estimate, scored, range_m, band_m)
        gospa = scored.add(wanted, np.concatenate((beyond, border)), estimate, truth.positions)
        scored.instants.append(Instant(truth, inside, estimate, gospa))


def errors_m(estimate: Estimate, truth: Truth) -> FloatArray:
    """Distance of each estimate (n,) to its matched teammate, m; nan for a false one."""
    i, j = gospa_pairs(truth.positions, estimate.positions, 2.0, CUT_OFF_M)
    errors = np.full(len(estimate.positions), math.nan)
    errors[j] = np.linalg.norm(truth.positions[i] - estimate.positions[j], axis=1)
    return errors


def _spare_in_border(
    wanted: FloatArray, estimate: Estimate, scored: Accumulator, range_m: float, band_m: float
) -> FloatArray:
    """Estimates (k, 2) in the border that no wanted teammate (m, 2) needs."""
    _, used = gospa_pairs(wanted, estimate.positions, scored.p, scored.c)
    spare = np.delete(estimate.positions, used, axis=0)
    distance = np.linalg.norm(spare, axis=1)
    return np.asarray(spare[(distance > range_m) & (distance <= range_m + band_m)])
