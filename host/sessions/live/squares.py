"""Squares driven in both directions, and their return errors."""

import contextlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from host.behaviour.interface import STILL, Behaviour, Command, Situation
from host.behaviour.safety import IN_THE_WAY
from host.behaviour.square import Square
from host.calibration.gathered import Gathered
from host.config import RobotConfig
from host.drivers.natnet.client import MOCAP
from host.errors import UserError
from host.geometry import to_frame
from host.messages import FloatArray
from host.sessions.calibrating.gathering import with_mocap
from host.sessions.live.driving import driving_of
from host.sessions.live.running import never, run_devices
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_ONLY

_FRAMES = 20  # of motion capture, before the robot leaves
_EVERY_S = 0.1
PATIENCE_S = 15.0  # with what stops it: somebody walks away, a wall does not


class Once:
    """A behaviour that starts when `ready()`; until then the robot stands still."""

    def __init__(self, behaviour: Behaviour, ready: Callable[[], bool]) -> None:
        self._behaviour, self._ready, self._began = behaviour, ready, False

    def command(self, now: Situation) -> Command | None:
        """The behaviour's command, once it has started."""
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
    """Drive once around; returns the messages. watch: called with why the robot stands, 10 Hz.

    Raises UserError where it did not come around: it was stopped, or has stood for PATIENCE_S.
    """
    gathered = Gathered(rig.config)
    tracked = MOCAP in rig.sources
    square = Once(Square(side_m, left), lambda: not tracked or len(gathered.bodies) >= _FRAMES)
    driving = driving_of(rig, square)
    driving.stopped = stopped
    standing = Standing()

    def look() -> None:
        halt = driving.safety.halt
        standing.note(halt, time.monotonic())
        watch(halt)

    outcome = run_devices(
        rig,
        {"square": gathered.take},
        record=record,
        stopped=lambda: driving.done or stopped() or standing.seconds > PATIENCE_S,
        watch=look,
        watch_every_s=_EVERY_S,
        driver=driving,
    )
    for error in outcome.failures.values():
        raise error
    if driving.done:
        return gathered
    if stopped():
        raise UserError("the square is not complete", "it was stopped", "run it again")
    space = f"give it {side_m:g} m to its side and half a metre around, or choose a smaller --side"
    raise UserError(
        "the square is not complete",
        f"the robot stood for {PATIENCE_S:.0f} s: {standing.halt}",
        space if standing.halt == IN_THE_WAY else "swarmloc doctor names the device and why",
    )


class Standing:
    """How long the robot has been standing, and why."""

    def __init__(self) -> None:
        self.halt, self.seconds, self._since = "", 0.0, 0.0

    def note(self, halt: str, now: float) -> None:
        """halt: why it stands, "" while it drives; now: s."""
        if not self.halt or not halt:
            self._since = now
        self.halt, self.seconds = halt, now - self._since


def return_error(gathered: Gathered) -> FloatArray:
    """True place at the end less that by the wheels (x, y) m, in the frame of the start.

    Raises UserError if the robot was not tracked, or not at its start or end.
    """
    tracks = gathered.tracks()
    begin, end = tracks.span
    # It stands at both ends; in the middle of a second of it.
    times = np.array([begin + 0.05, end - 0.05])
    true, by_wheels = tracks.own(times), gathered.path().poses(times)
    if not np.all(np.isfinite(true)):
        raise UserError(
            "the square has no return error",
            "motion capture did not see the robot at its start or its end",
            "run it again; if it repeats, swarmloc doctor checks motion capture and this computer",
        )
    return np.subtract(_moved(true), _moved(by_wheels))


def _moved(poses: FloatArray) -> FloatArray:
    place: FloatArray = to_frame(poses[1:, :2], poses[0])[0]
    return place


def as_rows(errors: Sequence[FloatArray]) -> FloatArray:
    """Errors of several runs (n, 2) m."""
    return np.asarray(errors, dtype=float).reshape(-1, 2)
