"""A lidar is judged by what its revolutions contain: silent where it is well, and precise."""

import csv
import gzip
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from host.config import BlindSector, Lidar, RobotConfig
from host.drivers.x4.liveness import Liveness, covered_sector, judged_degrees
from host.messages import FloatArray, Scan
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario

BARE = Lidar(blind_sectors=())


def recorded_revolutions(path: Path) -> list[FloatArray]:
    """Angle (rad, counter-clockwise) and range (m) of the samples of each revolution."""
    found = defaultdict(list)
    rooms = path.suffix == ".gz"
    with gzip.open(path, "rt") if rooms else path.open() as lines:
        for row in csv.DictReader(lines):
            if rooms:
                point = float(row["angle_rad"]), float(row["range_m"])
                found[row["scan"]].append(point)
            else:
                found[row["time_stamp"]].append((-float(row["angle"]), float(row["range"])))
    return [np.array(points) for points in found.values()]


def words_of(
    revolutions: list[FloatArray], config: Lidar = BARE, rate_hz: float = 5000.0
) -> list[str]:
    """What is said each second; "" where all is well."""
    liveness, samples, next_s, words = Liveness(config), 0, 1.0, []
    for points in revolutions:
        times = (samples + np.arange(len(points))) / rate_hz
        samples += len(points)
        angles = (points[:, 0] + math.pi) % (2.0 * math.pi) - math.pi
        span = np.ptp(np.unwrap(points[:, 0])) / (2.0 * math.pi)
        liveness.add(Scan(times[-1], times, angles, points[:, 1]), 5000.0 * span / len(points))
        if times[-1] >= next_s:
            next_s += 1.0
            fault = liveness.fault(float(times[-1]), samples)
            words.append(fault.what if fault else "")
    return words


def room(seconds: float, n: int = 700, noise_m: float = 0.003, seed: int = 1) -> list[FloatArray]:
    random = np.random.default_rng(seed)
    angles = -np.arange(n) * 2.0 * math.pi / n
    found = []
    for _ in range(int(seconds * 5000 / n)):
        ranges = 2.0 + 0.5 * np.cos(3 * angles) + noise_m * random.standard_normal(n)
        ranges[random.random(n) < 0.3] = 0.0
        found.append(np.stack((angles, np.round(ranges, 3)), axis=1))
    return found


def covered(revolutions: list[FloatArray], begin: float, width: float) -> list[FloatArray]:
    """The same with nothing coming back from `begin` on, deg."""
    found = []
    for points in revolutions:
        hidden = (np.degrees(points[:, 0]) - begin) % 360.0 < width
        found.append(np.stack((points[:, 0], np.where(hidden, 0.0, points[:, 1])), axis=1))
    return found


def recordings(recorded: Callable[[str], Path]) -> Iterator[Path]:
    yield from sorted(recorded("x4_rooms").glob("*.csv.gz"))
    yield from sorted(recorded("x4_cones").glob("*.csv"))


def test_recorded_lidars_are_well(recorded: Callable[[str], Path]) -> None:
    for path in recordings(recorded):
        assert set(words_of(recorded_revolutions(path) * 2)) == {""}, path


@pytest.mark.parametrize(("begin", "width"), [(40, 90), (150, 60), (-70, 110)])
def test_a_covered_window_is_named_in_recorded_rooms_but_not_in_the_open(
    begin: int, width: int, recorded: Callable[[str], Path]
) -> None:
    for path in recordings(recorded):
        revolutions = covered(recorded_revolutions(path) * 2, begin, width)
        words = words_of(revolutions)
        inside = path.suffix == ".gz"
        assert ("something covers the window" in words[-1]) == (inside or "noisy" in path.name)


@pytest.mark.parametrize("begin", [40, 150, -60])
@pytest.mark.parametrize("width", [50, 90, 170])
@pytest.mark.parametrize("heading_deg", [0, 90])
def test_the_covered_sector_is_told_in_the_robot_frame(
    begin: int, width: int, heading_deg: int
) -> None:
    config = Lidar(blind_sectors=(), heading_rad=math.radians(heading_deg))
    words = words_of(covered(room(8.0), begin, width), config)
    edges = [(degrees + heading_deg + 179) % 360 - 179 for degrees in (begin, begin + width)]
    said = [int(word) for word in words[-1].split() if word.lstrip("-").isdigit()]
    assert said == pytest.approx(edges, abs=2)


def test_blind_sectors_and_the_field_of_view_are_expected() -> None:
    sector = BlindSector(centre_rad=math.radians(85), width_rad=math.radians(90))
    hidden = covered(room(8.0), 40, 90)
    assert set(words_of(hidden, Lidar(blind_sectors=(sector,)))) == {""}
    assert "between 40 and 130 deg" in words_of(hidden, Lidar())[-1]  # four narrow pillars
    behind = covered(room(8.0), 120, 120)
    half = Lidar(blind_sectors=(), field_of_view_rad=math.radians(230))
    assert set(words_of(behind, half)) == {""}


def test_no_sector_is_covered_where_most_directions_are_empty() -> None:
    judged = judged_degrees(BARE)
    filled = np.zeros(360, dtype=bool)
    filled[100:130] = filled[280:300] = True
    assert covered_sector(filled, judged) is None
    assert covered_sector(~judged, judged) is None
    one_wall = np.arange(360) < 165
    assert covered_sector(one_wall, judged) is None


@pytest.mark.parametrize(("width_m", "depth_m"), [(12.0, 8.0), (15.0, 10.0), (18.0, 9.0)])
@pytest.mark.parametrize("place", [(0.5, 0.5), (0.5, 4.0), (0.4, 2.0)])
def test_a_hall_whose_far_end_is_out_of_reach_is_no_cover(
    width_m: float, depth_m: float, place: tuple[float, float]
) -> None:
    x, y = place
    angles = -(np.arange(700) + 0.5) * 2.0 * math.pi / 700
    to_x = np.where(np.cos(angles) > 0.0, width_m - x, -x) / np.cos(angles)
    to_y = np.where(np.sin(angles) > 0.0, depth_m - y, -y) / np.sin(angles)
    ranges = np.minimum(to_x, to_y)
    ranges[ranges > 10.0] = 0.0
    random = np.random.default_rng(1)
    noise = 0.003 * random.standard_normal((60, 700)) * (ranges > 0.0)
    assert set(words_of([np.stack((angles, ranges + e), axis=1) for e in noise])) == {""}


def test_a_dead_laser_is_named() -> None:
    dead = [points * [1.0, 0.0] for points in room(4.0)]
    assert words_of(dead)[-1] == "all ranges are zero: the laser does not fire"
    taped = [np.where([[False, True]], 0.03 * (points > 0), points) for points in room(4.0)]
    assert words_of(taped)[-1].startswith("all ranges are zero")


def test_frozen_ranges_are_named() -> None:
    assert "frozen" in words_of(room(1.0)[:1] * 30)[-1]
    assert set(words_of(room(6.0))) == {""}


@pytest.mark.parametrize("speed_hz", [2.0, 4.0, 5.5, 13.0])
def test_a_wrong_speed_is_named(speed_hz: float) -> None:
    words = words_of(room(9.0, n=round(5000 / speed_hz)))
    assert f"the motor makes {speed_hz:.1f} revolutions/s" in words[-1]


@pytest.mark.parametrize("speed_hz", [6.0, 7.0, 12.0])
def test_speeds_of_the_data_sheet_are_well(speed_hz: float) -> None:
    assert set(words_of(room(9.0, n=round(5000 / speed_hz)))) == {""}


def test_revolutions_that_are_never_complete_are_named() -> None:
    parts = [points[:400] for points in room(14.0)]
    assert words_of(parts)[-1] == "scanning, but no revolution is complete"
    standing = [points * [0.0, 1.0] for points in room(9.0)]
    assert words_of(standing)[-1] == "scanning, but no revolution is complete"


@pytest.mark.parametrize("rate_hz", [2500.0, 4000.0, 9000.0])
def test_a_wrong_sample_rate_is_named(rate_hz: float) -> None:
    said = words_of(room(9.0), rate_hz=rate_hz)[-1]
    assert float(next(word for word in said.split() if word.isdigit())) == pytest.approx(
        rate_hz, rel=0.05
    )


@pytest.mark.parametrize("name", ["arena4:seconds=40", "swarm20:seconds=20"])
def test_simulated_lidars_are_well(name: str) -> None:
    config = RobotConfig()
    liveness, samples, next_s = Liveness(config.lidar), 0, 1.0
    for message in Simulation(parse_scenario(name), config).messages():
        if isinstance(message, Scan):
            samples += len(message.ranges)
            liveness.add(message, 7.0)
            if message.time >= next_s:
                next_s += 1.0
                assert liveness.fault(message.time, samples) is None


def test_what_waited_while_the_host_was_busy_is_no_other_model() -> None:
    """5000 samples/s, of which those of half a second wait, again and again."""
    liveness, samples, read = Liveness(BARE), 0, 0
    for points in room(13.0):
        times = (samples + np.arange(len(points))) / 5000.0
        samples += len(points)
        liveness.add(Scan(times[-1], times, points[:, 0], points[:, 1]), 7.1)
        if times[-1] % 3.0 > 0.5:
            read = samples
        fault = liveness.fault(float(times[-1]), read)
        assert fault is None or "only" in fault.what


def test_what_came_while_the_host_was_suspended_is_not_missed_for_ever() -> None:
    liveness, samples, words = Liveness(BARE), 0, set[str]()
    for k, points in enumerate(room(30.0)):
        suspended_s = 20.0 if k > 50 else 0.0  # what came meanwhile is lost
        times = suspended_s + (samples + np.arange(len(points))) / 5000.0
        angles = (points[:, 0] + math.pi) % (2.0 * math.pi) - math.pi
        samples += len(points)
        liveness.add(Scan(times[-1], times, angles, points[:, 1]), 7.0)
        if k % 7 == 0:
            # A second has some more samples or some less, as they are read.
            fault = liveness.fault(float(times[-1]), samples + 40 * (k % 2))
            words.add(fault.what if fault else "")
    assert words == {""}
