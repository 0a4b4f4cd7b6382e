"""Which reading is whose: marginal probabilities by loopy belief propagation.

Williams and Lau, "Approximate evaluation of marginal association probabilities with belief
propagation", IEEE Trans. Aerospace and Electronic Systems 50(4), 2014. Exact where the pairs form
a tree, close elsewhere; linear in the number of pairs.
"""

from dataclasses import dataclass

import numpy as np

from host.messages import FloatArray, IntArray

_CLOSE_ENOUGH = 1e-3  # change of a message, at which the iteration ends
_MOST_ITERATIONS = 50


@dataclass(frozen=True, slots=True)
class Association:
    """Marginal probabilities of who caused what.

    pairs (p,): that the pair's target caused its reading. missed (n,): that a target caused none.
    unclaimed (m,): that no target caused a reading. messages (p,): nu of eq. 31, how free the
    reading is of other targets.
    """

    pairs: FloatArray
    missed: FloatArray
    unclaimed: FloatArray
    messages: FloatArray


def associate(
    i: IntArray, j: IntArray, ratios: FloatArray, targets: int, readings: int
) -> Association:
    """Marginals of the pairs (p,) of target i and reading j, each target and reading in one pair.

    ratios (p,): psi(i, j), the likelihood that i caused j over that i was missed and j is clutter
    or new. (Williams & Lau 2014, eq. 30-31, 33; psi there.)
    """
    claims, free = ratios, np.ones(len(i))
    for _ in range(_MOST_ITERATIONS):
        others = 1.0 + (np.bincount(i, claims, targets).take(i) - claims)
        toward = ratios / np.maximum(others, 1.0)
        claimed = 1.0 + np.bincount(j, toward, readings)
        before, free = free, 1.0 / np.maximum(claimed.take(j) - toward, 1.0)
        claims = ratios * free
        if not (np.abs(free - before) > _CLOSE_ENOUGH).any():
            break
    missed = np.asarray(1.0 / (1.0 + np.bincount(i, claims, targets)), dtype=np.float64)
    unclaimed = np.asarray(1.0 / claimed, dtype=np.float64)
    return Association(claims * missed.take(i), missed, unclaimed, free)


def share_out(
    i: IntArray, j: IntArray, ratios: FloatArray, targets: int, readings: int
) -> Association:
    """As `associate`, by the weights of a PHD filter: each reading is shared out by itself.

    A target takes r / (1 + sum of r) of it, with r (p,) its expected readings there over those of
    clutter and births (Vo & Ma 2006, prop. 2), but no more than one reading altogether, and what
    it takes was not missed as well.
    """
    claimed = 1.0 + np.bincount(j, ratios, readings)
    pairs = ratios / claimed.take(j)
    pairs /= np.maximum(np.bincount(i, pairs, targets), 1.0).take(i)
    missed = np.asarray(np.maximum(1.0 - np.bincount(i, pairs, targets), 0.0), dtype=np.float64)
    return Association(pairs, missed, np.asarray(1.0 / claimed), 1.0 / (claimed.take(j) - ratios))
