"""UMBmark's figures against the closed forms of the paper and against a robot that is wrong."""

import math

import numpy as np
import pytest

from host.evaluation.umbmark import corrected, returned, umbmark

SIDE, TRACK = 1.0, 0.144


@pytest.mark.parametrize(("alpha", "beta"), [(1e-4, 0.0), (0.0, 1e-4), (-2e-4, 3e-4)])
def test_small_errors_follow_the_papers_closed_forms(alpha: float, beta: float) -> None:
    cw_x, _, ccw_x, _ = returned(alpha, beta, SIDE)
    assert cw_x == pytest.approx(-2.0 * SIDE * (alpha + beta), abs=1e-6)
    assert ccw_x == pytest.approx(-2.0 * SIDE * (alpha - beta), abs=1e-6)


@pytest.mark.parametrize(
    ("alpha", "beta"), [(0.17, 0.6), (0.1, 0.3), (-0.2, 0.6), (0.3, -0.8), (0.05, -0.4), (0.0, 0.0)]
)
def test_large_errors_are_solved_exactly(alpha: float, beta: float) -> None:
    """The robot ends 3 m from its start, where other angles nearly explain the same."""
    ends = returned(alpha, beta, SIDE)
    found = umbmark(ends[None, :2], ends[None, 2:], SIDE, TRACK)
    assert (found.alpha_rad, found.beta_rad) == pytest.approx((alpha, beta), abs=1e-6)


def believed_square(left: float, right: float, track: float, sign: float) -> tuple[float, float]:
    """Where a robot ends with such true radii and track (shares of the nominal), by small steps."""
    x = y = heading = 0.0
    for _ in range(4):
        for way_left, way_right in (
            (SIDE, SIDE),
            (-sign * math.pi / 4 * TRACK, sign * math.pi / 4 * TRACK),
        ):
            steps = 2000
            dl, dr = left * way_left / steps, right * way_right / steps
            for _ in range(steps):
                heading += 0.5 * (dr - dl) / (track * TRACK)
                x += 0.5 * (dl + dr) * math.cos(heading)
                y += 0.5 * (dl + dr) * math.sin(heading)
                heading += 0.5 * (dr - dl) / (track * TRACK)
    return x, y


@pytest.mark.parametrize("share", [0.005, 0.02, 0.05])
def test_wheels_and_track_that_are_wrong_are_found(share: float) -> None:
    left, right, track = 1.0 + share / 2, 1.0 - share / 2, 1.0 + share
    cw = np.array([believed_square(left, right, track, -1.0)])
    ccw = np.array([believed_square(left, right, track, 1.0)])
    found = umbmark(cw, ccw, SIDE, TRACK)
    assert found.systematic_m == pytest.approx(max(np.hypot(*cw[0]), np.hypot(*ccw[0])))
    fitted = corrected(found, 0.0325, 0.0325, TRACK)
    assert fitted[1] / fitted[0] == pytest.approx(right / left, abs=0.1 * share)
    assert fitted[2] == pytest.approx(track * TRACK, rel=0.1 * share)


def test_the_spread_is_that_about_the_centres() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, (2, 200, 2))
    cw, ccw = noise + np.array([[[0.1, 0.2]], [[-0.1, 0.0]]])
    found = umbmark(cw, ccw, SIDE, TRACK)
    assert found.spread_m == pytest.approx(0.01, rel=0.1)
    assert found.centre_cw == pytest.approx((0.1, 0.2), abs=0.003)
    assert umbmark(np.zeros((1, 2)), np.zeros((1, 2)), SIDE, TRACK).wheel_ratio == 1.0
