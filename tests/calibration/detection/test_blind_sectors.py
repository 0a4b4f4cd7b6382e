"""Blind sectors, from samples of a robot that turns in a room with a dark wall."""

import math

import numpy as np
import pytest

from host.calibration.detection.blind_sectors import FoundSector, find_sectors, with_sigmas
from host.config import Lidar
from host.geometry import wrap
from host.messages import FloatArray, Scan

PILLARS = ((45.0, 6.0), (135.0, 6.0), (-135.0, 6.0), (-45.0, 6.0))
ODD = ((179.0, 9.0), (-20.0, 3.0), (60.3, 14.7), (100.0, 2.0))
LIDAR = Lidar(heading_rad=0.5)


def drive(
    pillars: tuple[tuple[float, float], ...],
    turns: int = 300,
    headings: FloatArray | None = None,
    stray: float = 0.0,
    pillar_range_m: float = 0.0,
    seed: int = 11,
) -> list[Scan]:
    """Scans of a robot at `headings` (turns,) rad; nothing comes back from a fifth of the room.

    stray: share of the samples behind pillars that give a return all the same. pillar_range_m:
    what the others give.
    """
    random = np.random.default_rng(seed)
    headings = np.linspace(0.0, 9.0, turns) if headings is None else headings
    scans = []
    for k, heading in enumerate(headings):
        robot = wrap(random.uniform(-math.pi, math.pi) - np.arange(714) * math.tau / 714.3)
        ranges = random.uniform(0.5, 3.0, len(robot))
        ranges[random.random(len(robot)) < 0.1] = 0.0
        floor = wrap(robot + heading)
        ranges[(floor > 0.3) & (floor < 0.3 + 0.2 * math.tau)] = 0.0
        for centre, width in pillars:
            blind = np.abs(wrap(robot - math.radians(centre))) < math.radians(width) / 2.0
            ranges[blind & (random.random(len(robot)) >= stray)] = pillar_range_m
        times = k / 7.0 + np.arange(714) / 5000.0
        scans.append(Scan(float(times[-1]), times, wrap(robot - LIDAR.heading_rad), ranges))
    return scans


def in_degrees(sectors: list[FoundSector]) -> FloatArray:
    found = np.degrees([(s.centre, s.width) for s in sectors]).reshape(-1, 2)
    return found[np.argsort(found[:, 0])]


@pytest.mark.parametrize("pillars", [PILLARS, ODD])
def test_pillars_are_found_to_a_fraction_of_a_degree(
    pillars: tuple[tuple[float, float], ...],
) -> None:
    found = find_sectors(drive(pillars), LIDAR)
    assert in_degrees(found) == pytest.approx(np.array(sorted(pillars)), abs=0.3)
    for sector in found:
        assert 0.0 < sector.centre_sigma < math.radians(0.2)
        assert 0.0 < sector.width_sigma < math.radians(0.4)


def test_sigmas_are_a_jackknifes_over_pieces_with_the_resolution_added() -> None:
    """By hand: with eight estimates x, the variance is 7/8 of the sum of (x - mean)²."""
    random = np.random.default_rng(3)
    off, wider = random.normal(0.0, 0.01, (2, 8))
    # About a pillar at the rear, whose estimates lie on both sides of half a circle.
    pieces = [
        FoundSector(float(wrap(math.pi + a)), 0.1 + b) for a, b in zip(off, wider, strict=True)
    ]
    found = with_sigmas(FoundSector(-math.pi, 0.1), [[piece] for piece in pieces])
    bin_rad = math.tau / 1800
    for sigma, draws, floor in (
        (found.centre_sigma, off, 0.1 * bin_rad),
        (found.width_sigma, wider, 0.2 * bin_rad),
    ):
        squares = 7.0 / 8.0 * sum((draw - sum(draws) / 8.0) ** 2 for draw in draws)
        assert sigma == pytest.approx(math.sqrt(squares + floor**2), rel=1e-9)
    once_missed = with_sigmas(FoundSector(-math.pi, 0.1), [[], *([piece] for piece in pieces)])
    assert (once_missed.centre_sigma, once_missed.width_sigma) == (0.1, 0.1)


def test_sectors_scatter_no_more_over_drives_than_their_sigmas_say() -> None:
    """The scatter is well below the directions' resolution, which the sigmas include."""
    off = []
    for seed in range(6):
        found = find_sectors(drive(PILLARS, turns=200, seed=seed), LIDAR)
        off += [
            float(wrap(sector.centre - math.radians(centre))) / sector.centre_sigma
            for sector, (centre, _) in zip(found, sorted(PILLARS), strict=True)
        ]
    assert 0.2 < np.std(off) < 1.0


def test_without_pillars_there_are_none_though_a_wall_is_dark() -> None:
    assert find_sectors(drive(()), LIDAR) == []


def test_a_direction_that_mostly_faced_the_dark_wall_is_not_blind() -> None:
    """The robot stood for most of the time and turned once."""
    headings = np.concatenate((np.full(260, 0.4), np.linspace(0.4, 0.4 + math.tau, 40)))
    found = find_sectors(drive(PILLARS, headings=headings), LIDAR)
    assert in_degrees(found) == pytest.approx(np.array(sorted(PILLARS)), abs=1.0)


def test_pillars_that_give_returns_below_the_least_range_are_blind_too() -> None:
    found = find_sectors(drive(PILLARS, pillar_range_m=0.08), LIDAR)
    assert in_degrees(found) == pytest.approx(np.array(sorted(PILLARS)), abs=0.3)


def test_a_stray_return_in_a_hundred_does_not_open_a_pillar() -> None:
    found = find_sectors(drive(PILLARS, stray=0.005), LIDAR)
    assert in_degrees(found) == pytest.approx(np.array(sorted(PILLARS)), abs=0.3)


def test_what_the_field_of_view_leaves_out_is_not_a_sector() -> None:
    lidar = LIDAR.model_copy(update={"field_of_view_rad": math.radians(180.0)})
    found = find_sectors(drive((*PILLARS, (180.0, 170.0))), lidar)
    assert in_degrees(found) == pytest.approx(np.array([(-45.0, 6.0), (45.0, 6.0)]), abs=0.3)


@pytest.mark.parametrize("turns", [0, 1, 5])
def test_a_few_turns_tell_nothing(turns: int) -> None:
    assert find_sectors(drive(PILLARS, turns=turns), LIDAR) == []


def test_a_lidar_that_saw_nothing_has_no_sectors() -> None:
    silent = [Scan(s.time, s.times, s.angles, np.zeros(714)) for s in drive((), turns=40)]
    assert find_sectors(silent, LIDAR) == []
