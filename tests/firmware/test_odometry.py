"""The board's distance and heading (eq. 31 and 32) against exact sums in fractions."""

import ctypes
import random
from collections.abc import Iterator
from dataclasses import astuple, replace
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from host.drivers.romeo.protocol import SettingsFrame
from host.simulation.devices.romeo_stand_in import DEFAULTS

# Machin's formula by the series of arctan: no constant to copy wrong.
SEED = 31


def _arctan_of_one_over(x: int) -> Fraction:
    return sum(
        (Fraction((-1) ** k, (2 * k + 1) * x ** (2 * k + 1)) for k in range(40)), Fraction(0)
    )


PI = 16 * _arctan_of_one_over(5) - 4 * _arctan_of_one_over(239)


def wrapped(value: int) -> int:
    return (value + 2**31) % 2**32 - 2**31


class Odometry:
    """The firmware's, and beside it exact sums since the start, um and urad."""

    def __init__(self, parts: ctypes.CDLL) -> None:
        self._parts = parts
        self._handle = ctypes.c_void_p(parts.odometry_new())
        self._settings = DEFAULTS
        self._ticks = (0, 0)
        self.distance = self.heading = Fraction(0)

    def close(self) -> None:
        self._parts.odometry_delete(self._handle)

    def configure(self, settings: SettingsFrame) -> None:
        self._settings = settings
        content = settings.LAYOUT.pack(settings.ID, *astuple(settings))
        self._parts.odometry_configure(self._handle, content)

    def move(self, left: int, right: int) -> tuple[int, int]:
        """By so many ticks; how far the firmware's sums are from the exact ones, um and urad."""
        s = self._settings
        turn = 2 * PI / s.counts_per_turn
        left_way, right_way = left * turn * s.left_radius, right * turn * s.right_radius  # nm
        self.distance += (left_way + right_way) / 2000
        self.heading += 10**6 * (right_way - left_way) / s.track
        self._ticks = self._ticks[0] + left, self._ticks[1] + right
        sums = (ctypes.c_int32 * 2)()
        wheels = (ctypes.c_int32(wrapped(ticks)) for ticks in self._ticks)
        self._parts.odometry_advance(self._handle, *wheels, sums)
        return wrapped(sums[0] - round(self.distance)), wrapped(sums[1] - round(self.heading))


@pytest.fixture
def odometry(pure_parts: ctypes.CDLL) -> Iterator[Odometry]:
    odometry = Odometry(pure_parts)
    yield odometry
    odometry.close()


def robots() -> st.SearchStrategy[SettingsFrame]:
    """Any that robot.toml allows."""
    return st.builds(
        lambda left, right, track, counts: replace(
            DEFAULTS, left_radius=left, right_radius=right, track=track, counts_per_turn=counts
        ),
        st.integers(5_000_000, 500_000_000),
        st.integers(5_000_000, 500_000_000),
        st.integers(20_000_000, 2_000_000_000),
        st.integers(4, 100_000),
    )


@hypothesis_settings(derandomize=True, deadline=None)
@given(robots(), st.lists(st.tuples(st.integers(-5000, 5000), st.integers(-5000, 5000))))
def test_random_drives(
    pure_parts: ctypes.CDLL, robot: SettingsFrame, drive: list[tuple[int, int]]
) -> None:
    odometry = Odometry(pure_parts)
    odometry.configure(robot)
    for left, right in drive:
        assert max(map(abs, odometry.move(left, right))) <= 1
    odometry.close()


@hypothesis_settings(derandomize=True, deadline=None)
@given(robots(), st.sampled_from([(1, 1), (1, -1), (-1, -1), (-1, 1), (0, 1)]))
def test_no_drift_over_2_to_the_31_ticks(
    pure_parts: ctypes.CDLL, robot: SettingsFrame, senses: tuple[int, int]
) -> None:
    odometry = Odometry(pure_parts)
    odometry.configure(robot)
    for _ in range(64):
        off = odometry.move(*(sense * 2**25 for sense in senses))
    assert max(map(abs, off)) <= 2, "um or urad in 2^31 ticks"
    odometry.close()


def test_many_reports_drift_no_more_than_few(odometry: Odometry) -> None:
    odometry.configure(DEFAULTS)
    rng = random.Random(SEED)
    for _ in range(20_000):
        off = odometry.move(rng.randrange(-50, 60), rng.randrange(-50, 60))
        assert max(map(abs, off)) <= 1, f"seed {SEED}"


def test_new_settings_count_from_where_the_robot_is(odometry: Odometry) -> None:
    rng = random.Random(SEED)
    for _ in range(200):
        odometry.configure(
            replace(
                DEFAULTS,
                left_radius=rng.randrange(5_000_000, 500_000_000),
                right_radius=rng.randrange(5_000_000, 500_000_000),
                track=rng.randrange(20_000_000, 2_000_000_000),
                counts_per_turn=rng.randrange(4, 100_000),
            )
        )
        off = odometry.move(rng.randrange(-9000, 9000), rng.randrange(-9000, 9000))
        assert max(map(abs, off)) <= 1, f"seed {SEED}"
