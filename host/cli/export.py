"""`swarmloc export`: recordings and ROS bags into recordings or tables."""

from pathlib import Path

import click

from host.cli import options
from host.recording.log import SUFFIX
from host.sessions.recordings.exporting import export
from host.sessions.robot import robot_configuration


@click.command(
    "export",
    short_help="A recording or ROS bag as tables or MCAP.",
    epilog=f"""\b
Examples:
  swarmloc export today{SUFFIX} today/
  swarmloc export old.swarmloc old{SUFFIX}
  swarmloc export bag:hall.bag,scan=/scan hall{SUFFIX} --robot robot.toml
  swarmloc export bag:hall/,own=/a/pose,others=/b/pose+/c/pose hall{SUFFIX}""",
)
@click.argument("source")
@click.argument("output", type=click.Path(path_type=Path))
@options.robot_or_recordings_option
@options.json_option
def export_command(
    source: str, output: Path, robot_path: Path | None, json_path: Path | None
) -> None:
    """Write what SOURCE holds into OUTPUT: a new recording, or a new folder of CSV tables.

    SOURCE is a recording, also an old .swarmloc, or bag: and a ROS bag with its topics.
    OUTPUT is a recording where it ends in .mcap.
    """
    robot = None if robot_path is None else robot_configuration(robot_path)
    with options.progress_bar() as progress:
        figures = export(source, output, robot, progress)
    options.write_json(json_path, figures)
    click.echo(options.listing(figures))
