"""Ticks to motion against a fine integration, and back to wheel speeds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import Wheels
from host.drivers.romeo.differential_drive import displacement, wheel_speeds
from tests.drivers.romeo.kinematics import body_speeds

WHEELS = Wheels(left_radius_m=0.0325, right_radius_m=0.033, track_m=0.15, counts_per_turn=1900)
TICKS = st.integers(-20_000, 20_000)


@settings(derandomize=True, deadline=None)
@given(TICKS, TICKS)
def test_the_arc_is_that_of_small_steps(left: int, right: int) -> None:
    step = displacement(WHEELS, 3.0, 0.5, left, right)
    n = 20_000
    turn = 2 * math.pi / 1900
    way = (0.0325 * left + 0.033 * right) * turn / 2
    dpsi = (0.033 * right - 0.0325 * left) * turn / 0.15
    heading = (np.arange(n) + 0.5) / n * dpsi
    assert step.dpsi == pytest.approx(dpsi)
    assert step.dx == pytest.approx(np.cos(heading).sum() * way / n, abs=1e-5)
    assert step.dy == pytest.approx(np.sin(heading).sum() * way / n, abs=1e-5)
    assert (step.time, step.interval, step.ticks) == (3.0, 0.5, (left, right))


def test_signs() -> None:
    ahead = displacement(WHEELS, 0.0, 0.1, 100, 98)
    assert ahead.dx > 0
    left_turn = displacement(WHEELS, 0.0, 0.1, -100, 100)
    assert left_turn.dpsi > 0
    curve = displacement(WHEELS, 0.0, 0.1, 50, 150)
    assert curve.dx > 0
    assert curve.dy > 0


def test_one_turn_of_the_wheels_is_their_circumference() -> None:
    step = displacement(Wheels(), 0.0, 1.0, 1920, 1920)
    assert (step.dx, step.dy, step.dpsi) == (pytest.approx(2 * math.pi * 0.0325), 0.0, 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_variances_add_up_over_pieces_and_do_not_depend_on_direction(sign: int) -> None:
    whole = displacement(WHEELS, 0.0, 1.0, sign * 900, sign * 1100)
    parts = [displacement(WHEELS, 0.0, 0.1, sign * 90, sign * 110) for _ in range(10)]
    assert whole.translation_variance == pytest.approx(sum(p.translation_variance for p in parts))
    assert whole.heading_variance == pytest.approx(sum(p.heading_variance for p in parts))
    way = abs(0.0325 * 900 + 0.033 * 1100) * math.pi / 1900
    assert whole.translation_variance == pytest.approx(WHEELS.distance_noise_m**2 * way)
    expected = WHEELS.heading_noise_rad**2 * abs(whole.dpsi) + WHEELS.drift_noise_rad**2 * way
    assert whole.heading_variance == pytest.approx(expected)


def test_a_robot_at_rest_has_no_odometry_noise() -> None:
    step = displacement(WHEELS, 0.0, 1.0, 0, 0)
    assert (step.dx, step.dy, step.dpsi) == (0.0, 0.0, 0.0)
    assert (step.translation_variance, step.heading_variance) == (0.0, 0.0)


@settings(derandomize=True, deadline=None)
@given(st.floats(-1, 1), st.floats(-6, 6))
def test_wheel_speeds_drive_as_wanted(speed: float, turn_rate: float) -> None:
    left, right = wheel_speeds(WHEELS, speed, turn_rate)
    assert body_speeds(WHEELS, left, right) == pytest.approx((speed, turn_rate), abs=1e-9)
    # One second at these speeds, as the odometry would see it.
    step = displacement(WHEELS, 1.0, 1.0, round(left), round(right))
    assert step.dpsi == pytest.approx(turn_rate, abs=2e-3)
