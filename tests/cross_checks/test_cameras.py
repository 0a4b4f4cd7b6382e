"""Sectors without a counterpart and constant offsets, in counts made by hand."""

import math

import numpy as np
import pytest

from host.cross_checks.cameras import constant_offset, lonely_sector
from host.geometry import wrap

RANDOM = np.random.default_rng(5)
AROUND = np.radians(np.arange(-180.0, 180.0, 0.5))  # 90 in each sector of 45 deg


def test_a_sector_where_nothing_is_met_is_named_by_its_borders() -> None:
    away = np.abs(wrap(AROUND - math.radians(170.0)))
    found = lonely_sector(AROUND, away > math.radians(35.0))
    assert found is not None
    begin, end = np.degrees(found)
    # The grid of sectors is 15 deg fine; it goes around behind the robot.
    assert begin == pytest.approx(135.0, abs=15.1)
    assert end == pytest.approx(205.0, abs=15.1)
    assert begin < 170.0 < end


@pytest.mark.parametrize("share", [0.0, 0.2, 1.0])
def test_no_sector_stands_out_where_all_are_alike(share: float) -> None:
    met = RANDOM.random(len(AROUND)) < share
    assert lonely_sector(AROUND, met) is None


def test_few_events_say_nothing() -> None:
    few = AROUND[::4]  # 22 in a sector
    assert lonely_sector(few, np.abs(few) > 0.6) is None
    assert lonely_sector(np.zeros(0), np.zeros(0, dtype=bool)) is None


def test_elsewhere_there_have_to_be_counterparts() -> None:
    luck = RANDOM.random(len(AROUND))
    away = np.abs(AROUND) > 0.6
    assert lonely_sector(AROUND, (luck < 0.4) & away) is None
    assert lonely_sector(AROUND, (luck < 0.6) & away) is not None


@pytest.mark.parametrize("degrees", [-178, -90, -35, 40, 120, 180])
def test_a_constant_offset_stands_out_of_chance(degrees: float) -> None:
    chance = RANDOM.uniform(-math.pi, math.pi, 600)
    own = math.radians(degrees) + math.radians(5.0) * RANDOM.standard_normal(200)
    found = constant_offset(np.asarray(wrap(np.concatenate((chance, own)))), 250)
    assert found is not None
    assert float(wrap(found - math.radians(degrees))) == pytest.approx(0.0, abs=math.radians(6.0))


def test_no_offset_is_named_where_bearings_meet_or_only_chance_is_seen() -> None:
    chance = RANDOM.uniform(-math.pi, math.pi, 600)
    own = math.radians(5.0) * RANDOM.standard_normal(200)
    assert constant_offset(np.concatenate((chance, own)), 250) is None
    assert constant_offset(chance, 250) is None
    assert constant_offset(np.zeros(0), 0) is None
    few = np.full(30, math.radians(90.0))
    assert constant_offset(few, 30) is None
