"""`swarmloc run`: the robot's devices, or simulated ones, to teammates on the screen."""

import contextlib
import ipaddress
import math
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from host.cli import options
from host.cli.console import FRAME_S, LINE_S, Console, State
from host.cli.signals import signals_caught
from host.cli.summary import summary
from host.errors import UserError
from host.pipeline import Sink
from host.registry import SCENARIOS
from host.sessions import systemd
from host.sessions.robot import robot_configuration
from host.sessions.running import RunOutcome, run_devices
from host.simulation.live import Interval
from host.simulation.world import scenarios
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA, SENSORS
from host.viewer.scene import Scene
from host.viewer.server import Viewer

NO_VIEW = ("", 0)
JOURNAL_S = 60.0  # between two lines of a service


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


def _address(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[str, int] | None:
    """(address, port) of ADDRESS:PORT, NO_VIEW of "none"; None where nothing is given."""
    if value is None:
        return None
    if value == "none":
        return NO_VIEW
    address, _, port = value.rpartition(":")
    try:
        return str(ipaddress.ip_address(address.strip("[]"))), int(port)
    except ValueError:
        raise click.BadParameter(
            f"{value!r} is not like 127.0.0.1:8737 or [::1]:8737, and not none."
        ) from None


@click.command(
    short_help="Teammates on the screen, live.",
    epilog="""\b
Examples:
  swarmloc run --simulate arena4
  swarmloc run --simulate arena4 --seconds 10 --unplug lidar=2-5
  swarmloc run --robot robot.toml --record today.swarmloc""",
)
@options.robot_option
@click.option(
    "--simulate",
    "scenario",
    metavar="SCENARIO",
    help=f"Simulate the devices: {', '.join(SCENARIOS.names())}, or as arena4:seed=1,robots=6.",
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
@click.option(
    "--view",
    metavar="ADDRESS:PORT",
    callback=_address,
    help="Where to serve the live page: 0.0.0.0:8737 shares it with who has the printed address; "
    "none serves none.  [default: this computer alone, 127.0.0.1:8737 or a free port]",
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
    view: tuple[str, int] | None,
    filter_name: str | None,
    json_path: Path | None,
) -> None:
    """Show where the teammates are, until Ctrl-C or for --seconds, then a summary."""
    if unplug and scenario is None:
        raise click.UsageError("--unplug needs --simulate: a real device is unplugged by hand")
    robot = robot_configuration(robot_path, filter_name)
    with contextlib.ExitStack() as stack:
        if scenario is None:
            rig = real_rig(robot, sensors)
        else:
            rig = simulated_rig(stack, robot, scenario, unplug, sensors or LIDAR_AND_CAMERA)
            if seconds is None and "seconds" in scenarios.settings(scenario):
                seconds = scenarios.parse_scenario(scenario).seconds
        viewer = _viewer(rig, view)
        viewers = {}
        if viewer is not None:
            viewers["page"] = stack.enter_context(viewer)
            for camera in rig.cameras:
                camera.watchers.append(viewer.show)
        outcome = _show_run(rig, seconds, record, viewers)
    click.echo(summary(outcome.figures))
    options.write_json(json_path, outcome.figures)
    for name, error in outcome.failures.items():
        if isinstance(error, UserError):
            raise error
        raise RuntimeError(f"the {name} failed ({type(error).__name__}: {error})") from error
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
            "do what the summary says of them, or try it without: swarmloc run --simulate arena4",
        )


def _viewer(rig: Rig, view: tuple[str, int] | None) -> Viewer | None:
    """The server of the live page; None where none is wanted. Raises UserError."""
    scene = Scene(rig.config, rig.config.filter.profile, [camera.name for camera in rig.cameras])
    if view == NO_VIEW:
        return None
    if view is not None:
        return Viewer(scene, *view)
    try:
        return Viewer(scene)
    except UserError:  # another run has the port
        return Viewer(scene, port=0)


def _show_run(
    rig: Rig, seconds: float | None, record: Path | None, viewers: Mapping[str, Viewer]
) -> RunOutcome:
    """Run with the teammates on the screen, until a signal, for `seconds` or until a failure."""
    title = rig.title if record is None else f"{rig.title}   recording {record.name}"
    page = "".join(viewer.url for viewer in viewers.values())
    state = State(title, rig.config.filter.profile, rig.sensors, page)
    service = systemd.of_environment(rig.sources)
    console = Console(state, sys.stdout, line_s=LINE_S if service is None else JOURNAL_S)
    sinks: dict[str, Sink] = {} if service is None else {"systemd": service.take}
    # Signals are caught until the devices are left in good order.
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.closing(console))
        if service is not None:
            stack.enter_context(contextlib.closing(service))
        signalled = stack.enter_context(signals_caught())
        return run_devices(
            rig,
            sinks,
            {"screen": console, **viewers},
            seconds=seconds,
            record=record,
            stopped=signalled,
            watch=console.draw,
            watch_every_s=FRAME_S,
        )
