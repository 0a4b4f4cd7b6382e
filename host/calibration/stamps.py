"""Whether stamps can be those of the measurements: not late at random, none before its time."""

import math
from collections.abc import Sequence

import numpy as np

from host.calibration.result import Check, at_least, at_most
from host.messages import FloatArray

_LONGEST = 5.0  # usual intervals that one counts as at most: what is lost says nothing
_LATEST_S, _LATEST_SHARE = 0.005, 0.3  # the latter of an interval: slow cameras are no clocks
_SIGMAS, _TOLERANCE_S = 3.0, 0.002


def lateness(times: FloatArray) -> float:
    """By how much (s) stamps (n,) are late on average if they are exponentially late; 0: regular.

    Of two exponential latenesses with the mean m the difference is Laplace's distribution: its mean
    below zero, over all, is m / 2. Intervals that are shorter than the usual one show that;
    frames that are lost make longer ones only.
    """
    intervals = np.diff(times)
    if len(intervals) < 2:
        return 0.0
    usual = float(np.mean(np.minimum(intervals, _LONGEST * np.mean(intervals))))
    return 2.0 * float(np.mean(np.maximum(usual - intervals, 0.0)))


def stamps_check(tracks: Sequence[FloatArray]) -> Check:
    """The check that stamps of motion capture, arrays (n,) s, are not late at random."""
    late = max((lateness(times) for times in tracks), default=0.0)
    usual = max((float(np.median(np.diff(t))) for t in tracks if len(t) > 1), default=0.0)
    return at_most(
        "lateness of motion capture's stamps, by their jitter",
        late,
        max(_LATEST_S, _LATEST_SHARE * usual),
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
