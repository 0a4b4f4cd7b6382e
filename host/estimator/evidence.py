"""How much of a reading's evidence is new: successive readings show nearly the same scene."""

import math
from typing import overload

import numpy as np

from host.messages import FloatArray, Positions

_PLAIN_SCORE = 3.0  # from here on a reading counts as a turret


@overload
def new_share(elapsed: float, correlation_s: float) -> float: ...
@overload
def new_share(elapsed: FloatArray, correlation_s: float) -> FloatArray: ...
def new_share(elapsed: FloatArray | float, correlation_s: float) -> FloatArray | float:
    """Share (n,) of independent evidence in a reading made `elapsed` s after the one before.

    1 - exp(-elapsed / correlation_s): evidence counts by time, however often a sensor reads.
    """
    if isinstance(elapsed, float):
        return -math.expm1(-max(elapsed, 0.0) / correlation_s)
    return np.asarray(-np.expm1(-np.maximum(elapsed, 0.0) / correlation_s))


def likeness(measured: Positions) -> FloatArray:
    """How much each reading (m,) counts as a turret: min(1, likelihood ratio / 20).

    1 where the sensor gives no score. In a furnished room background of a turret's size is some
    twenty times as frequent as turrets, and it is there again in each revolution.
    """
    if measured.scores is None:
        return np.ones(len(measured.positions))
    return np.asarray(np.exp(np.minimum(measured.scores - _PLAIN_SCORE, 0.0)))
