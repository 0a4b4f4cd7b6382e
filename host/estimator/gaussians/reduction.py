"""How the PHD filter's mixture stays small after an update: merge, prune, cap, pass on labels.

Vo and Ma 2006, table II, with one difference: which components may merge is known from the
association (one group a reading), so that no search is needed and all steps are linear.
"""

import numpy as np

from host.config import FilterSettings
from host.estimator.gaussians.gaussian_mixture import PXX, PYY, ROWS, WEIGHT, X, Y, match_moments
from host.estimator.things.kinds import (
    CONFIRMED,
    LABEL,
    MIXTURE,
    PARENT,
    TEAMMATE,
    existence,
    rows_of,
)
from host.messages import FloatArray, IntArray

_WEIGHTLESS = 1e-12  # keeps the moments of a ruled-out kind finite
_OF_ITS_OWN = 0.1  # a reading that took less of a component than this is hardly its reading


def groups_by_reading(
    i: IntArray, j: IntArray, mass: FloatArray, left: FloatArray, readings: int
) -> IntArray:
    """The group of each missed, updated and born component (n + p + readings,), in that order.

    One group a reading. What was missed joins the group of its likeliest reading, unless that
    reading is hardly its own; then it stays by itself.

    i, j (p,): component and reading of each pair. mass (p,): the pairs' weights. left (n,): the
    weights of what was missed.
    """
    group = np.arange(readings, readings + len(left))
    order = mass.argsort()  # the likeliest is written last
    order = order[mass.take(order) > _OF_ITS_OWN * left.take(i.take(order))]
    group[i.take(order)] = j.take(order)
    return np.concatenate((group, j, np.arange(readings)))


def merge(state: FloatArray, group: IntArray, settings: FilterSettings) -> FloatArray:
    """Merge each group of a state (STATE, N) into its heaviest, prune and cap: (STATE, k).

    group (N,): whole numbers below N. Overwrites `state`.
    """
    rows = rows_of(state)
    rows[WEIGHT] += _WEIGHTLESS
    leader = _leaders(rows, group, settings.merge_distance)
    place = np.arange(len(group))
    kept = (leader == place).nonzero()[0]
    place[kept] = np.arange(len(kept))
    merged = state.take(kept, axis=1)
    centres = rows_of(merged)[: Y + 1]
    merged[MIXTURE] = match_moments(rows, place.take(leader), centres).reshape(2 * ROWS, -1)
    total = existence(rows_of(merged))
    rows_of(merged)[WEIGHT] /= np.maximum(total, 1.0)  # what is merged is one thing
    kept = _heaviest(total, settings.prune_weight, settings.capacity)
    return np.asarray(merged.take(kept, axis=1))


def _leaders(rows: FloatArray, group: IntArray, merge_distance: float) -> IntArray:
    """The component (N,) that each merges into: the heaviest of its group, or itself if far off.

    Far off: the squared distance is more than merge_distance times the variance of the difference,
    tr(P1 + P2) / 2; of round covariances that is the squared Mahalanobis distance.
    """
    order = existence(rows).argsort()
    leader = np.empty(len(group), dtype=np.int64)
    leader[group.take(order)] = order  # the heaviest is written last
    leader = leader.take(group)
    x, y = rows[X, TEAMMATE], rows[Y, TEAMMATE]
    dx, dy = x - x.take(leader), y - y.take(leader)
    spread = rows[PXX, TEAMMATE] + rows[PYY, TEAMMATE]
    spread += spread.take(leader)
    far = (dx * dx + dy * dy > 0.5 * merge_distance * spread).nonzero()[0]
    leader[far] = far
    return leader


def _heaviest(weights: FloatArray, prune_weight: float, capacity: int) -> IntArray:
    """Indices of the weights (n,) above prune_weight, at most `capacity` of them."""
    keep = (weights > prune_weight).nonzero()[0]
    if len(keep) > capacity:
        keep = np.argsort(-weights, kind="stable")[:capacity]
    return keep


def pass_on_labels(state: FloatArray, parents: int) -> None:
    """Leave each parent's label and report to its heaviest heir alone, in place.

    state (STATE, n); its PARENT is below `parents`, or equal to it for the newborn.
    """
    parent = state[PARENT].astype(np.int64)
    order = existence(rows_of(state)).argsort()
    heir = np.empty(parents + 1, dtype=np.int64)
    heir[parent.take(order)] = order  # the heaviest is written last
    heir[parents] = -1
    own = heir.take(parent) == np.arange(len(parent))
    state[CONFIRMED] *= own
    state[LABEL] *= own
