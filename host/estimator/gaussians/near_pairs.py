"""Which points of the plane are near which others."""

import numpy as np

from host.messages import FloatArray, IntArray

_DENSE_PAIRS = 4096  # up to here a full distance table is faster than sorting
_LEAST_HEIGHT_M = 0.1


def near_pairs(
    points: FloatArray, squares: FloatArray, others: FloatArray
) -> tuple[IntArray, IntArray]:
    """Indices (p,), (p,) of points (2, n) and others (2, m) near to each other, in order of points.

    squares (n,) m²: of the distance that is near to each point.
    """
    n, m = points.shape[1], others.shape[1]
    if n * m > _DENSE_PAIRS:
        return _by_strips(points, squares, others)
    dx, dy = points[:, :, None] - others[:, None]
    flat = (dx * dx + dy * dy < squares[:, None]).ravel().nonzero()[0]
    i = flat // max(m, 1)
    return i, flat - i * m


def _by_strips(
    points: FloatArray, squares: FloatArray, others: FloatArray
) -> tuple[IntArray, IntArray]:
    """As `near_pairs`, of many: the others are cut into strips along x, each sorted by x.

    A strip is as high as any point reaches up and down, so that what is near is in two at most.
    The strips are laid end to end on one axis, too far apart for a point to reach into the next.
    """
    reach = np.sqrt(squares)
    height = max(2.0 * float(reach.max()), _LEAST_HEIGHT_M)
    corner, size = others.min(axis=1)[:, None], np.ptp(others[0])
    (x, y), (others_x, others_y) = points - corner, others - corner
    length = size + 2.0 * height
    places = np.floor(others_y / height) * length + others_x
    order = places.argsort()
    places = places.take(order)
    strips = np.floor(np.stack((y - reach, y + reach), axis=1) / height)
    middle = strips * length + x.clip(-0.5 * height, size + 0.5 * height)[:, None]
    first = places.searchsorted(middle - reach[:, None])
    count = places.searchsorted(middle + reach[:, None], side="right") - first
    count[strips[:, 0] == strips[:, 1], 1] = 0
    first, count = first.ravel(), count.ravel()
    strip = np.arange(len(count)).repeat(count)
    within = np.arange(len(strip)) - (count.cumsum() - count).take(strip)
    i, j = strip // 2, order.take(first.take(strip) + within)
    dx, dy = points.take(i, axis=1) - others.take(j, axis=1)
    near = (dx * dx + dy * dy < squares.take(i)).nonzero()[0]
    return i.take(near), j.take(near)
