"""`swarmloc record`: recordings that were cut short, made whole."""

from pathlib import Path

import click

from host.cli.files import OutputFile, json_option, write_json
from host.recording.log import SUFFIX
from host.recording.repair import repair


@click.command(
    short_help="Repair a recording that was cut short.",
    epilog=f"""\b
Example:
  swarmloc record --repair today{SUFFIX}""",
)
@click.option(
    "--repair",
    "damaged",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Copy everything readable into a new file, compressed and with an index.",
)
@click.option(
    "--output",
    type=OutputFile(),
    metavar="FILE",
    help=f"The new file.  [default: today.repaired{SUFFIX} for today{SUFFIX}]",
)
@json_option
def record(damaged: Path | None, output: Path | None, json_path: Path | None) -> None:
    """Repair a recording that was cut short or is damaged, into a new file.

    To make a recording: swarmloc run --record FILE.
    """
    if damaged is None:
        raise click.UsageError("give --repair FILE; to record a run: swarmloc run --record FILE")
    repaired = repair(damaged, output or damaged.with_suffix(f".repaired{SUFFIX}"))
    figures = {
        "recording": f"{repaired.output}: {repaired.fault}",
        "messages": repaired.messages,
        "records": repaired.records,
    }
    write_json(json_path, figures)
    click.echo(f"{repaired.output}: {repaired.messages} messages; {repaired.fault}")
