"""Identities in MR.CLAM: each robot names the others by their odometry; barcodes are truth."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from host.geometry import to_frame
from host.messages import Displacement, FloatArray, Positions
from host.recording.elsewhere.mrclam import DRIVEN_LATER_S, Dataset, Landmarks
from host.systems.id_phd.id_phd import IdPhd
from host.systems.id_phd.printed import PrintedIdPhd
from host.systems.id_phd.scoring import Sample, figures, samples
from host.systems.id_phd.settings import IdPhdSettings

# By what the robots and their camera are; none was chosen by a dataset's figures. Misses are
# correlated, so a frame without a reading says less than its share of misses: hence .1 for .2.
SETTINGS = IdPhdSettings(
    detection=0.1,
    half_view_rad=math.radians(30.0),
    reach_m=4.0,
    clutter=0.003,
    restart=0.02,
    alike=3.0,
    gain_sigmas=(0.1, 0.2, 0.2),
    false_things=0,
)
_LANDMARKS_IN_VIEW = 6
_FROM_S = 60.0  # scored from then on, every second,
_SEEN_WITHIN_S = 5.0  # each teammate that was read within that time
_ODOMETRY_S = 0.11  # a reading waits for the odometry of its time, which comes every 0.1 s

Event = tuple[float, int, Displacement | Positions]


def mrclam_identities(
    dataset: Dataset, landmarks: Landmarks, variant: str = "id_phd", until_s: float = math.inf
) -> dict[str, float]:
    """Figures of all five observers together. variant: "id_phd", "printed" or "barcodes"."""
    found = [
        sample
        for observer in dataset.robots
        for sample in observer_samples(dataset, observer, landmarks, variant, until_s)
    ]
    return figures(found)


def observer_samples(
    dataset: Dataset,
    observer: int,
    landmarks: Landmarks = "drop",
    variant: str = "id_phd",
    until_s: float = math.inf,
) -> list[Sample]:
    """What one robot believed of those it had seen lately, against Vicon."""
    settings = replace(
        SETTINGS,
        known=variant == "barcodes",
        false_things=_LANDMARKS_IN_VIEW if landmarks == "clutter" else 0,
    )
    localizer = PrintedIdPhd(settings) if variant == "printed" else IdPhd(settings)
    last_read = {robot: -math.inf for robot in dataset.robots if robot != observer}
    found: list[Sample] = []
    due = _FROM_S
    for arrival, robot, message in _events(dataset, observer, landmarks):
        if arrival > until_s:
            break
        if arrival >= due:
            due += 1.0
            if dataset.has_vicon(localizer.time):
                lately = [r for r, t in last_read.items() if arrival - t <= _SEEN_WITHIN_S]
                truth = _truth(dataset, observer, localizer.time)
                found += samples(localizer.beliefs(), truth, lately)
        if isinstance(message, Positions):
            localizer.update(message)
            read = set() if message.identities is None else set(message.identities.tolist())
            last_read.update(dict.fromkeys(read & last_read.keys(), message.time))
        elif robot == observer:
            localizer.drive(message)
        else:
            localizer.hear(robot, message)
    return found


def _events(dataset: Dataset, observer: int, landmarks: Landmarks) -> Iterator[Event]:
    """Everybody's odometry and what the observer reads, as they reach it."""
    events: list[Event] = [
        (message.time + _ODOMETRY_S, observer, message)
        for message in dataset.messages(observer, landmarks)
        if isinstance(message, Positions)
    ]
    for robot in dataset.robots:
        for step in dataset.motion(robot):
            later = step.time + DRIVEN_LATER_S
            events.append((later, robot, replace(step, time=later)))
    yield from sorted(events, key=lambda event: event[0])


def _truth(dataset: Dataset, observer: int, time: float) -> dict[int, FloatArray]:
    own = dataset.pose(observer, time)
    poses = {robot: dataset.pose(robot, time) for robot in dataset.robots if robot != observer}
    return {
        robot: np.array([*to_frame(pose[None, :2], own)[0], pose[2] - own[2]])
        for robot, pose in poses.items()
    }
