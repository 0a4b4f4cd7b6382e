"""Squares driven both ways, and how far from their starts they ended."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from host.behaviour.interface import STILL, Behaviour, Command, Situation
from host.behaviour.square import Square
from host.calibration.gathered import Gathered
from host.config import RobotConfig
from host.drivers.natnet.client import MOCAP
from host.errors import UserError
from host.geometry import to_frame
from host.messages import FloatArray
from host.sessions.driving import driving_of
from host.sessions.gathering import with_mocap
from host.sessions.running import never, run_devices
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_ONLY

_FRAMES = 20  # of motion capture, before the robot leaves
_EVERY_S = 0.1


class Once:
    """A behaviour that begins when `ready()`; until then the robot stands."""

    def __init__(self, behaviour: Behaviour, ready: Callable[[], bool]) -> None:
        self._behaviour, self._ready, self._began = behaviour, ready, False

    def command(self, now: Situation) -> Command | None:
        """What the behaviour wants, once it has begun."""
        self._began = self._began or self._ready()
        return self._behaviour.command(now) if self._began else STILL


def square_rig(stack: contextlib.ExitStack, robot: RobotConfig, scenario: str | None) -> Rig:
    """The devices for it: lidar, wheels and, where there is one, motion capture."""
    if scenario is None:
        return real_rig(robot, LIDAR_ONLY)
    return simulated_rig(stack, robot, with_mocap(scenario), {}, LIDAR_ONLY, driven=True)


def drive_square(
    rig: Rig,
    side_m: float,
    left: bool,
    *,
    record: Path | None = None,
    stopped: Callable[[], bool] = never,
    watch: Callable[[str], None],
) -> Gathered:
    """Once around; what the devices delivered. watch: told ten times a second why it stands.

    Raises UserError where it did not come around.
    """
    gathered = Gathered(rig.config)
    tracked = MOCAP in rig.sources
    square = Once(Square(side_m, left), lambda: not tracked or len(gathered.bodies) >= _FRAMES)
    driving = driving_of(rig, square)
    driving.stopped = stopped
    outcome = run_devices(
        rig,
        {"square": gathered.take},
        record=record,
        stopped=lambda: driving.done or stopped(),
        watch=lambda: watch(driving.safety.halt),
        watch_every_s=_EVERY_S,
        driver=driving,
    )
    for error in outcome.failures.values():
        raise error
    if not driving.done:
        raise UserError("the square is not complete", "it was stopped", "run it again")
    return gathered


def return_error(gathered: Gathered) -> FloatArray:
    """True place at the end less that by the wheels (x, y) m, in the frame of the start.

    Raises UserError where the robot was not tracked.
    """
    tracks = gathered.tracks()
    begin, end = tracks.span
    # It stands at both ends; in the middle of a second of it.
    times = np.array([begin + 0.05, end - 0.05])
    true, by_wheels = tracks.own(times), gathered.path().poses(times)
    return np.subtract(_moved(true), _moved(by_wheels))


def _moved(poses: FloatArray) -> FloatArray:
    place: FloatArray = to_frame(poses[1:, :2], poses[0])[0]
    return place


def as_rows(errors: Sequence[FloatArray]) -> FloatArray:
    """Errors of several runs (n, 2) m."""
    return np.asarray(errors, dtype=float).reshape(-1, 2)
