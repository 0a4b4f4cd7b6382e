"""`swarmloc init`: a robot.toml to begin with."""

from pathlib import Path

import click

from host.errors import UserError
from host.folders import data_folder

_EXAMPLE = "robots/cherokey.toml"


@click.command(
    short_help="A commented robot.toml to begin with.",
    epilog="""\b
Examples:
  swarmloc init
  swarmloc init left_robot.toml""",
)
@click.argument("file", type=click.Path(path_type=Path), default="robot.toml")
def init(file: Path) -> None:
    """Write the configuration of a Cherokey to FILE, robot.toml by default.

    It holds every setting with its unit, its meaning and its default value. A FILE that exists
    is left as it is.
    """
    text = (data_folder() / _EXAMPLE).read_text(encoding="utf-8")
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError as error:
        raise UserError(
            f"{file} was not written",
            "it exists already",
            "name another file, or move this one away first",
        ) from error
    except OSError as error:
        raise UserError(
            f"cannot write {file}",
            error.strerror or str(error),
            "name a file in a folder that exists and that you can write",
        ) from error
    click.echo(f"wrote {file}: every setting of a robot, with its unit and its default value")
    click.echo("next: change what differs on your robot, then try it without hardware:")
    click.echo(f"  swarmloc run --simulate arena4 --robot {file}")
    click.echo("and on the robot (docs/hardware.md: wiring and first power-up):")
    click.echo("  swarmloc flash")
    click.echo(f"  swarmloc run --robot {file}")
