"""Names on top of the anonymous filter: from estimates and what comes over the link."""

import math
import threading

import numpy as np
import pytest

from host.config import RobotConfig
from host.drivers.link.device import Link
from host.geometry import Path, to_frame, to_parent, wrap
from host.messages import Displacement, Estimate, Health, TeammateOdometry
from host.simulation.live import LiveSimulation
from host.simulation.world.scenarios import parse_scenario
from host.systems.id_phd.naming import Naming

LONG_S = 30.0  # a bound on waiting, not on speed
STEP_S = 0.1
LABELS = np.array([40, 41, 42])


class Swarm:
    """An observer that turns, and three teammates that drive arcs; all by the same clock."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.own = np.zeros(3)
        self.poses = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 2.0], [-1.0, -0.3, -1.0]])
        self.time = 0.0
        self.naming = Naming()

    def step(self, lost=0.0):
        self.time += STEP_S
        self.own[2] += 0.02
        self.naming.take(Displacement(self.time, STEP_S, 0.0, 0.0, 0.02, 1e-7, 1e-6))
        for robot in range(3):
            turned = (0.05, -0.08, 0.02)[robot]
            move = np.array([[0.015, 0.0]])
            place = to_parent(move, self.poses[robot])[0]
            self.poses[robot] = [*place, self.poses[robot, 2] + turned]
            if self.random.uniform() >= lost:
                moved = STEP_S, 0.015, 0.0, turned, 1e-6, 1e-6
                self.naming.take(TeammateOdometry(self.time, robot + 5, *moved))
        return self.naming.take(self.estimate())

    def estimate(self):
        places = to_frame(self.poses[:, :2], self.own) + self.random.normal(0.0, 0.01, (3, 2))
        spread = np.tile(1e-4 * np.eye(2), (3, 1, 1))
        return Estimate(self.time, places, spread, np.ones(3), np.zeros(3), LABELS)

    def heading(self, robot):
        return wrap(self.poses[robot, 2] - self.own[2])


@pytest.mark.parametrize("seed", [1])
def test_labels_get_the_names_and_headings_of_their_robots(seed):
    swarm = Swarm(seed)
    for _ in range(80):
        swarm.step()
    names = swarm.naming.at(swarm.time)
    assert set(names) == set(LABELS.tolist())
    for robot, label in enumerate(LABELS.tolist()):
        assert names[label].identity == robot + 5
        assert names[label].probability > 0.9
        off = wrap(names[label].heading - swarm.heading(robot))
        assert abs(off) < math.radians(8.0)


def test_what_is_found_is_of_the_time_of_an_estimate():
    """What `at` carries to that time is the same; nobody is named twice or without a label."""
    swarm, made = Swarm(2), []
    for _ in range(60):
        names = swarm.step()
        if names is not None:
            made.append(names)
            at_once = swarm.naming.at(names.time)
            assert list(at_once) == names.labels.tolist()
            assert [each.heading for each in at_once.values()] == names.headings.tolist()
            assert len(set(names.identities.tolist())) == len(names.identities)
    steps_s = np.diff([names.time for names in made])
    assert 0.19 < steps_s.min() <= steps_s.max() < 0.31
    assert swarm.time - made[-1].time < 0.6
    assert set(made[-1].identities.tolist()) == {5, 6, 7}


def test_who_is_not_heard_has_no_name():
    swarm = Swarm(1)
    for _ in range(10):
        assert swarm.step(lost=1.0) is None
    assert swarm.naming.at(swarm.time) == {}


def test_a_robot_that_starts_again_is_recognized_anew():
    swarm = Swarm(3)
    for _ in range(40):
        swarm.step()
    swarm.naming.take(TeammateOdometry(swarm.time, 5, 0.0, 0.0, 0.0, 0.0, restarted=True))
    for _ in range(60):
        swarm.step()
    assert swarm.naming.at(swarm.time)[40].identity == 5


def test_simulated_teammates_send_signed_odometry():
    """With the real link: what it hears integrates to how the teammates drove, to their gains.

    The first ten of each only tell their sender's clock.
    """
    scenario = parse_scenario("arena4:seed=2,link_hz=20")
    stop, enough = threading.Event(), threading.Event()
    heard, told = {1: [], 2: [], 3: []}, set()

    def take(message):
        if isinstance(message, TeammateOdometry):
            heard[message.identity].append(message)
        if isinstance(message, Health):
            told.add(message.reason)
        if min(map(len, heard.values())) >= 40 and "hears robot 1, 2, 3" in told:
            enough.set()

    with LiveSimulation(scenario, RobotConfig()) as live:
        link = Link(live.config.link)
        thread = threading.Thread(target=link.run, args=(take, stop))
        thread.start()
        came = enough.wait(LONG_S)
        stop.set()
        thread.join()
        assert came, told
        for robot, messages in heard.items():
            path = Path()
            for each in messages[11:]:
                path.append(each.step)
            times = np.array([messages[10].time, path.end])
            truth = live._simulation.arena.poses(times - live._start)
            (x, y) = to_frame(truth[1, robot, :2], truth[0, robot])
            assert np.hypot(*path.last[:2]) == pytest.approx(math.hypot(x, y), abs=0.03)
