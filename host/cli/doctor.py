"""`swarmloc doctor`: is every part of the robot alive, and what to do where one is not?"""

import contextlib
import datetime
from collections.abc import Mapping
from pathlib import Path

import click

from host.calibration import robot_file
from host.cli import options
from host.cli.files import json_option, write_json
from host.cli.terminal.layout import terminal_columns
from host.cli.terminal.progress import progress_bar
from host.doctor.examine import examine
from host.doctor.findings import Finding, Level, in_json, table
from host.doctor.spin import Spin
from host.doctor.watching import SECONDS
from host.drivers.computer import Computer
from host.drivers.romeo.device import Romeo
from host.drivers.udev import RULES
from host.errors import UserError
from host.registry import SCENARIOS
from host.sessions.robot import robot_configuration
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA


@click.command(
    short_help="Check every device of the robot.",
    epilog="""\b
Examples:
  swarmloc doctor --robot robot.toml
  swarmloc doctor --simulate
  swarmloc doctor --udev-rules | sudo tee /etc/udev/rules.d/60-swarmloc.rules""",
)
@options.robot_option
@options.simulate_option(
    f"Examine simulated devices: {', '.join(SCENARIOS.names())}; settings as in arena4:seed=1."
)
@click.option(
    "--seconds",
    type=options.Number(1.0, 600.0),
    default=SECONDS,
    show_default=True,
    help="How long to watch. A covered lidar window is found after 11 s.",
)
@click.option(
    "--spin",
    is_flag=True,
    help="Also drive the wheels, to find reversed motors and encoders; asks first.",
)
@click.option("--yes", is_flag=True, help="Answer every question with yes.")
@click.option("--udev-rules", is_flag=True, help="Only print the devices' udev rules.")
@json_option
@click.pass_context
def doctor(
    ctx: click.Context,
    robot_path: Path | None,
    scenario: str | None,
    seconds: float,
    spin: bool,
    yes: bool,
    udev_rules: bool,
    json_path: Path | None,
) -> None:
    """Watch every device for some seconds: ok, warn or FAIL, each with the next step.

    The exit code is 1 if something failed.
    """
    if udev_rules:
        if json_path is not None:
            raise click.UsageError("--udev-rules only prints: leave --json out")
        click.echo(RULES, nl=False)
        return
    robot = robot_configuration(robot_path)
    with contextlib.ExitStack() as stack:
        if scenario is None:
            rig = real_rig(robot, None)
        else:
            rig = simulated_rig(stack, robot, scenario, {}, LIDAR_AND_CAMERA, driven=spin)
        wheels = _spin(rig, yes) if spin else None
        with progress_bar("watching the devices") as progress:
            examined = examine(rig, Path.cwd(), Computer(), seconds, progress, wheels)
    found = examined.findings
    write_json(json_path, in_json(found))
    click.echo(f"{rig.title}\n\n{table(found, terminal_columns())}\n")
    click.echo(_verdict(found))
    if robot_path is not None and examined.settings:
        _write(robot_path, examined.settings, yes)
    ctx.exit(any(finding.level == Level.FAIL for finding in found))


def _spin(rig: Rig, yes: bool) -> Spin:
    """What drives the wheels, once the user agrees. Raises UserError where nothing can."""
    board = rig.sources["board"]
    if not isinstance(board, Romeo):
        raise UserError(
            "--spin cannot drive this robot",
            "its board's driver takes no commands",
            "leave --spin out",
        )
    if not yes:
        click.confirm(
            "Each wheel turns for a second, then the robot rotates to both sides. Is it on the "
            "floor, with half a metre around it?",
            abort=True,
        )
    return Spin(board.command, rig.config)


def _write(path: Path, settings: Mapping[str, bool], yes: bool) -> None:
    lines = "\n".join(f"  {key} = {str(value).lower()}" for key, value in settings.items())
    click.echo(f"to be changed in {path}:\n{lines}")
    if yes or click.confirm("Write it?"):
        note = f"swarmloc doctor --spin, {datetime.date.today():%Y-%m-%d}"
        robot_file.update(path, settings, note)
        click.echo(f"wrote {path}; run the same command again to see that it is right")


def _verdict(found: list[Finding]) -> str:
    failures, warnings = (
        sum(finding.level == level for finding in found) for level in (Level.FAIL, Level.WARN)
    )
    if not failures and not warnings:
        return "every check passed"
    plural = "" if warnings == 1 else "s"
    return f"{failures} failed, {warnings} warning{plural}: start with the first one"
