"""Random walks of swarms on their own stacks: who drove against what, who stopped in time?

    python tools/random_walks.py arena4 --seeds 1-10 [--lidar-dies]

In closed loop on the fast model of the boards, a walk on each core; lines come as walks end. With
--lidar-dies the lidar of the first robot falls silent while it drives, from the middle of each walk
on: how far it goes on, and for how long, is reported.
"""

import math
import multiprocessing
import os
import time
from dataclasses import dataclass, replace

import click
import numpy as np

from host.config import RobotConfig
from host.sessions.offline.swarming import Swarm
from host.simulation.offline import OBSERVER
from host.simulation.world.arena import ARENA_STEP_S, Contact
from host.simulation.world.scenarios import parse_scenario

STILL_MPS, FAST_MPS = 0.02, 0.2
STOP_S = 2.0  # after a loss, over which its stop is looked at


@dataclass(frozen=True, slots=True)
class Walk:
    """Which walk: a scenario as users write it, without its seed."""

    scenario: str
    seed: int
    seconds: float
    lidar_dies: bool


@dataclass(frozen=True, slots=True)
class Walked:
    """How a walk went. way_m: of a robot, on average. pace: times real time, by CPU time.

    stop: how far (m) the first robot went on after the loss of its lidar, and for how long (s).
    """

    walk: Walk
    contacts: list[Contact]
    way_m: float
    pace: float
    stop: tuple[float, float] | None


def walked(walk: Walk) -> Walked:
    """Let all robots of a scenario walk."""
    joint = "," if ":" in walk.scenario else ":"
    scenario = parse_scenario(f"{walk.scenario}{joint}seed={walk.seed}")
    swarm = Swarm(replace(scenario, stacks="all"), RobotConfig())
    steps = round(walk.seconds / ARENA_STEP_S)
    lost = math.inf  # s
    begin = time.process_time()
    for number in range(steps):
        if walk.lidar_dies and number > steps // 2 and lost == math.inf and speed(swarm) > FAST_MPS:
            swarm.observer.lidar.answers, lost = False, swarm.arena.now
        swarm.step(number)
    pace = walk.seconds / (time.process_time() - begin)
    poses = swarm.arena.poses(np.arange(0.0, walk.seconds, 0.1))[..., :2]
    way = np.hypot(*np.diff(poses, axis=0).transpose(2, 0, 1)).sum() / poses.shape[1]
    stop = stopped(swarm, lost) if lost < walk.seconds - STOP_S else None
    return Walked(walk, swarm.contacts, float(way), pace, stop)


def speed(swarm: Swarm) -> float:
    """Of the first robot in the last step, m/s."""
    before, after = swarm.arena.poses(swarm.arena.now - np.array([ARENA_STEP_S, 0.0]))[:, OBSERVER]
    return float(np.hypot(*(after - before)[:2])) / ARENA_STEP_S


def stopped(swarm: Swarm, lost: float) -> tuple[float, float]:
    """How far (m) the first robot went on after its loss at `lost` (s), and for how long (s)."""
    times = lost + np.arange(0.0, STOP_S, ARENA_STEP_S)
    track = swarm.arena.poses(times)[:, OBSERVER, :2]
    speeds = np.hypot(*np.diff(track, axis=0).T) / ARENA_STEP_S
    moving = np.flatnonzero(speeds > STILL_MPS)
    lasted = (moving[-1] + 1) * ARENA_STEP_S if len(moving) else 0.0
    return float(np.hypot(*(track[-1] - track[0]))), lasted


def line(done: Walked) -> str:
    """A walk in words, with each of its contacts."""
    words = (
        f"seed {done.walk.seed}: {len(done.contacts)} contacts, {done.way_m:.1f} m a robot, "
        f"x{done.pace:.1f}"
    )
    if done.stop is not None:
        words += f"; stopped within {100 * done.stop[0]:.1f} cm and {done.stop[1]:.2f} s"
    return " ".join((words, *map(str, done.contacts)))


@click.command(help=__doc__)
@click.argument("scenario", default="arena4")
@click.option("--seeds", default="1-3", show_default=True, help="First and last.")
@click.option("--seconds", default=60.0, show_default=True, help="Of each walk.")
@click.option("--lidar-dies", is_flag=True, help="The first robot's, in the middle.")
@click.option("--workers", default=os.cpu_count(), show_default=True, help="Walks at a time.")
def main(scenario: str, seeds: str, seconds: float, lidar_dies: bool, workers: int) -> None:
    """Print a line for each walk, and the sums."""
    first, last = map(int, seeds.split("-"))
    walks = [Walk(scenario, seed, seconds, lidar_dies) for seed in range(first, last + 1)]
    results = []
    with multiprocessing.Pool(workers) as pool:
        for done in pool.imap_unordered(walked, walks):
            results.append(done)
            print(line(done), flush=True)
    contacts = sum(len(done.contacts) for done in results)
    print(f"{contacts} contacts in {len(walks)} walks of {seconds:.0f} s")
    stops = np.array([done.stop for done in results if done.stop is not None])
    if len(stops):
        far, lasted = stops.max(axis=0)
        print(f"the longest stop: {100 * far:.1f} cm, {lasted:.2f} s")


if __name__ == "__main__":
    main()
