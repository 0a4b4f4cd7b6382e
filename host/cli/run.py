"""`swarmloc run`: the robot's devices, or simulated ones, to teammates on the screen."""

import contextlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from host.behaviour.stick import Stick
from host.cli import options
from host.cli.files import json_option, write_json
from host.cli.terminal.live_screen import (
    NO_VIEW,
    check_failures,
    foxglove_option,
    show_run,
    view_option,
    viewer_at,
)
from host.cli.terminal.summary import summary
from host.errors import UserError
from host.registry import SCENARIOS
from host.sessions.live.driving import driving_of
from host.sessions.robot import robot_configuration
from host.simulation.live import Interval
from host.simulation.world import scenarios
from host.simulation.world.settings import settings
from host.sources.rig import real_rig, simulated_rig
from host.sources.sensors import CAMERA_ONLY, LIDAR_AND_CAMERA, SENSORS
from host.viewer.foxglove_server import FoxgloveServer
from host.viewer.server import Viewer


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
    short_help="Show the teammates live.",
    epilog="""\b
Examples:
  swarmloc run --simulate arena4
  swarmloc run --simulate arena4 --seconds 10 --unplug lidar=2-5
  swarmloc run --robot robot.toml --record today.mcap""",
)
@options.robot_option
@options.simulate_option(
    f"Simulate the devices: {', '.join(SCENARIOS.names())}; settings as in arena4:seed=1,robots=6."
)
@click.option(
    "--unplug",
    metavar="DEVICE=FROM-TO",
    multiple=True,
    callback=_intervals,
    help="Unplug a simulated device for some seconds, e.g. lidar=2-4, board=3- or camera=5-8.",
)
@click.option(
    "--seconds",
    type=options.Number(0.1),
    help="Stop after this time, s.  [default: the scenario's seconds if given, else never]",
)
@options.record_option
@click.option(
    "--pictures",
    is_flag=True,
    help="With --record: also record the cameras' pictures (megabytes per second).",
)
@click.option(
    "--sensors",
    type=click.Choice(SENSORS),
    help="Sensors to use besides the wheels.  [default: all in robot.toml]",
)
@view_option
@click.option(
    "--drive",
    "drives",
    is_flag=True,
    help="Drive by a stick on the live page; its address then has a token.",
)
@foxglove_option
@options.filter_option
@json_option
def run(
    robot_path: Path | None,
    scenario: str | None,
    unplug: Mapping[str, Sequence[Interval]],
    seconds: float | None,
    record: Path | None,
    pictures: bool,
    sensors: str | None,
    view: tuple[str, int] | None,
    drives: bool,
    foxglove: tuple[str, int] | None,
    filter_name: str | None,
    json_path: Path | None,
) -> None:
    """Show where the teammates are, on the screen and a web page, until Ctrl-C or --seconds."""
    if pictures and record is None:
        raise click.UsageError("--pictures needs --record: without it, the live page shows them")
    if unplug and scenario is None:
        raise click.UsageError("--unplug needs --simulate: a real device is unplugged by hand")
    if drives and view == NO_VIEW:
        raise click.UsageError("--drive needs the live page: leave --view none out")
    if drives and sensors == CAMERA_ONLY:
        raise click.UsageError("--drive needs the lidar, which stops the robot before walls")
    robot = robot_configuration(robot_path, filter_name)
    with contextlib.ExitStack() as stack:
        if scenario is None:
            rig = real_rig(robot, sensors)
        else:
            wanted = sensors or LIDAR_AND_CAMERA
            rig = simulated_rig(stack, robot, scenario, unplug, wanted, driven=drives)
            if seconds is None and "seconds" in settings(scenario):
                seconds = scenarios.parse_scenario(scenario).seconds
        rig = replace(rig, record_pictures=pictures)
        stick = Stick() if drives else None
        driving = driving_of(rig, stick) if stick is not None else None
        viewer = viewer_at(rig, view, stick)
        viewers: dict[str, Viewer | FoxgloveServer] = {}
        if viewer is not None:
            viewers["page"] = stack.enter_context(viewer)
        if foxglove is not None:
            viewers["foxglove"] = stack.enter_context(FoxgloveServer(rig.config, *foxglove))
        outcome = show_run(rig, seconds, record, viewers, driving)
    write_json(json_path, outcome.figures)
    click.echo(summary(outcome.figures))
    check_failures(outcome)
    _check_measured(outcome.figures)


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
            "do what the summary says, or try it without a robot: swarmloc run --simulate arena4",
        )
