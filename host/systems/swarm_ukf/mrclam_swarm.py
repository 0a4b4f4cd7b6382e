"""The five robots of MR.CLAM as a swarm that reports to one place: barcodes are identities."""

import heapq
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from host.messages import Displacement, FloatArray, Positions
from host.recording.elsewhere.mrclam import DRIVEN_LATER_S, Dataset
from host.systems.swarm_ukf.joint_map import Neighbours
from host.systems.swarm_ukf.scoring import Event, SwarmScore, score_swarm
from host.systems.swarm_ukf.swarm import SwarmSettings, SwarmUkf

# The logged velocities are commands, driven at gains of 0.71 to 0.98.
_GAIN_SIGMAS = (0.1, 0.2)
_ALIKE_READINGS = 3.0  # readings of successive pictures share errors: each counts as a third


def mrclam_score(
    dataset: Dataset, neighbours: Neighbours = "joint", until_s: float = math.inf
) -> SwarmScore:
    """The dataset up to `until_s`, scored against Vicon every second in which it saw all robots."""
    settings = SwarmSettings(gain_sigmas=_GAIN_SIGMAS, neighbours=neighbours)
    robots = sorted(dataset.robots)

    def truth(time: float) -> FloatArray:
        return np.array([dataset.pose(robot, time) for robot in robots])

    start, end = dataset.span
    grid = [start + second for second in range(1, int(min(end, until_s) - start) + 1)]
    instants = [time for time in grid if dataset.has_vicon(time)]
    return score_swarm(SwarmUkf(len(robots), settings), _events(dataset), instants, truth)


def _events(dataset: Dataset) -> Iterator[Event]:
    """What all robots report, in order of time; robots numbered from 0."""
    streams = [
        sorted(((row, _report(m)) for m in dataset.messages(robot, "drop")), key=_time)
        for row, robot in enumerate(sorted(dataset.robots))
    ]
    return heapq.merge(*streams, key=_time)


def _report(message: Displacement | Positions) -> Displacement | Positions:
    if isinstance(message, Displacement):
        return replace(message, time=message.time + DRIVEN_LATER_S)
    identities = message.identities
    return replace(
        message,
        covariances=_ALIKE_READINGS * message.covariances,
        identities=None if identities is None else identities - 1,
    )


def _time(event: Event) -> float:
    return event[1].time
