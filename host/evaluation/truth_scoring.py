"""How estimates are scored where truth is known at every time: scenarios and mocap recordings."""

from collections.abc import Iterable

import numpy as np

from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.messages import Estimate

WARM_UP_S = 5.0  # for the first teammates to be found


def score(
    estimates: Iterable[Estimate],
    track: TruthTrack,
    scored: Accumulator,
    range_m: float,
    band_m: float = 0.5,
    warm_up_s: float = WARM_UP_S,
) -> None:
    """Add every estimate that has truth to `scored`, in time order.

    Teammates within range_m are to be reported. In the band_m beyond it a report is neither
    wanted nor false. The first warm_up_s after the first estimate are left out.
    """
    begin = None
    for estimate in estimates:
        begin = estimate.time if begin is None else begin
        truth = track.at(estimate.time)
        if truth is None or estimate.time - begin < warm_up_s:
            continue
        distances = np.linalg.norm(truth.positions, axis=1)
        wanted = distances <= range_m
        border = ~wanted & (distances <= range_m + band_m)
        scored.add(truth.positions[wanted], truth.positions[border], estimate)
