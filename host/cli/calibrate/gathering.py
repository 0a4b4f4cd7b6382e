"""The screen while a calibration's data come in: a bar for a source, a line for a drive."""

import contextlib
import textwrap
import time
from pathlib import Path

import click

from host.behaviour.survey import Survey
from host.calibration import chain
from host.calibration.gathered import Gathered
from host.cli.terminal.layout import terminal_columns
from host.cli.terminal.progress import progress_bar, stderr
from host.cli.terminal.signals import signals_caught
from host.errors import one_line
from host.sessions.calibrating.gathering import (
    Advice,
    DriveWatch,
    calibration_rig,
    gather_source,
)
from host.sessions.live.driving import driving_of
from host.sessions.live.running import run_devices
from host.sessions.recordings.truth_files import TruthFile
from host.sessions.robot import robot_configuration

_LOOK_EVERY_S = 1.0


def from_source(source: str, robot_path: Path | None, truth: TruthFile | None = None) -> Gathered:
    """What a recording holds, or what a scenario gives at full speed.

    A recording is read as if taken with the configuration in `robot_path`, else with its own.
    truth: in place of the recording's own.
    """
    robot = None if robot_path is None else robot_configuration(robot_path)

    def warn(text: str) -> None:
        click.echo(text, err=True)

    with progress_bar(source) as progress:
        gathered = gather_source(source, robot, progress, warn, truth)
    gathered.chain = chain.load(robot_path)
    return gathered


def live(
    robot_path: Path | None,
    scenario: str | None,
    seconds: float | None,
    record: Path,
    advice: Advice,
    mocap_needed: bool,
    drives: bool = False,
) -> tuple[str, Gathered]:
    """What the devices deliver until a signal or for `seconds`, and their name.

    Meanwhile the screen shows what is still missing. drives: the robot drives itself, until nothing
    is. Raises UserError where there is no motion
    capture and it is needed.
    """
    robot = robot_configuration(robot_path)
    with contextlib.ExitStack() as stack:
        rig = calibration_rig(stack, robot, scenario, mocap_needed, drives)
        drive = DriveWatch(rig, advice)
        survey = Survey()
        driving = driving_of(rig, survey) if drives else None
        what = "drives by itself" if drives else "drive the robot"
        click.echo(f"{rig.title}: {what}; press Ctrl-C to end and fit", err=True)
        begin = time.monotonic()

        def look() -> None:
            _show(time.monotonic() - begin, drive)
            if not drive.lacking():
                survey.end()

        with signals_caught() as signalled:
            if driving is not None:
                driving.stopped = signalled
            outcome = run_devices(
                rig,
                {"calibration": drive.gathered.take, "screen": drive.note},
                seconds=seconds,
                record=record,
                stopped=lambda: signalled() or (driving is not None and driving.done),
                watch=look,
                watch_every_s=_LOOK_EVERY_S,
                driver=driving,
            )
        if stderr.isatty():
            click.echo(err=True)
    # What was driven is fitted in any case: the verdict shows whether it is enough.
    for name, error in outcome.failures.items():
        why = one_line(str(error)) or type(error).__name__
        click.echo(f"{name} ended before its time: {why}", err=True)
    drive.gathered.chain = chain.load(robot_path)
    return rig.title, drive.gathered


def _show(seconds: float, drive: DriveWatch) -> None:
    """One line: the time, a device that is down, or what the drive still lacks."""
    text = "; ".join(drive.missing()) or "enough data: press Ctrl-C to fit"
    line = f"{seconds:5.0f} s  {text}"
    if stderr.isatty():
        # What is written over must not be wrapped.
        line = textwrap.shorten(line, terminal_columns() - 1, placeholder=" ...")
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)
    else:
        click.echo(line, err=True)
