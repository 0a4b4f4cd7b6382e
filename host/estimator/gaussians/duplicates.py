"""Two hypotheses of one thing: which of them goes."""

import numpy as np
from scipy.spatial import cKDTree

from host.messages import FloatArray, IntArray

_SIGMAS = 3.0  # readings of one thing are seldom further apart
_FEW = 64  # up to here a full distance table is faster than a KD-tree


def duplicates(
    positions: FloatArray, variances: FloatArray, seen: FloatArray, weights: FloatArray
) -> tuple[IntArray, IntArray]:
    """Indices (d,), (d,) of the things that are duplicates, and of those that they duplicate.

    positions (2, n) m; variances (n,) m²: of the reading that last placed each, per axis; seen
    (n,) s: when that was; weights (n,). Two things nearer to each other than their readings scatter
    cannot be told apart, so that the one seen later, or else the heavier, stands for both.
    """
    reach = _SIGMAS * np.sqrt(2.0 * variances)
    i, j = _pairs_within(positions, float(reach.max(initial=0.0)))
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


def _pairs_within(positions: FloatArray, reach: float) -> tuple[IntArray, IntArray]:
    """Indices i < j (p,), (p,) of the positions (2, n) nearer to each other than `reach` m."""
    n = positions.shape[1]
    if n > _FEW:
        pairs = cKDTree(positions.T).query_pairs(reach, output_type="ndarray").T
        return pairs[0], pairs[1]
    dx, dy = positions[:, :, None] - positions[:, None]
    near = (dx * dx + dy * dy < reach * reach).ravel().nonzero()[0]
    i = near // max(n, 1)
    j = near - n * i
    above = (i < j).nonzero()[0]
    return i.take(above), j.take(above)
