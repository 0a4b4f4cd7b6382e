"""Whether stamps can be those of the measurements: not late at random, none before its time."""

import math
from collections.abc import Sequence

import numpy as np

from host.calibration.result import Check, at_least, at_most
from host.messages import FloatArray

_LONGEST = 5.0  # usual intervals that one counts as at most: what is lost says nothing
_LATEST_S = 0.005
_LATEST_SHARES = (0.3, 0.5)  # of an interval: slow cameras are no clocks; fast ones come in order
_SHORT, _COMB = 0.2, 0.12  # quantile of intervals without a lost frame; rms off their multiples
_LEAST_KEPT = 0.3  # of the frames
_SIGMAS, _TOLERANCE_S = 3.0, 0.002


def lateness(times: FloatArray) -> float:
    """By how much (s) stamps (n,) are late on average if they are exponentially late; 0: regular.

    Of two exponential latenesses with the mean m the difference is Laplace's distribution: its mean
    below zero, over all, is m / 2. Intervals that are shorter than the usual one show that;
    frames that are lost make longer ones only, multiples of the usual one.
    """
    intervals = np.diff(times)
    if len(intervals) < 2:
        return 0.0
    usual = float(np.mean(np.minimum(intervals, _LONGEST * np.mean(intervals))))
    off = _off_multiples(intervals, usual)
    return 2.0 * float(np.mean(np.maximum(-(intervals - usual if off is None else off), 0.0)))


def _off_multiples(intervals: FloatArray, usual: float) -> FloatArray | None:
    """How far (s) intervals (n,) are off multiples of the shortest; None where they are none."""
    short = float(np.quantile(intervals, _SHORT))
    if not short > _LEAST_KEPT * usual:
        return None
    for _ in range(3):
        multiples = np.maximum(np.rint(intervals / short), 1.0)
        near = multiples <= _LONGEST
        short = float(np.median(intervals[near] / multiples[near]))
    off = np.where(near, intervals - short * multiples, 0.0)
    return off if math.sqrt(float(np.mean(off**2))) < _COMB * short else None


def stamps_check(tracks: Sequence[FloatArray]) -> Check:
    """The check that stamps of motion capture, arrays (n,) s, are not late at random."""
    late = max((lateness(times) for times in tracks), default=0.0)
    usual = max((float(np.median(np.diff(t))) for t in tracks if len(t) > 1), default=0.0)
    return at_most(
        "lateness of motion capture's stamps, by their jitter",
        late,
        max(_LATEST_SHARES[0] * usual, min(_LATEST_S, _LATEST_SHARES[1] * usual)),
        "ms",
    ).otherwise(
        f"frames come at irregular times, about {1e3 * late:.0f} ms late on average: the true path "
        "is stamped as it arrives, which every delay inherits; stream by cable, use a version that "
        "stamps the exposure (NatNet 3.0), or export the take and give it with --truth"
    )


def delay_check(name: str, delay: float, sigma: float) -> Check:
    """The check that a delay (s) is not negative, as far as that is known."""
    return at_least(
        f"{name}, upper limit",
        delay + _SIGMAS * (sigma if math.isfinite(sigma) else 0.0) + _TOLERANCE_S,
        0.0,
        "ms",
    ).otherwise(
        f"it comes out at {1e3 * delay:.1f} ms, but nothing is measured before it happens: stamps "
        "of motion capture are late (a ceiling camera has mocap.ceiling.delay_s for that); see its "
        "latency, and that one clock stamps both"
    )
