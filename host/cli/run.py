"""`swarmloc run`: the robot's devices, or simulated ones, to teammates on the screen."""

import contextlib
import math
import re
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from host.cli import options
from host.cli.console import FRAME_S, Console, State
from host.cli.signals import signals_caught
from host.cli.tally import Tally, summary, timing
from host.errors import UserError
from host.estimator import profiles
from host.evaluation.runner import Timed
from host.localizer import Localizer
from host.pipeline import Pipeline, Sink
from host.recording.log import Recorder, RecordingHeader
from host.simulation.live import Interval
from host.simulation.world import scenarios
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA, SENSORS

_TIMED_UPDATES = 100_000  # the last ones, of an hour or more: a run may go on for days


def _intervals(
    ctx: click.Context, param: click.Parameter, values: Sequence[str]
) -> dict[str, list[Interval]]:
    """Intervals (s since the start) by device, of DEVICE=FROM-TO; without TO it stays away."""
    absent: dict[str, list[Interval]] = {}
    for value in values:
        device, _, interval = value.partition("=")
        begin, dash, end = interval.partition("-")
        try:
            times = float(begin), float(end) if end else math.inf
        except ValueError:
            times = (math.nan, math.nan)
        if not (device and dash and 0.0 <= times[0] < times[1]):
            raise click.BadParameter(f"{value!r} is not like lidar=2-4 (seconds since the start).")
        absent.setdefault(device, []).append(times)
    return absent


@click.command(
    short_help="Teammates on the screen, live.",
    epilog="""\b
Examples:
  swarmloc run --simulate arena4
  swarmloc run --simulate arena4 --seconds 10 --unplug lidar=2-5
  swarmloc run --robot robots/cherokey.toml --record today.swarmloc""",
)
@options.robot_option
@click.option(
    "--simulate",
    "scenario",
    metavar="SCENARIO",
    help=f"Simulate the devices: {', '.join(scenarios.KNOWN)}, or as arena4:seed=1,robots=6.",
)
@click.option(
    "--unplug",
    metavar="DEVICE=FROM-TO",
    multiple=True,
    callback=_intervals,
    help="Leave a simulated device out for some seconds, as lidar=2-4 or board=3-.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.1),
    help="End after so long.  [default: seconds of SCENARIO where it sets them, else never]",
)
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Record what was measured and estimated (FILE ends in .swarmloc).",
)
@click.option(
    "--sensors",
    type=click.Choice(SENSORS),
    help="Sensors to use besides the wheels.  [default: those there are]",
)
@options.filter_option
@options.json_option
def run(
    robot_path: Path | None,
    scenario: str | None,
    unplug: Mapping[str, Sequence[Interval]],
    seconds: float | None,
    record: Path | None,
    sensors: str | None,
    filter_name: str | None,
    json_path: Path | None,
) -> None:
    """Show where the teammates are, until Ctrl-C or for --seconds, then a summary."""
    if unplug and scenario is None:
        raise click.UsageError("--unplug needs --simulate: a real device is unplugged by hand")
    robot = options.robot(robot_path, filter_name)
    with contextlib.ExitStack() as stack:
        if scenario is None:
            rig = real_rig(robot, sensors)
        else:
            rig = simulated_rig(stack, robot, scenario, unplug, sensors or LIDAR_AND_CAMERA)
            if seconds is None and "seconds" in scenarios.settings(scenario):
                seconds = scenarios.parse(scenario).seconds
        figures, failures = _run(rig, seconds, record)
    click.echo(summary(figures))
    options.write_json(json_path, figures)
    for name, error in failures.items():
        if isinstance(error, UserError):
            raise error
        raise RuntimeError(f"the {name} failed ({type(error).__name__}: {error})") from error
    _check_measured(figures)


def _check_measured(figures: Mapping[str, Any]) -> None:
    """Raise UserError where nothing was estimated because devices are down."""
    down = [
        f"{name}: {re.split(r'; |$', device['reason'], maxsplit=1, flags=re.MULTILINE)[0]}"
        for name, device in figures["devices"].items()
        if not device["ok"]
    ]
    if down and not figures["updates"]:
        raise UserError(
            "nothing was measured",
            "; ".join(down),
            "do what the summary says of them, or try it without: swarmloc run --simulate arena4",
        )


def _run(
    rig: Rig, seconds: float | None, record: Path | None
) -> tuple[dict[str, Any], dict[str, Exception]]:
    """Run until a signal, for `seconds` or until a failure; return figures and failures."""
    update_seconds: deque[float] = deque(maxlen=_TIMED_UPDATES)
    profile = rig.config.filter.profile
    localizer = Localizer(rig.config, Timed(profiles.make(profile, rig.config), update_seconds))
    tally, title = Tally(), rig.title
    with contextlib.ExitStack() as stack:
        sinks: dict[str, Sink] = {"summary": tally.take}
        if record is not None:
            header = RecordingHeader(rig.config, rig.sensors, rig.scenario)
            recorder = stack.enter_context(Recorder(record, header))
            sinks["recording"] = recorder.write
            title += f"   recording {record.name}"
        console = Console(State(title, profile, rig.sensors), sys.stdout)
        stack.callback(console.close)
        sinks["screen"] = console.take
        begin, begin_cpu = time.monotonic(), time.process_time()
        pipeline = Pipeline(localizer, rig.sources, sinks, rig.truth)
        # Signals are caught until the devices are left in good order.
        with signals_caught() as signalled, pipeline:
            while not (signalled() or pipeline.stop.is_set()):
                left = begin + (seconds or math.inf) - time.monotonic()
                if left <= 0.0:
                    break
                console.draw()
                time.sleep(min(FRAME_S, left))
        wall, cpu = time.monotonic() - begin, time.process_time() - begin_cpu
        console.draw()
    figures = {
        "seconds": round(wall, 1),
        **tally.figures(),
        "updates_per_s": round(tally.estimates / wall, 1),
        **timing(update_seconds),
        "cpu_share_of_one_core": round(cpu / wall, 2),
        "devices": tally.devices(),
    }
    if rig.simulated_board is not None:
        figures["simulated_board"] = rig.simulated_board
    return figures, pipeline.failures
