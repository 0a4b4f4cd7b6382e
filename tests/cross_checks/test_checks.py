"""The cross-checks on the simulation's messages: silent while all is well, each fault in words."""

import importlib.util
import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from host.config import RobotConfig
from host.cross_checks.checks import DEVICE, CrossChecks
from host.messages import Bearings, Displacement, Health, Message, Scan

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("cross_checks", ROOT / "tools/cross_checks.py")
assert SPEC is not None
assert SPEC.loader is not None
tool = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tool)

BEGIN_S = 5.0
CROWD = "arena4:robots=9,side_m=4,seconds=75,seed=1"


@pytest.fixture(scope="module")
def crowd() -> list[Message]:
    return list(tool.simulated(CROWD))


def judged(messages: Iterable[Message], until_s: float = math.inf) -> list[Health]:
    reports: list[Health] = tool.judged(m for m in messages if m.time < until_s)
    return reports


@pytest.mark.parametrize(
    ("scenario", "standing"),
    [
        ("arena4:seconds=75,seed=2", False),
        ("arena4:posts=12,seconds=70,seed=3", True),
        ("swarm20:seconds=70,seed=4", True),
        ("arena4:speed_mps=0,seconds=30,seed=5", False),
    ],
)
def test_all_is_well(scenario: str, standing: bool) -> None:
    reports = judged(tool.simulated(scenario, standing))
    assert [report.reason for report in reports if not report.ok] == []
    assert {report.device for report in reports} == {DEVICE}
    assert reports[-1].counts["comparisons"] > 0.75 * reports[-1].time
    assert np.diff([report.time for report in reports]) == pytest.approx(1.0, abs=0.1)
    assert reports[-1].reason.startswith("no contradiction between wheels and lidar")


@pytest.mark.parametrize(
    ("fault", "words", "within_s"),
    [
        ("wheels_in_the_air", "the lidar sees nothing move", 12.0),
        ("no_encoder", "the wheels report that it stands", 12.0),
        ("left_encoder_dead", "the left wheel does not turn as its encoder says", 20.0),
        ("right_encoder_reversed", "the right wheel does not turn as its encoder says", 20.0),
        ("encoders_exchanged", "the rotation is reversed", 40.0),
        ("cameras_exchanged", "front and rear camera are exchanged", 60.0),
        ("camera_moved", "deg to the left of the turrets", 60.0),
        ("camera_blind", "no camera sees a strip", 60.0),
        ("lidar_covered", "the lidar finds no turret", 60.0),
    ],
)
def test_a_fault_is_noticed(crowd: list[Message], fault: str, words: str, within_s: float) -> None:
    reports = judged(tool.altered(crowd, fault, BEGIN_S, math.inf), BEGIN_S + within_s)
    found = tool.alarms(reports)
    assert found, reports[-1]
    assert words in found[0].reason
    assert len(found[0].reason.splitlines()) == 3  # what, why, next step


@pytest.mark.parametrize("fault", ["wheels_in_the_air", "no_encoder", "left_encoder_dead"])
def test_a_fault_ends(crowd: list[Message], fault: str) -> None:
    reports = judged(tool.altered(crowd, fault, BEGIN_S, 25.0), 55.0)
    assert any(not report.ok for report in reports)
    assert all(report.ok for report in reports if report.time > 40.0)


def test_a_covered_sector_is_named_by_its_bearing(crowd: list[Message]) -> None:
    for fault in ("camera_blind", "lidar_covered"):
        reports = judged(tool.altered(crowd, fault, BEGIN_S, math.inf))
        words = tool.alarms(reports)[0].reason.splitlines()[0].split()
        place = words.index("between")
        begin, end = int(words[place + 1]), int(words[place + 3])
        assert 35 <= begin < 90 < end <= 145


def test_a_silent_board_is_no_contradiction(crowd: list[Message]) -> None:
    silent = [m for m in crowd if not (isinstance(m, Displacement) and m.time % 20.0 > 10.0)]
    assert all(report.ok for report in judged(silent))


def test_without_wheels_or_lidar_nothing_is_compared(crowd: list[Message]) -> None:
    assert judged(m for m in crowd if not isinstance(m, Displacement)) == []
    assert judged(m for m in crowd if not isinstance(m, Scan)) == []


def test_without_cameras_nothing_is_said_of_them(crowd: list[Message]) -> None:
    reports = judged(m for m in crowd[:8000] if not isinstance(m, Bearings))
    assert {report.reason for report in reports} == {"no contradiction between wheels and lidar"}


def test_a_lidar_mounted_otherwise_is_read_as_configured(crowd: list[Message]) -> None:
    robot = RobotConfig()
    lidar = robot.lidar.model_copy(update={"heading_rad": 1.0})
    checks = CrossChecks(robot.model_copy(update={"lidar": lidar}))
    turned = [replace(m, angles=m.angles - 1.0) if isinstance(m, Scan) else m for m in crowd]
    reports = [report for report in map(checks.take, turned) if report is not None]
    assert all(report.ok for report in reports)


def test_empty_readings_are_survived() -> None:
    checks = CrossChecks(RobotConfig())
    random = np.random.default_rng(0)
    for k in range(600):
        time = 0.1 * k
        count = int(random.choice([0, 1, 3, 61, 300]))
        angles = random.uniform(-math.pi, math.pi, count)
        ranges = random.choice([0.0, 0.2, 3.0], count) if k % 3 else np.full(count, 2.0)
        checks.take(Displacement(time + 0.05, 0.1, 0.1 * (k % 7 == 0), 0.0, 0.3 * (k % 5 == 0)))
        checks.take(Scan(time, np.full(count, time), angles, ranges))
        checks.take(Displacement(time + 0.06, 0.01, 0.0, 0.0, 0.0))
        seen = random.uniform(-math.pi, math.pi, int(random.choice([0, 1, 4])))
        checks.take(Bearings(time, seen, np.zeros(len(seen))))
