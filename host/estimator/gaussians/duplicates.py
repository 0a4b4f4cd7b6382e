"""Two hypotheses of one thing: which of them goes."""

import numpy as np

from host.estimator.gaussians.near_pairs import near_pairs
from host.messages import FloatArray, IntArray

_SIGMAS = 3.0  # readings of one thing are seldom further apart


def duplicates(
    positions: FloatArray, variances: FloatArray, seen: FloatArray, weights: FloatArray
) -> tuple[IntArray, IntArray]:
    """Indices (d,), (d,) of the things that are duplicates, and of those that they duplicate.

    positions (2, n) m; variances (n,) m²: of the reading that last placed each, per axis; seen
    (n,) s: when that was; weights (n,). Two things nearer to each other than their readings scatter
    cannot be told apart, so that the one seen later, or else the heavier, stands for both.
    """
    reach = _SIGMAS * np.sqrt(2.0 * variances)
    i, j = near_pairs(positions, np.full(len(reach), reach.max(initial=0.0) ** 2), positions)
    if len(i) == len(reach):
        return i[:0], i[:0]  # each is near itself alone
    once = (i < j).nonzero()[0]
    i, j = i.take(once), j.take(once)
    dx, dy = positions.take(i, axis=1) - positions.take(j, axis=1)
    near = (dx * dx + dy * dy < (0.5 * (reach.take(i) + reach.take(j))) ** 2).nonzero()[0]
    i, j = i.take(near), j.take(near)
    if not len(i):
        return i, j
    first = (seen[i] < seen[j]) | ((seen[i] == seen[j]) & (weights[i] < weights[j]))
    gone = np.where(first, i, j)
    kept = i + j - gone
    goes = np.zeros(positions.shape[1], dtype=bool)
    goes[gone] = True
    stays = ~goes.take(kept)  # who duplicates one that goes itself is looked at again next time
    stands_for = np.full(len(goes), -1)
    stands_for[gone[stays][::-1]] = kept[stays][::-1]  # the first of several stays
    gone = (stands_for >= 0).nonzero()[0]
    return gone, stands_for.take(gone)
