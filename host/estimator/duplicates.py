"""Two hypotheses of one thing: which of them goes."""

import numpy as np
from scipy.spatial import cKDTree

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
    pairs = cKDTree(positions.T).query_pairs(float(reach.max(initial=0.0)), output_type="ndarray")
    i, j = pairs.T
    near = np.hypot(*(positions[:, i] - positions[:, j])) < 0.5 * (reach[i] + reach[j])
    i, j = i[near], j[near]
    first = (seen[i] < seen[j]) | ((seen[i] == seen[j]) & (weights[i] < weights[j]))
    gone = np.where(first, i, j)
    kept = i + j - gone
    stays = ~np.isin(kept, gone)  # who duplicates one that goes itself is looked at again next time
    gone, index = np.unique(gone[stays], return_index=True)
    return gone, kept[stays][index]
