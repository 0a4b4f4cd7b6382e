"""Which pairs are made, against all of them judged one by one."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from host.estimator.gaussians.gaussian_mixture import WEIGHT, X, Y
from host.estimator.gaussians.moving_gaussians import PLACE, PXX, PXY, PYY, ROWS
from host.estimator.things.pairing import pair_bearings
from host.messages import Bearings

GATE = 9.0


@given(st.integers(0, 2**32 - 1))
def test_bearings_are_paired_with_every_target_within_the_gate_and_no_other(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows = np.zeros((ROWS, 1, 12))
    rows[: Y + 1, 0] = random.uniform(-3.0, 3.0, (2, 12))
    factors = random.uniform(-0.3, 0.3, (12, 2, 2))
    covariances = factors @ factors.swapaxes(1, 2) + 1e-4 * np.eye(2)
    rows[[PXX, PXY, PYY], 0] = covariances.reshape(-1, 4).T[[0, 1, 3]]
    whole = np.ones((WEIGHT + 1, 12))
    whole[:WEIGHT] = rows[PLACE, 0]
    origin = (0.2, -0.1)
    measured = Bearings(0.0, random.uniform(-4.0, 4.0, 6), random.uniform(1e-3, 1e-2, 6), origin)
    pairs = pair_bearings(rows, whole, measured, np.ones(12), GATE, None)
    expected = []
    for i in range(12):
        x, y = whole[[X, Y], i] - origin
        across = np.array([-y, x]) / (x * x + y * y)
        for j in range(6):
            off = math.remainder(measured.bearings[j] - math.atan2(y, x), math.tau)
            if off**2 < GATE * (across @ covariances[i] @ across + measured.variances[j]):
                expected.append((i, j))
    assert sorted(zip(pairs.target.tolist(), pairs.reading.tolist(), strict=True)) == expected
