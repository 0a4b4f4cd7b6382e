"""Where a calibration's data come from: a recording, a scenario, or the robot as it drives."""

import contextlib
import shutil
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path

import click

from host.calibration.gathered import Gathered
from host.cli import options
from host.cli.signals import signals_caught
from host.errors import UserError
from host.estimator import profiles
from host.localizer import Localizer
from host.messages import Health, Message
from host.pipeline import Pipeline, Sink
from host.recording.log import Recorder, Recording, RecordingHeader
from host.sessions.runs import find, read_as
from host.simulation.offline import Simulation
from host.simulation.world import scenarios
from host.sources.rig import MOCAP, Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA

_LOOK_S = 1.0
_MOCAP_HZ = 100

Advice = Callable[[Gathered], list[str]]


def with_mocap(scenario: str) -> str:
    """The scenario as written, with motion capture where it sets none."""
    if scenarios.parse(scenario).mocap_hz or "mocap_hz" in scenarios.settings(scenario):
        return scenario
    return f"{scenario}{',' if ':' in scenario else ':'}mocap_hz={_MOCAP_HZ}"


def from_source(source: str, robot_path: Path | None) -> Gathered:
    """What a recording holds, or what a scenario gives at full speed.

    A recording is read as if taken with the configuration in `robot_path`, else with its own.
    """
    found = find(source)
    if isinstance(found, Recording):
        config = found.header.config if robot_path is None else options.robot(robot_path)
        gathered = Gathered(config)
        for message in read_as(found, config):
            gathered.take(message)
        if found.torn:
            click.echo(f"{source}: its last line is torn, the run was cut short", err=True)
        return gathered
    simulation = Simulation(scenarios.parse(with_mocap(source)), options.robot(robot_path))
    gathered = Gathered(simulation.config)
    with click.progressbar(
        length=round(simulation.scenario.seconds), label=source, file=sys.stderr
    ) as bar:
        for message in simulation.messages():
            gathered.take(message)
            if message.time >= bar.pos + 1.0:
                bar.update(1)
    return gathered


def live(
    robot_path: Path | None,
    scenario: str | None,
    seconds: float | None,
    record: Path,
    advice: Advice,
    mocap_needed: bool,
) -> tuple[str, Gathered]:
    """What the devices say until a signal or for `seconds`, and their name.

    Meanwhile the screen tells what is still missing. Raises UserError where there is no motion
    capture and it is needed.
    """
    robot = options.robot(robot_path)
    with contextlib.ExitStack() as stack:
        if scenario is None:
            rig = real_rig(robot, None)
        else:
            rig = simulated_rig(stack, robot, with_mocap(scenario), {}, LIDAR_AND_CAMERA)
        if mocap_needed and MOCAP not in rig.sources:
            raise UserError(
                "there is no motion capture to calibrate against",
                'source is "none" in [mocap] of robot.toml',
                "name it there (docs/calibration.md), or try --simulate misbuilt4",
            )
        gathered = Gathered(rig.config)
        _drive(rig, gathered, seconds, record, advice)
    return rig.title, gathered


def _drive(
    rig: Rig, gathered: Gathered, seconds: float | None, record: Path, advice: Advice
) -> None:
    health: dict[str, Health] = {}
    mocap = MOCAP in rig.sources

    def note(message: Message) -> None:
        if isinstance(message, Health):
            health[message.device] = message

    sinks: dict[str, Sink] = {"calibration": gathered.take, "screen": note}
    localizer = Localizer(rig.config, profiles.make(rig.config.filter.profile, rig.config))
    with contextlib.ExitStack() as stack:
        recorder = Recorder(record, RecordingHeader(rig.config, rig.sensors, rig.scenario))
        sinks["recording"] = stack.enter_context(recorder).write
        click.echo(f"{rig.title}: drive the robot; Ctrl-C ends and fits", err=True)
        begin = time.monotonic()
        pipeline = Pipeline(localizer, rig.sources, sinks, rig.truth)
        with signals_caught() as signalled, pipeline:
            while not (signalled() or pipeline.stop.is_set()):
                passed = time.monotonic() - begin
                if seconds is not None and passed >= seconds:
                    break
                time.sleep(_LOOK_S if seconds is None else min(_LOOK_S, seconds - passed))
                waiting = mocap and not gathered.bodies
                _tell(time.monotonic() - begin, list(health.values()), gathered, advice, waiting)
        if sys.stderr.isatty():
            click.echo(err=True)
    # What was driven is fitted nevertheless: the verdict tells whether it will do.
    for name, error in pipeline.failures.items():
        why = "; ".join(str(error).splitlines()) or type(error).__name__
        click.echo(f"{name} ended before its time: {why}", err=True)


def _tell(
    passed: float, health: list[Health], gathered: Gathered, advice: Advice, waiting: bool
) -> None:
    """One line: the time, a device that is down, or what the drive still lacks.

    waiting: for the first frame of motion capture.
    """
    down = [each for each in health if not each.ok and each.device != "localizer"]
    if down:
        said = f"{down[0].device}: " + "; ".join(down[0].reason.splitlines())
    elif waiting:
        said = "waiting for motion capture"
    else:
        try:
            missing = advice(gathered)
        except UserError as error:
            missing = str(error).splitlines()
        said = "; ".join(missing) if missing else "enough: Ctrl-C ends and fits"
    line = f"{passed:5.0f} s  {said}"
    if sys.stderr.isatty():
        # What is written over must not be wrapped.
        line = textwrap.shorten(line, shutil.get_terminal_size().columns - 1, placeholder=" ...")
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)
    else:
        click.echo(line, err=True)
