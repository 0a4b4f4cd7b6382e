"""Errors over time, distance and angle: what papers on this problem draw, from scored instants.

Perera 2021 (figures 7, 8, 23, 24) measures each robot's distance from the nearest estimate.
Belaroussi 2024 (section 6.2) pairs estimates with robots by the Hungarian algorithm without a
cut-off, so that a false estimate in the place of a missed robot is a great error. Robots out of
range are paired, too, or an estimate of one would count as an error of another; but only those
that are to be reported are counted.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from host.evaluation.metrics import OVER_M, Instant, nearest, percentile
from host.geometry import wrap
from host.messages import FloatArray, IntArray

CUMULATIVE_BINS = 100  # Belaroussi 2024, section 6.2.1
DISTANCE_BIN_M = 0.1  # the same
ANGLE_BIN_RAD = math.radians(15.0)  # his is not given


class NearestErrors(NamedTuple):
    """times (t,) s, robots (m,), and errors (t, m) m of each robot's nearest estimate.

    An error is nan while the robot is not to be reported, inf where nothing is reported at all.
    """

    times: FloatArray
    robots: IntArray
    errors: FloatArray


class PairErrors(NamedTuple):
    """Of each pair (n,): its error (m), and the robot's true distance (m) and bearing (rad)."""

    errors: FloatArray
    distances: FloatArray
    bearings: FloatArray

    @property
    def rmse_m(self) -> float:
        """Root mean square error, m; nan without a pair."""
        return math.sqrt(float(np.mean(self.errors**2))) if len(self.errors) else math.nan

    @property
    def p67_m(self) -> float:
        """67th percentile of the errors, m (Belaroussi 2024, section 6.2.1); nan without a pair."""
        return percentile(self.errors, 67.0)


class Bins(NamedTuple):
    """The middle of each bin (k,) that is not empty, how many errors are in it and their RMS, m."""

    middles: FloatArray
    counts: IntArray
    rms_m: FloatArray


def nearest_errors(instants: Sequence[Instant]) -> NearestErrors:
    """How far each robot's nearest estimate is (Perera 2021, figure 23)."""
    robots = np.unique(np.concatenate([_NOBODY, *(at.truth.identities for at in instants)]))
    errors = np.full((len(instants), len(robots)), math.nan)
    for k, at in enumerate(instants):
        wanted = at.truth.identities[at.wanted]
        found = nearest(at.truth.positions[at.wanted], at.estimate.positions)
        errors[k, np.searchsorted(robots, wanted)] = found
    return NearestErrors(times_of(instants), robots, errors)


def time_over(errors: FloatArray, bound_m: float = OVER_M) -> FloatArray:
    """Share (m,) of the time in range for which each robot's error (t, m) is above the bound.

    Perera 2021, figures 7 and 24; nan for a robot that is never in range.
    """
    in_range = np.sum(~np.isnan(errors), axis=0)
    over = np.sum(errors > bound_m, axis=0)
    return np.where(in_range, over / np.maximum(in_range, 1), math.nan)


def weight_sums(instants: Sequence[Instant]) -> tuple[FloatArray, FloatArray]:
    """Sum of the weights that are reported (t,), and how many robots are to be reported (t,).

    Perera 2021, figures 8 and 24.
    """
    weights = np.array([np.sum(at.estimate.weights) for at in instants], dtype=float)
    return weights, np.array([np.sum(at.wanted) for at in instants], dtype=float)


def gospa_over_time(instants: Sequence[Instant], bin_s: float) -> tuple[FloatArray, FloatArray]:
    """Middles (k,) s of bins of time, and mean GOSPA (k,) m in each; bins start at a multiple."""
    if not instants:
        return np.zeros(0), np.zeros(0)
    which = np.floor(times_of(instants) / bin_s).astype(np.int64)
    bins, place = np.unique(which, return_inverse=True)
    sums = np.bincount(place, [at.gospa.distance for at in instants])
    middles = np.asarray(bin_s * (bins + 0.5), dtype=np.float64)
    return middles, np.asarray(sums / np.bincount(place))


def pair_errors(instants: Sequence[Instant]) -> PairErrors:
    """Errors of all pairs at the least total distance (Belaroussi 2024, section 6.2.2)."""
    found = [PairErrors(np.zeros(0), np.zeros(0), np.zeros(0))]
    for at in instants:
        offsets = at.truth.positions[:, None] - at.estimate.positions[None]
        distances = np.hypot(offsets[..., 0], offsets[..., 1])
        i, j = linear_sum_assignment(distances)
        i, j = i[at.wanted[i]], j[at.wanted[i]]
        x, y = at.truth.positions[i].T
        found.append(PairErrors(distances[i, j], np.hypot(x, y), np.arctan2(y, x)))
    return PairErrors(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def cumulative(errors: FloatArray, bins: int = CUMULATIVE_BINS) -> tuple[FloatArray, FloatArray]:
    """Upper edges (bins,) m of equal bins up to the greatest error, and the share at most there."""
    if not len(errors):
        return np.zeros(0), np.zeros(0)
    counts, edges = np.histogram(errors, bins, (0.0, max(float(np.max(errors)), 1e-9)))
    return edges[1:], np.cumsum(counts) / len(errors)


def rms_in_bins(where: FloatArray, errors: FloatArray, width: float) -> Bins:
    """RMS of errors (n,) by `where` (n,) they were made, in bins that start at multiples of width.

    For an error over distance or over angle (Belaroussi 2024, section 6.2.1).
    """
    which = np.floor(where / width + 1e-9).astype(np.int64)
    bins, place = np.unique(which, return_inverse=True)
    counts = np.bincount(place, minlength=len(bins))
    squares = np.bincount(place, errors**2, minlength=len(bins))
    rms = np.sqrt(squares / np.maximum(counts, 1))
    return Bins(np.asarray(width * (bins + 0.5), dtype=np.float64), counts, rms)


def over_angle(found: PairErrors) -> Bins:
    """RMS of the errors by bearing, in bins around multiples of 15 degrees: one is ahead."""
    shifted = wrap(found.bearings + 0.5 * ANGLE_BIN_RAD)
    bins = rms_in_bins(shifted, found.errors, ANGLE_BIN_RAD)
    return bins._replace(middles=bins.middles - 0.5 * ANGLE_BIN_RAD)


_NOBODY = np.zeros(0, dtype=np.int64)


def times_of(instants: Sequence[Instant]) -> FloatArray:
    """When each was scored, (t,) s."""
    return np.array([at.estimate.time for at in instants], dtype=float)
