"""Which points of the plane are near which others."""

import numpy as np

from host.messages import FloatArray, IntArray

_DENSE_PAIRS = 4096  # up to here a full distance table is faster than sorting


def near_pairs(
    points: FloatArray, squares: FloatArray, others: FloatArray
) -> tuple[IntArray, IntArray]:
    """Indices (p,), (p,) of points (2, n) and others (2, m) near to each other, in order of points.

    squares (n,) m²: of the distance that is near to each point. Many are sorted along x: within
    that distance of a point there is only a strip of the others.
    """
    n, m = points.shape[1], others.shape[1]
    if n * m <= _DENSE_PAIRS:
        dx, dy = points[:, :, None] - others[:, None]
        flat = (dx * dx + dy * dy < squares[:, None]).ravel().nonzero()[0]
        i = flat // max(m, 1)
        return i, flat - i * m
    order = others[0].argsort(kind="stable")
    x, reach = others[0].take(order), np.sqrt(squares)
    first = x.searchsorted(points[0] - reach)
    count = x.searchsorted(points[0] + reach, side="right") - first
    i = np.arange(n).repeat(count)
    before = count.cumsum() - count  # pairs of the points before each
    j = order.take(np.arange(len(i)) + (first - before).take(i))
    dx, dy = points.take(i, axis=1) - others.take(j, axis=1)
    near = (dx * dx + dy * dy < squares.take(i)).nonzero()[0]
    return i.take(near), j.take(near)
