"""Robots on their own whole stacks: nobody is hit, and whoever loses a sensor stops."""

from dataclasses import replace

import numpy as np
import pytest

from host.config import RobotConfig
from host.messages import Displacement, Scan
from host.sessions.offline.swarming import Swarm
from host.sessions.recordings.runs import simulate_scenario
from host.simulation.offline import OBSERVER
from host.simulation.world.scenarios import parse_scenario

FOUR = replace(parse_scenario("arena4:seed=3"), stacks="all")
ALONE = parse_scenario("arena4:seed=5,robots=2,posts=0,stacks=own")


def go_on(swarm: Swarm, first: int, seconds: float) -> int:
    last = first + round(seconds * 50)
    for number in range(first, last):
        swarm.step(number)
    return last


def test_four_robots_walk_and_nobody_is_hit() -> None:
    swarm = Swarm(FOUR, RobotConfig())
    go_on(swarm, 0, 5.0)
    poses = swarm.arena.poses(np.arange(0.0, 5.0, 0.02))
    ways = np.hypot(*np.diff(poses[..., :2], axis=0).transpose(2, 0, 1)).sum(axis=0)
    assert (ways > 0.25).all()
    assert swarm.contacts == []
    first = swarm.stacks[0]
    known = first.localizer.ahead(5.0)
    assert known is not None
    truth = first.simulation.truth(5.0).positions
    near = truth[np.hypot(*truth.T) < 2.0]
    assert all(np.hypot(*(known.positions - mate).T).min() < 0.25 for mate in near)


@pytest.mark.parametrize("loss", ["silent", "dark", "board"])
def test_a_robot_that_loses_its_lidar_or_its_board_stops(loss: str) -> None:
    swarm = Swarm(ALONE, RobotConfig())
    simulation = swarm.observer
    number = go_on(swarm, 0, 1.5)
    # Straight on at full speed, so that there is something to stop.
    while abs(swarm.stacks[OBSERVER].driving._speeds[0]) < 0.2:
        number = go_on(swarm, number, 0.02)
        assert number < 600
    lost = (number - 1) / 50
    if loss == "silent":
        simulation.lidar.answers = False
    elif loss == "dark":
        simulation.lidar.laser_fires = False
    else:  # the host's cable: nothing reaches the board any more
        simulation.board.receive = lambda data, now: None
    go_on(swarm, number, 1.0)
    track = swarm.arena.poses(lost + np.array([0.0, 0.3, 0.32, 0.9]))[:, OBSERVER]
    assert np.hypot(*(track[3, :2] - track[0, :2])) < 0.1
    assert np.hypot(*(track[2, :2] - track[1, :2])) / 0.02 < 0.02
    assert np.allclose(track[3], track[2], atol=1e-3)


def test_the_same_scenario_gives_the_same_messages_and_can_be_scored() -> None:
    text = "arena4:seed=1,robots=2,posts=0,stacks=all,seconds=1.5"
    runs = [simulate_scenario(text) for _ in range(2)]
    assert len(runs[0].truths) > 14
    for first, second in zip(runs[0].messages, runs[1].messages, strict=True):
        assert repr(first) == repr(second)
    steps = [m for m in runs[0].messages if isinstance(m, Displacement)]
    assert sum(step.dx for step in steps) != 0.0
    assert any(isinstance(m, Scan) for m in runs[0].messages)
