"""Where something is, from one set of distances (Lee 2012, section II)."""

import numpy as np

from host.messages import FloatArray

_ROUNDS = 20
_LEAST_STEP_M = 1e-6
_ON_A_LINE = 1e-3  # of the places' spread along their longest direction


def bounding_box(places: FloatArray, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner (2,) m of the box in which something lies (eq. 2).

    places (n, 2) m: of the robots that measured. The paper takes the maximum for both corners; of
    the upper one it is the minimum. Where noise leaves no box, its corners are exchanged.
    """
    low = (places - ranges[:, None]).max(axis=0)
    high = (places + ranges[:, None]).min(axis=0)
    return np.minimum(low, high), np.maximum(low, high)


def trilaterate(places: FloatArray, ranges: FloatArray) -> FloatArray | None:
    """The position (2,) m of least squared error of ranges (n,); None where two fit alike.

    Eq. 1, as Gauss-Newton steps from the middle of the bounding box. With fewer than three robots,
    or all on a line, the mirror image fits as well.
    """
    if len(places) < 3:
        return None
    spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    if spread[1] < _ON_A_LINE * spread[0]:
        return None
    low, high = bounding_box(places, ranges)
    position = (low + high) / 2.0
    for _ in range(_ROUNDS):
        arms = position - places
        distances = np.maximum(np.hypot(arms[:, 0], arms[:, 1]), _LEAST_STEP_M)
        step = np.linalg.lstsq(arms / distances[:, None], ranges - distances, rcond=None)[0]
        position = position + step
        if np.hypot(*step) < _LEAST_STEP_M:
            break
    return np.asarray(position)
