"""A square that ends where it began."""

import math

import numpy as np
import pytest

from host.behaviour.square import Square
from tests.behaviour.unicycle import led


@pytest.mark.parametrize("left", [True, False])
def test_a_square_has_its_corners_and_ends_at_its_start(left: bool) -> None:
    poses = led(Square(1.0, left), 80.0)
    sign = 1.0 if left else -1.0
    assert len(poses) < 60 / 0.02
    assert poses[-1] == pytest.approx([0.0, 0.0, sign * math.tau], abs=0.01)
    for corner in ((1.0, 0.0), (1.0, sign), (0.0, sign)):
        assert np.hypot(*(poses[:, :2] - corner).T).min() < 0.01
    assert (sign * poses[:, 1]).min() > -0.01
