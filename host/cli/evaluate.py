"""`swarmloc evaluate`: filters against truth, as rows of figures."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import click

from host.cli import completion, options
from host.cli.files import json_option, write_json
from host.cli.terminal.layout import columns
from host.cli.terminal.progress import step_bar
from host.cli.terminal.table import systems_table, table
from host.evaluation.metrics import CUT_OFF_M, MRCLAM_CUT_OFF_M
from host.evaluation.truth_scoring import RANGE_M
from host.experiments.results_folder import ResultsFolder
from host.sessions.offline.evaluating import check_source, score_sources, step_count
from host.sessions.recordings.truth_files import TruthFile
from host.sessions.robot import robot_configuration
from host.systems.catalogue import SYSTEMS, is_system_source, score_systems

_HELP = f"""Score filters on each SOURCE: a recording, a scenario or a dataset.

A scenario is written as arena4:seconds=120,seed=1; several seeds of one scenario are also pooled. A
data set is mrclam:FOLDER,landmarks=drop or clutter. Scored are teammates within {RANGE_M:g} m, at
every scan; the cut-off of errors is {CUT_OFF_M:g} m ({MRCLAM_CUT_OFF_M:g} m in the data set).
"""

_NO_PICTURES = """\
only CSV files were written: the pictures need matplotlib, which is not installed
install it: pip install 'swarmloc[figures]'"""


@click.command(
    help=_HELP,
    short_help="Score filters against truth.",
    epilog="""\b
Examples:
  swarmloc evaluate arena4:seed=1 arena4:seed=2 --filters pmb,clairvoyant
  swarmloc evaluate today.mcap --json figures.json
  swarmloc evaluate today.mcap --truth take.csv:Robot1
  swarmloc evaluate swarm20:seconds=300 --figures results
  swarmloc evaluate mrclam:MRCLAM_Dataset6,landmarks=drop --systems all
  swarmloc evaluate swarm:robots=20,seed=1""",
)
@click.argument(
    "sources",
    nargs=-1,
    required=True,
    shell_complete=completion.sources,
    metavar="SOURCE...",
)
@options.filters_option("perera2021,phd,pmb,clairvoyant")
@options.sensors_option
@click.option(
    "--systems",
    metavar="NAMES",
    help=f"Related works to score, too: all, {', '.join(SYSTEMS)} (docs/systems.md). "
    "They add the sources swarm:robots=5,seed=1 and intruder:robots=6,seed=1.",
)
@options.robot_or_recordings_option
@options.truth_options
@json_option
@click.option(
    "--figures",
    "figures_path",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write error curves (CSV, SVG, PNG) to a new folder in DIR (docs/experiments.md).",
)
def evaluate(
    sources: Sequence[str],
    filters: list[str],
    sensors: list[str],
    systems: str | None,
    robot_path: Path | None,
    truth: TruthFile | None,
    json_path: Path | None,
    figures_path: Path | None,
) -> None:
    """Score filters on each source; `_HELP` is what the user reads."""
    robot = None if robot_path is None else robot_configuration(robot_path)
    if truth is not None and len(sources) > 1:
        raise click.UsageError("--truth is of one recording: name one SOURCE")
    others = _systems(systems, sources)
    every, sources = sources, [source for source in sources if not is_system_source(source)]
    for source in sources:  # what is mistyped fails before anything is computed
        check_source(source)
    folder = None
    if figures_path is not None:
        asked = {"sources": list(sources), "filters": filters, "sensors": sensors}
        folder = ResultsFolder(figures_path, datetime.now(), asked)
        if not folder.draw:
            click.echo(_NO_PICTURES, err=True)
    size = step_count(sources, filters, sensors)
    with step_bar("evaluating", size) as step:
        keep = (lambda scored: None) if folder is None else folder.take
        rows = score_sources(sources, filters, sensors, robot, step, keep, truth)
    compared = list(score_systems(every, others))
    write_json(json_path, [row.as_json() for row in rows] + [row.as_json() for row in compared])
    if rows:
        click.echo(table(rows, columns(80)))
    if compared:
        click.echo(systems_table(compared, columns(80)))
    if folder is not None:
        folder.take_systems(compared)
        folder.finish(rows)
        click.echo(f"figures: {folder.path}")


def _systems(asked: str | None, sources: Sequence[str]) -> list[str]:
    """The systems to score: those asked for, all on a source that only they can use."""
    if asked == "all" or (asked is None and any(map(is_system_source, sources))):
        return list(SYSTEMS)
    return [] if asked is None else options.several(asked, list(SYSTEMS), "--systems")
