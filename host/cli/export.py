"""`swarmloc export`: recordings and ROS bags into recordings or tables."""

from pathlib import Path

import click

from host.cli import completion, options
from host.cli.files import json_option, write_json
from host.cli.terminal.progress import progress_bar
from host.cli.terminal.summary import written
from host.recording.log import SUFFIX
from host.sessions.recordings.exporting import export
from host.sessions.robot import robot_configuration


@click.command(
    "export",
    short_help="Convert a recording or ROS bag to CSV or MCAP.",
    epilog=f"""\b
Examples:
  swarmloc export today{SUFFIX} today/
  swarmloc export old.swarmloc old{SUFFIX}
  swarmloc export bag:hall.bag,scan=/scan hall{SUFFIX} --robot robot.toml
  swarmloc export bag:hall/,own=/a/pose,others=/b/pose+/c/pose hall{SUFFIX}""",
)
@click.argument("source", shell_complete=completion.sources)
@click.argument("output", type=click.Path(path_type=Path))
@options.robot_or_recordings_option
@json_option
def export_command(
    source: str, output: Path, robot_path: Path | None, json_path: Path | None
) -> None:
    """Convert SOURCE to OUTPUT: a recording if it ends in .mcap, else a folder of CSV tables.

    SOURCE is a recording (.mcap or the older .swarmloc), or bag:PATH of a ROS bag with its topics.
    """
    robot = None if robot_path is None else robot_configuration(robot_path)
    with progress_bar() as progress:
        figures = export(source, output, robot, progress)
    write_json(json_path, figures)
    click.echo(written(figures))
