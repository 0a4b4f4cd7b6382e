"""`swarmloc doctor`: is every part of the robot alive, and what to do where one is not?"""

import contextlib
import shutil
from pathlib import Path

import click

from host.cli import options
from host.doctor.examine import examine
from host.doctor.findings import Finding, Level, in_json, table
from host.doctor.watching import SECONDS
from host.drivers.computer import Computer
from host.drivers.udev import RULES
from host.registry import SCENARIOS
from host.sessions.robot import robot_configuration
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA


@click.command(
    short_help="Is every part of the robot alive?",
    epilog="""\b
Examples:
  swarmloc doctor --robot robot.toml
  swarmloc doctor --simulate arena4
  swarmloc doctor --udev-rules | sudo tee /etc/udev/rules.d/60-swarmloc.rules""",
)
@options.robot_option
@click.option(
    "--simulate",
    "scenario",
    metavar="SCENARIO",
    help=f"Examine simulated devices: {', '.join(SCENARIOS.names())}, or as arena4:seed=1.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(1.0, 600.0),
    default=SECONDS,
    show_default=True,
    help="Watch for so long. A covered lidar window shows after 11 s.",
)
@click.option("--udev-rules", is_flag=True, help="Print the devices' udev rules, and nothing else.")
@options.json_option
@click.pass_context
def doctor(
    ctx: click.Context,
    robot_path: Path | None,
    scenario: str | None,
    seconds: float,
    udev_rules: bool,
    json_path: Path | None,
) -> None:
    """Let every device work for some seconds and say of each whether it does.

    ok, warn or FAIL, with the next step. The exit code is 1 where something failed.
    """
    if udev_rules:
        click.echo(RULES, nl=False)
        return
    robot = robot_configuration(robot_path)
    with contextlib.ExitStack() as stack:
        if scenario is None:
            rig = real_rig(robot, None)
        else:
            rig = simulated_rig(stack, robot, scenario, {}, LIDAR_AND_CAMERA)
        found = _examined(rig, seconds)
    click.echo(f"{rig.title}\n\n{table(found, shutil.get_terminal_size().columns)}\n")
    click.echo(_verdict(found))
    options.write_json(json_path, in_json(found))
    ctx.exit(any(finding.level == Level.FAIL for finding in found))


def _examined(rig: Rig, seconds: float) -> list[Finding]:
    with options.progress_bar("watching the devices") as progress:
        return examine(rig, Path.cwd(), Computer(), seconds, progress)


def _verdict(found: list[Finding]) -> str:
    failures, warnings = (
        sum(finding.level == level for finding in found) for level in (Level.FAIL, Level.WARN)
    )
    if not failures and not warnings:
        return "all is well"
    return f"{failures} failed, {warnings} to be warned of: start with the first"
