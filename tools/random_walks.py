"""Random walks of swarms on their own stacks: who drove against what, who stopped in time?

    python tools/random_walks.py arena4 --seeds 1-10 [--lidar-dies]

In closed loop on the fast model of the boards. With --lidar-dies the lidar of the first robot falls
silent in the middle of each walk: how far it goes on, and for how long, is reported.
"""

import time
from dataclasses import replace

import click
import numpy as np

from host.config import RobotConfig
from host.sessions.swarming import Swarm
from host.simulation.offline import OBSERVER
from host.simulation.world.arena import ARENA_STEP_S
from host.simulation.world.scenarios import parse_scenario

STILL_MPS = 0.02


def walk(scenario: str, seconds: float, lidar_dies: bool) -> tuple[Swarm, float]:
    """A walk of so long; the swarm after it, and times real time by this process's CPU time."""
    swarm = Swarm(replace(parse_scenario(scenario), stacks="all"), RobotConfig())
    steps = round(seconds / ARENA_STEP_S)
    begin = time.process_time()
    for number in range(steps):
        if lidar_dies and number == steps // 2:
            swarm.observer.lidar.answers = False
        swarm.step(number)
    return swarm, seconds / (time.process_time() - begin)


def stop(swarm: Swarm, lost: float) -> tuple[float, float]:
    """How far (m) the first robot went on after its loss at `lost` (s), and for how long (s)."""
    times = lost + np.arange(0.0, 2.0, ARENA_STEP_S)
    track = swarm.arena.poses(times)[:, OBSERVER, :2]
    speeds = np.hypot(*np.diff(track, axis=0).T) / ARENA_STEP_S
    moving = np.flatnonzero(speeds > STILL_MPS)
    lasted = (moving[-1] + 1) * ARENA_STEP_S if len(moving) else 0.0
    return float(np.hypot(*(track[-1] - track[0]))), lasted


@click.command(help=__doc__)
@click.argument("scenario", default="arena4")
@click.option("--seeds", default="1-3", show_default=True, help="First and last.")
@click.option("--seconds", default=60.0, show_default=True, help="Of each walk.")
@click.option("--lidar-dies", is_flag=True, help="The first robot's, in the middle.")
def main(scenario: str, seeds: str, seconds: float, lidar_dies: bool) -> None:
    """Print a line for each walk, and the sums."""
    first, last = map(int, seeds.split("-"))
    contacts = 0
    for seed in range(first, last + 1):
        joint = "," if ":" in scenario else ":"
        swarm, pace = walk(f"{scenario}{joint}seed={seed}", seconds, lidar_dies)
        contacts += len(swarm.contacts)
        poses = swarm.arena.poses(np.arange(0.0, seconds, 0.1))[..., :2]
        way = np.hypot(*np.diff(poses, axis=0).transpose(2, 0, 1)).sum() / poses.shape[1]
        line = f"seed {seed}: {len(swarm.contacts)} contacts, {way:.1f} m a robot, x{pace:.1f}"
        if lidar_dies:
            far, lasted = stop(swarm, round(seconds / ARENA_STEP_S) // 2 * ARENA_STEP_S)
            line += f"; stopped within {100 * far:.1f} cm and {lasted:.2f} s"
        print(line, *swarm.contacts, flush=True)
    print(f"{contacts} contacts in {last - first + 1} walks of {seconds:.0f} s")


if __name__ == "__main__":
    main()
