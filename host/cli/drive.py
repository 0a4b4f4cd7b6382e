"""`swarmloc drive`: the robot, or a simulated one, driven by keys or by a behaviour."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from host.behaviour import catalogue
from host.behaviour.interface import Behaviour
from host.behaviour.keys import HELP, Keys
from host.behaviour.stick import Stick
from host.cli import options
from host.cli.calibrate import gathering
from host.cli.calibrate.fitting import drive_name
from host.cli.drive_square import square
from host.cli.files import json_option, write_json
from host.cli.terminal.gamepad import HOLD, find, gamepad_read
from host.cli.terminal.keyboard import keys_read
from host.cli.terminal.live_screen import check_failures, show_run, view_option, viewer_at
from host.cli.terminal.summary import summary
from host.config import RobotConfig
from host.registry import BEHAVIOURS
from host.sessions.live.driving import contacts_in_words, drive_rig, driving_of
from host.sessions.robot import robot_configuration

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., Any])


simulate_option = options.simulate_option("Drive a simulated robot.")


def drive_options(command: AnyFunction) -> AnyFunction:
    """The options that all ways to drive share."""
    choices = [
        options.robot_option,
        simulate_option,
        click.option(
            "--seconds",
            type=options.Number(0.1),
            help="Stop after this time, s.  [default: never]",
        ),
        options.record_option,
        view_option,
        json_option,
    ]
    for choice in reversed(choices):
        command = choice(command)
    return command


class KeysByDefault(click.Group):
    """Without a command it is `keys`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put the default command in front where none is named."""
        if not args or (args[0].startswith("-") and args[0] not in ("-h", "--help")):
            args = ["keys", *args]
        return super().parse_args(ctx, args)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Also one for each behaviour that has none of its own, those of plugins among them."""
        known = super().get_command(ctx, cmd_name)
        if known is not None or cmd_name not in BEHAVIOURS.names():
            return known

        @click.command(cmd_name, help=f"Drive by the behaviour {cmd_name!r}.")
        @drive_options
        def behave(**common: Any) -> None:
            _drive(lambda robot: catalogue.make(cmd_name, robot), **common)

        return behave


@click.group(
    cls=KeysByDefault,
    short_help="Drive the robot: keys, gamepad, square, random walk.",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="""\b
Examples:
  swarmloc drive --simulate
  swarmloc drive walk --robot robot.toml""",
)
def drive() -> None:
    """Drive the robot; without a command, by keys.

    It stops before walls and teammates, and when a sensor it needs is lost (docs/driving.md).
    """


drive.add_command(square)


@drive.command(
    epilog="""\b
Example:
  swarmloc drive keys --simulate"""
)
@drive_options
def keys(**common: Any) -> None:
    """Drive while a key is held: w/s, a/d, q/e, z/c; x ends."""
    driver = Keys()

    def press(key: str, time: float) -> None:
        if key in ("x", "\x03", "\x04"):
            driver.end()
        driver.press(key, time)

    with keys_read(press, driver.end):
        click.echo(HELP)
        _drive(lambda robot: driver, **common)


@drive.command(
    epilog="""\b
Example:
  swarmloc drive gamepad --robot robot.toml"""
)
@click.option(
    "--device",
    metavar="PATH",
    help="The gamepad, e.g. /dev/input/event5.  [default: the first one]",
)
@drive_options
def gamepad(device: str | None, **common: Any) -> None:
    """Drive by a gamepad while L1 or R1 is held; Ctrl-C ends."""
    stick = Stick()
    with gamepad_read(find(device), stick):
        click.echo(HOLD)
        _drive(lambda robot: stick, **common)


@drive.command(
    epilog="""\b
Example:
  swarmloc drive walk --simulate --seconds 60"""
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the random walk.",
)
@drive_options
def walk(seed: int, **common: Any) -> None:
    """Drive a random walk around obstacles, until Ctrl-C or for --seconds."""
    _drive(lambda robot: catalogue.make("walk", robot, seed), **common)


@drive.command(
    epilog="""\b
Example:
  swarmloc drive formation circle --simulate arena4 --seconds 30"""
)
@click.argument("name", metavar="NAME", type=click.Choice(sorted(catalogue.FORMATIONS)))
@drive_options
def formation(name: str, **common: Any) -> None:
    """Take a place in a formation with the teammates (docs/behaviours.md).

    For a whole simulated swarm: swarmloc simulate formation6.
    """
    _drive(lambda robot: catalogue.make(name, robot), **common)


@drive.command(
    epilog="""\b
Example:
  swarmloc drive calibration --simulate misbuilt4 --record drive.mcap"""
)
@options.robot_option
@simulate_option
@click.option(
    "--seconds",
    type=options.Number(1.0),
    default=180.0,
    show_default=True,
    help="Stop after this time, s, even if data are missing.",
)
@options.record_option
@json_option
def calibration(
    robot_path: Path | None,
    scenario: str | None,
    seconds: float,
    record: Path | None,
    json_path: Path | None,
) -> None:
    """Record the drive that `swarmloc calibrate` needs, within the free space.

    It ends when there is enough data for wheels, lidar and cameras.
    """
    # The fits' rooms are slow to load, and no other way to drive needs them.
    from host.sessions.calibrating.calibrate import drive_advice

    record = record or drive_name()
    gathering.live(robot_path, scenario, seconds, record, drive_advice, True, drives=True)
    write_json(json_path, {"recording": str(record)})
    click.echo(f"recorded in {record}; next: swarmloc calibrate wheels {record} --robot robot.toml")


def _drive(
    behaviour_of: Callable[[RobotConfig], Behaviour],
    robot_path: Path | None,
    scenario: str | None,
    seconds: float | None,
    record: Path | None,
    view: tuple[str, int] | None,
    json_path: Path | None,
) -> None:
    robot = robot_configuration(robot_path)
    with contextlib.ExitStack() as stack:
        rig = drive_rig(stack, robot, scenario)
        driving = driving_of(rig, behaviour_of(rig.config))
        viewer = viewer_at(rig, view)
        viewers = {} if viewer is None else {"page": stack.enter_context(viewer)}
        outcome = show_run(rig, seconds, record, viewers, driving)
        contacts = contacts_in_words(rig)
    write_json(json_path, outcome.figures)
    click.echo(summary(outcome.figures))
    if contacts:
        click.echo(contacts)
    check_failures(outcome)
