"""Robots that form a circle on their own estimates, beside the same controller on the truth.

    python tools/formations.py [--seeds 1,2,3] [--seconds 40]

For each seed: shape error (rms over robots, m, mean of the last 10 s, to even places on a circle of
the radius), when it settled (s: from then on below 10 cm), contacts.
"""

import argparse
import math
from dataclasses import replace

import numpy as np

from host.behaviour.formations import Circle
from host.behaviour.interface import Behaviour, Command, Situation
from host.config import RobotConfig
from host.geometry import to_frame
from host.messages import Estimate, FloatArray
from host.sessions.swarming import Swarm
from host.simulation.world.arena import ARENA_STEP_S, Arena
from host.simulation.world.scenarios import parse_scenario

SETTLED_M, LAST_S, EVERY = 0.1, 10.0, 10


class OnTruth:
    """A behaviour whose teammates are where they truly are."""

    def __init__(self, behaviour: Behaviour, robot: int) -> None:
        self.behaviour, self.robot = behaviour, robot
        self.arena: Arena | None = None

    def command(self, now: Situation) -> Command | None:
        """What the behaviour says to the truth."""
        if self.arena is None:
            return None
        (poses,) = self.arena.poses(np.array([self.arena.now]))
        others = to_frame(np.delete(poses, self.robot, axis=0)[:, :2], poses[self.robot])
        count = len(others)
        known = Estimate(
            now.time,
            others,
            np.tile(1e-6 * np.eye(2), (count, 1, 1)),
            np.ones(count),
            np.zeros(count),
            np.arange(count),
        )
        return self.behaviour.command(replace(now, estimate=known))


def circle_error(positions: FloatArray) -> float:
    """RMS distance, m, of positions (n, 2) to even places on the circle, laid on them best."""
    count = len(positions)
    around = positions - positions.mean(axis=0)
    angles = np.arctan2(around[:, 1], around[:, 0])
    order = np.argsort(angles)
    even = 2.0 * math.pi * np.arange(count) / count
    shift = float(np.angle(np.mean(np.exp(1j * (angles[order] - even)))))
    places = Circle().radius_m * np.column_stack((np.cos(even + shift), np.sin(even + shift)))
    return float(np.sqrt(np.mean(np.sum((around[order] - places) ** 2, axis=1))))


def run(seed: int, seconds: float, truth: bool) -> tuple[float, float, int]:
    """Shape error m, when it settled s, contacts."""
    robot = RobotConfig()
    scenario = parse_scenario(f"formation6:seconds={seconds},seed={seed}")
    made = [Circle() for _ in range(scenario.robots)]
    on_truth = [OnTruth(each, number) for number, each in enumerate(made)]
    swarm = Swarm(scenario, robot, (on_truth if truth else made).__getitem__)
    for each in on_truth:
        each.arena = swarm.arena
    errors = []
    for step in range(round(seconds / ARENA_STEP_S) + 1):
        swarm.step(step)
        if step % EVERY == 0:
            (poses,) = swarm.arena.poses(np.array([step * ARENA_STEP_S]))
            errors.append(circle_error(poses[:, :2]))
    apart = np.flatnonzero(np.array(errors) > SETTLED_M)
    settled = (apart[-1] + 1) * EVERY * ARENA_STEP_S if len(apart) else 0.0
    last = errors[-round(LAST_S / (EVERY * ARENA_STEP_S)) :]
    return float(np.mean(last)), settled, len(swarm.contacts)


def main() -> None:
    """Print a row a seed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--seconds", type=float, default=40.0)
    asked = parser.parse_args()
    print("    seed estimates: error m  settled s  contacts   truth: the same")
    for seed in map(int, asked.seeds.split(",")):
        own, true = (run(seed, asked.seconds, truth) for truth in (False, True))
        ours = f"{seed:8} {own[0]:18.3f} {own[1]:10.1f} {own[2]:9}"
        print(f"{ours}   {true[0]:.3f} {true[1]:.1f} {true[2]}", flush=True)


if __name__ == "__main__":
    main()
