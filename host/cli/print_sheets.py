"""`swarmloc print`: what is printed on paper and put on robots."""

from pathlib import Path

import click

from host.cli.files import OutputFile, check_writable, json_option, write_json
from host.cli.options import robot_option
from host.perception.strips.sheet import PAPERS_MM, strip_sheet
from host.sessions.robot import robot_configuration


@click.group(name="print", short_help="Draw a teammate's strip to print.")
def print_group() -> None:
    """Draw sheets to print."""


@print_group.command(
    epilog="""\b
Examples:
  swarmloc print strip
  swarmloc print strip --robot robot.toml --paper A3 --output strip.svg""",
)
@robot_option
@click.option(
    "--paper",
    type=click.Choice(sorted(PAPERS_MM, reverse=True)),
    default="A4",
    show_default=True,
    help="Paper, landscape.",
)
@click.option(
    "--output",
    type=OutputFile(),
    default=Path("strip.svg"),
    show_default=True,
    metavar="FILE",
    help="SVG file to write.",
)
@json_option
def strip(robot_path: Path | None, paper: str, output: Path, json_path: Path | None) -> None:
    """Draw the strip that a teammate wears, to scale, by [camera.strip] of robot.toml.

    Print it in colour on matt paper at 100 %: its ruler must be 100 mm long.
    """
    worn = robot_configuration(robot_path).camera.strip
    sheet = strip_sheet(worn, paper)
    check_writable(output)
    output.write_text(sheet, encoding="utf-8")
    write_json(json_path, {"output": str(output), "paper": paper, "strip": worn.model_dump()})
    click.echo(f"wrote {output}: a strip for one robot, {1000 * worn.diameter_m:g} mm thick")
    click.echo("open it in a browser and print it in colour on matt paper at 100 %, not fitted to")
    click.echo("the page; then measure its ruler: 100 mm (docs/cameras.md)")
