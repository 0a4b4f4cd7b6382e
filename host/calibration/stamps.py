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
# Rounded stamps: finer steps do no harm, and coarser ones are frames; how far intervals of one
# number of steps scatter, of a step; and the shares of two such numbers, and of the rarer one.
_STEPS_S, _SCATTER = (0.002, 0.05), 0.1
_TWO, _RARER, _LEAST_RARER = 0.8, 0.02, 30
_EVEN, _ALL = 0.9, 0.98  # of the distances between the rarer ones


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


def rounding_step(times: FloatArray) -> float:
    """The step (s) to which stamps (n,), in order, were rounded; 0: none, or a fine one.

    Frames at a constant rate then lie a whole number of steps apart, or one step more, and the
    rarer of both numbers comes evenly. Lost frames come at random; or every one of a number, which
    is not told from steps of one frame.
    """
    intervals = np.diff(times)
    if len(intervals) < 2 * _LEAST_RARER:
        return 0.0
    ordered = np.sort(intervals)
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > 0.5 * _STEPS_S[0]) + 1)
    two = sorted(sorted(groups, key=len)[-2:], key=lambda group: float(np.mean(group)))
    if len(two) < 2 or min(map(len, two)) < max(_LEAST_RARER, _RARER * len(intervals)):
        return 0.0
    short, long = (float(np.median(group)) for group in two)
    step = long - short
    number = round(short / step)
    if (
        not _STEPS_S[0] <= step <= _STEPS_S[1]
        or len(two[0]) + len(two[1]) < _TWO * len(intervals)
        or number < 0
        or abs(short - number * step) > _SCATTER * step
        or max(float(np.std(group)) for group in two) > _SCATTER * step
    ):
        return 0.0
    rarer = short if len(two[0]) < _EVEN * len(two[1]) else long
    apart = np.diff(np.flatnonzero(np.abs(intervals - rarer) < 2.0 * _SCATTER * step))
    usual = np.bincount(apart, minlength=3)
    usual[1] = 0  # side by side: another rate for a while
    both = usual[:-1] + usual[1:]
    every_nth = number == 1 and usual.max() > _ALL * len(apart) and rarer == long
    return step if both.max() > _EVEN * len(apart) and not every_nth else 0.0


def rounding_warnings(tracks: Sequence[FloatArray]) -> list[str]:
    """What is to be known of stamps of motion capture, arrays (n,) s, that were rounded."""
    step = max((rounding_step(times) for times in tracks), default=0.0)
    return [
        f"motion capture's stamps come in steps of {1e3 * step:.3g} ms, as if rounded: each may be "
        "off by as much, and delays by half of it; stream or export stamps to 1 ms or finer"
    ] * (step > 0.0)


def stamps_check(tracks: Sequence[FloatArray]) -> Check:
    """The check that stamps of motion capture, arrays (n,) s, are not late at random."""
    late = max((lateness(times) for times in tracks), default=0.0)
    usual = max((float(np.median(np.diff(t))) for t in tracks if len(t) > 1), default=0.0)
    rounded = rounding_warnings(tracks)
    return at_most(
        "lateness of motion capture's stamps, by their jitter",
        late,
        max(_LATEST_SHARES[0] * usual, min(_LATEST_S, _LATEST_SHARES[1] * usual)),
        "ms",
    ).otherwise(rounded[0] if rounded else _late_words(late))


def _late_words(late: float) -> str:
    return (
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
