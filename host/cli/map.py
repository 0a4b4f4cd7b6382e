"""`swarmloc map`: the room as the lidar saw it, without the teammates that drove through it."""

from pathlib import Path

import click
import cv2

from host.cli import completion, options
from host.cli.files import OutputFile, check_writable, json_option, write_json
from host.registry import FILTERS
from host.sessions.offline.mapping import map_source
from host.sessions.robot import robot_configuration


@click.command(
    "map",
    short_help="Draw a map of the room without the teammates.",
    epilog="""\b
Examples:
  swarmloc map today.mcap room.png
  swarmloc map arena4:seed=1,seconds=60,standing=1 room.png""",
)
@click.argument("source", shell_complete=completion.sources)
@click.argument("output", type=OutputFile())
@click.option(
    "--filter",
    "filter_name",
    default="pmb",
    show_default=True,
    type=click.Choice(FILTERS.names()),
    metavar="NAME",
    help="Filter that locates the teammates.",
)
@click.option(
    "--cell",
    "cell_m",
    default=0.05,
    show_default=True,
    type=options.Number(0.01, 1.0),
    metavar="M",
    help="Side of a cell (one pixel), m.",
)
@options.robot_or_recordings_option
@json_option
def map_command(
    source: str,
    output: Path,
    filter_name: str,
    cell_m: float,
    robot_path: Path | None,
    json_path: Path | None,
) -> None:
    """Draw an occupancy grid of SOURCE, a recording or a scenario, from lidar and odometry.

    OUTPUT (PNG) has no teammates in it; OUTPUT-with-teammates.png has. White is free, black
    occupied, grey not seen. For a scenario, wrong cells are counted.
    """
    if output.suffix != ".png":
        raise click.UsageError(f"a map is written as .png: {output.with_suffix('.png')}")
    pictures = {output: "without", output.with_stem(f"{output.stem}-with-teammates"): "with"}
    for path in pictures:
        check_writable(path)
    robot = None if robot_path is None else robot_configuration(robot_path)
    mapper, wrong = map_source(source, filter_name, cell_m, robot)
    for path, which in pictures.items():
        grid = mapper.cleared if which == "without" else mapper.whole
        path.write_bytes(bytes(cv2.imencode(".png", grid.picture())[1]))
        click.echo(f"{which} teammates: {path}")
    write_json(json_path, {name: each.as_json() for name, each in wrong.items()})
    for name, each in wrong.items():
        click.echo(
            f"{name}: {each.wrong} of {each.known} cells are wrong: {each.false} occupied where "
            f"nothing stands, {each.lost} free where something does"
        )
