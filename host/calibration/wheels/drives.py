"""A robot's messages → drives to calibrate its wheels by, and what a drive still lacks."""

import itertools

import numpy as np

from host.calibration.coverage import missing_rotations
from host.calibration.gathered import Gathered
from host.calibration.wheels.model import Drive
from host.calibration.wheels.verdict import BIN_S, LEAST_TURN_RAD, LEAST_WAY_M
from host.errors import UserError
from host.recording.elsewhere.optiodom import OptiodomRun

_HOLE_S = 0.1  # ticks of a longer gap are lost
_MARGIN_S = 1.0  # truth that goes with a drive whose stamps are late or early


def drives_of(gathered: Gathered) -> list[Drive]:
    """What calibration needs of a robot's messages: a drive for each stretch without a hole.

    Raises UserError where there are no ticks, or motion capture never saw the robot's body.
    """
    steps = [step for step in gathered.displacements if step.ticks is not None]
    if not steps:
        raise UserError(
            "there are no wheel ticks to calibrate with",
            "the board sent no displacement, or the recording was made without ticks",
            "check the board with `swarmloc run`, and record again",
        )
    tracks = gathered.tracks()
    body = gathered.config.mocap.body
    stamps = gathered.own_times
    seen = np.unique(stamps)
    truth = tracks.body(body, seen)
    known = np.isfinite(truth).all(axis=1)
    begins = [step.time - step.interval for step in steps]
    holes = [k for k in range(1, len(steps)) if begins[k] - steps[k - 1].time > _HOLE_S]
    drives = []
    for first, last in itertools.pairwise([0, *holes, len(steps)]):
        part = steps[first:last]
        times = np.array([begins[first], *(step.time for step in part)])
        ticks = np.cumsum([(0, 0), *(step.ticks for step in part if step.ticks)], axis=0)
        within = known & (seen >= times[0] - _MARGIN_S) & (seen <= times[-1] + _MARGIN_S)
        name = f"drive from {times[0]:.1f} s" if holes else "drive"
        drives.append(
            Drive(times, ticks.astype(np.int64), seen[within], truth[within], name, stamps)
        )
    return drives


def drive_of_run(run: OptiodomRun) -> Drive:
    """A recorded run as a drive."""
    return Drive(run.times, run.ticks, run.truth_times, run.truth, run.name)


def wheels_advice(gathered: Gathered) -> list[str]:
    """What is still missing while the robot drives; empty when enough was driven.

    By the wheels as configured, so it costs little: it is asked for every second.
    """
    if not gathered.bodies:
        return ["motion capture has not sent a frame yet"]
    body = gathered.config.mocap.body
    if not any(body in frame.identities for frame in gathered.bodies[-200:]):
        return [f"motion capture does not see body {body}: is it the robot's, and in view?"]
    steps = [(step.time, step.dx, step.dpsi) for step in gathered.displacements if step.ticks]
    if not steps:
        return ["no wheel ticks have come yet: drive"]
    times, ways, rotations = np.array(steps).T
    bins = ((times - times[0]) / BIN_S).astype(np.int64)
    rotated = np.bincount(bins, rotations).astype(float)
    way = np.abs(ways).sum()
    missing = []
    if way < LEAST_WAY_M:
        missing.append(f"drive further than {LEAST_WAY_M:.0f} m: {way:.1f} m so far")
    # A little more than the least, for the wheels are not known yet.
    missing += missing_rotations(rotated, 1.2 * LEAST_TURN_RAD)
    straight = np.abs(np.bincount(bins, ways))[np.abs(rotated) < 0.2].sum()
    if straight < 0.05 * way:
        missing.append(f"drive straight on for a while: {straight:.1f} m of {way:.1f} m so far")
    return missing
