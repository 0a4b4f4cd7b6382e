"""`swarmloc init`: a robot.toml to begin with."""

import datetime
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from host.calibration import robot_file
from host.cli.files import OutputFile, json_option, write_json
from host.config import RobotConfig, Section, load_config
from host.errors import UserError, cannot_write
from host.folders import data_folder
from host.sources.discovery import found_devices

_EXAMPLE = "robots/cherokey.toml"


def _settings(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> dict[str, Any]:
    """Values by dotted key, of KEY=VALUE; what is no TOML value is a text."""
    found: dict[str, Any] = {}
    for value in values:
        key, equals, text = value.partition("=")
        if not equals or not _is_setting(key):
            raise click.BadParameter(
                f"{value!r} is not like lidar.model=x4pro: a setting of robot.toml, and its value."
            )
        if key in found:
            raise click.BadParameter(f"{key} is set twice.")
        try:
            found[key] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            found[key] = text
    return found


def _is_setting(key: str) -> bool:
    table: Any = RobotConfig()
    for part in key.split("."):
        if not isinstance(table, Section) or part not in type(table).model_fields:
            return False
        table = getattr(table, part)
    return not isinstance(table, Section)


@click.command(
    short_help="Write a commented robot.toml.",
    epilog="""\b
Examples:
  swarmloc init
  swarmloc init left_robot.toml --find
  swarmloc init robot.toml --set name=robot1 --set lidar.model=x4pro""",
)
@click.argument("file", type=OutputFile(), default="robot.toml")
@click.option(
    "--find", is_flag=True, help="Fill in the devices that are plugged in, by their USB sockets."
)
@click.option(
    "--set",
    "settings",
    metavar="KEY=VALUE",
    multiple=True,
    callback=_settings,
    help="Change a setting, e.g. wheels.counts_per_turn=3840.",
)
@json_option
def init(file: Path, find: bool, settings: Mapping[str, Any], json_path: Path | None) -> None:
    """Write a configuration to FILE: every setting with its unit, meaning and default.

    The defaults are those of a DFRobot Cherokey. In a FILE that exists, only --find and --set
    change something.
    """
    if file.exists() and (find or settings):
        load_config(file)
        if settings:
            _with(settings, file.read_text(encoding="utf-8"), file)  # whether it can hold them
            robot_file.update(file, settings, "")
    else:
        example = (data_folder() / _EXAMPLE).read_text(encoding="utf-8")
        _write(file, _with(settings, example, file) if settings else example)
    devices = found_devices(load_config(file)) if find else {}
    if devices:
        note = f"found by swarmloc init, {datetime.date.today():%Y-%m-%d}"
        robot_file.update(file, devices, note)
    shown = {**settings, **devices}
    if "link.key" in shown:
        shown["link.key"] = "(as given)"  # a secret of those who have the file
    write_json(json_path, {"file": str(file), "settings": shown})
    for key, value in shown.items():
        click.echo(f"  {key} = {value}")
    if find and not devices:
        click.echo("no new device was found")
    click.echo("next: change what differs on your robot, and try it without hardware:")
    click.echo(f"  swarmloc run --simulate arena4 --robot {file}")
    click.echo("and on the robot (docs/bringup.md):")
    click.echo("  swarmloc flash")
    click.echo(f"  swarmloc doctor --robot {file}")


def _with(settings: Mapping[str, Any], text: str, file: Path) -> str:
    """The text of a robot.toml with these settings. Raises UserError where it cannot hold them."""
    try:
        return robot_file.updated(text, settings, "", str(file))
    except UserError as error:
        raise UserError(
            f"{file} cannot hold these settings", error.why, "correct the values of --set"
        ) from error


def _write(file: Path, text: str) -> None:
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError as error:
        raise UserError(
            f"{file} was not written",
            "it exists already",
            "name another file, move this one away first, or change it: --find, --set KEY=VALUE",
        ) from error
    except OSError as error:
        next_step = "name a file in a folder that exists and that you can write"
        raise cannot_write(file, error, next_step) from error
    click.echo(f"wrote {file}: every setting, with its unit, meaning and default")
