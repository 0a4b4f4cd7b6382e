"""Which points are near which others, against every pair looked at by itself."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from host.estimator.gaussians.near_pairs import _by_strips, near_pairs


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40), st.floats(-2.0, 3.0))
def test_all_pairs_within_reach_are_found_once_and_in_order(
    seed: int, n: int, m: int, size: float
) -> None:
    """Points of any spread, others about a place of their own; by the table and by strips."""
    random = np.random.default_rng(seed)
    points, centre = random.normal(0.0, 10.0**size, (2, n)), random.normal(0.0, 10.0**size, (2, 1))
    others = centre + random.normal(0.0, random.random() * 10.0**size, (2, m))
    squares = (10.0 ** (size + random.uniform(-3.0, 1.0)) * random.random(n)) ** 2
    expected = [
        (i, j)
        for i in range(n)
        for j in range(m)
        if ((points[:, i] - others[:, j]) ** 2).sum() < squares[i]
    ]
    for find in (near_pairs, _by_strips):
        i, j = find(points, squares, others)
        assert np.all(np.diff(i) >= 0)
        assert sorted(zip(i.tolist(), j.tolist(), strict=True)) == expected
