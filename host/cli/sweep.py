"""`swarmloc sweep`: seeds x settings x filters on many cores, resumable."""

import itertools
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

import click

from host.cli import completion, options
from host.cli.files import OutputFile, check_writable, json_option, write_json
from host.cli.terminal.layout import columns, parts
from host.cli.terminal.progress import step_bar
from host.errors import UserError
from host.experiments import trials
from host.experiments.intervals import Mean, Summary, summaries
from host.experiments.records import Records
from host.experiments.sweeping import check_installed, sweep
from host.experiments.trials import Trial
from host.sessions.offline.evaluating import check_source
from host.sessions.robot import robot_configuration

_HELP = """Score filters on every SOURCE with every seed and every combination of settings.

Each trial is kept in the output file as soon as it is done; the same command goes on where it was
interrupted. It uses all cores of this computer, or a dask scheduler that runs already, whose
workers need this version of swarmloc and see the same files. The table has the mean over the seeds
and its 95 % confidence interval (Student's t).
"""
_MOST_SEEDS = 100_000
# Key, heading with the unit, decimals, scale.
_FIGURES = (
    ("gospa_m", "GOSPA m", 4, 1.0),
    ("missed", "missed", 3, 1.0),
    ("false", "false", 3, 1.0),
    ("time_over_30cm", ">30cm %", 2, 100.0),
    ("rmse_m", "RMSE m", 4, 1.0),
    ("anees", "ANEES", 2, 1.0),
)


def _numbers(context: click.Context, option: click.Parameter, text: str) -> list[int]:
    """`1-3,7` as 1, 2, 3, 7."""
    found: list[int] = []
    for part in text.split(",") if text else ():
        first, dash, last = part.strip().partition("-")
        bounds = (first, last if dash else first)
        if not all(each.isdecimal() for each in bounds) or int(bounds[0]) > int(bounds[1]):
            raise click.BadParameter(f"{part!r} is no seed and no range of seeds, as 21-30 is.")
        if int(bounds[1]) - int(first) >= _MOST_SEEDS:
            raise click.BadParameter(f"{part!r} are more than {_MOST_SEEDS} seeds.")
        found += range(int(first), int(bounds[1]) + 1)
    return list(dict.fromkeys(found))


@click.command(
    "sweep",
    help=_HELP,
    short_help="Score filters over seeds and settings, on all cores.",
    epilog="""\b
Examples:
  swarmloc sweep arena4:seconds=60 --seeds 21-30 --output sweep.jsonl
  swarmloc sweep arena4 swarm20 --seeds 21-30 --filters phd,clairvoyant \\
      --set filter.forget_weight=0.1,0.2 --set filter.pmb.speed_mps=0.15,0.2
  swarmloc sweep arena4 --seeds 1-100 --scheduler tcp://192.168.0.7:8786""",
)
@click.argument(
    "sources",
    nargs=-1,
    required=True,
    shell_complete=completion.sources,
    metavar="SOURCE...",
)
@click.option(
    "--seeds",
    default="",
    callback=_numbers,
    metavar="SEEDS",
    help="Seeds of each scenario, e.g. 21-30 or 1,5,9.  [default: the scenario's own]",
)
@options.filters_option("phd,clairvoyant")
@options.sensors_option
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=V1,V2",
    help="Values of a robot.toml setting to try; several --set give every combination.",
)
@options.robot_or_recordings_option
@click.option(
    "--output",
    type=OutputFile(),
    default="sweep.jsonl",
    show_default=True,
    metavar="FILE",
    help="File of finished trials, one JSON object per line.",
)
@click.option("--scheduler", metavar="ADDRESS", help="A running dask scheduler to use.")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes on this computer.  [default: one per core]",
)
@json_option
@click.pass_context
def sweep_command(
    context: click.Context,
    sources: Sequence[str],
    seeds: Sequence[int],
    filters: list[str],
    sensors: list[str],
    settings: Sequence[str],
    robot_path: Path | None,
    output: Path,
    scheduler: str | None,
    workers: int | None,
    json_path: Path | None,
) -> None:
    """Run the trials that are missing, then the table; `_HELP` is what the user reads."""
    check_installed()
    every = trials.grid(
        trials.seeded(sources, seeds),
        filters,
        sensors,
        [trials.parse_setting(text) for text in settings],
        None if robot_path is None else robot_configuration(robot_path),
    )
    for trial in every:  # what is mistyped fails before anything is computed
        check_source(trial.source)
        trial.config()
    check_writable(output)
    records = Records(output)
    plugins = context.find_root().params.get("plugins", ())
    _run(every, records, output, scheduler, workers, plugins)
    found = summaries(records.of(every))
    write_json(json_path, [summary.as_json() for summary in found])
    click.echo(table(found, columns(80)))


def _run(
    every: Sequence[Trial],
    records: Records,
    output: Path,
    scheduler: str | None,
    workers: int | None,
    plugins: Sequence[str],
) -> None:
    done = len(records.of(every))
    if done:
        click.echo(f"{done} of {len(every)} trials are in {output} already", err=True)
    try:
        with step_bar("trials", len(every) - done) as step:
            sweep(every, records, step, scheduler, workers, plugins)
    except KeyboardInterrupt as interrupt:
        raise UserError(
            "the sweep was interrupted",
            f"{len(records.of(every))} of {len(every)} trials are in {output}",
            "the same command goes on from there",
        ) from interrupt


def table(found: Sequence[Summary], columns: float = math.inf) -> str:
    """The summaries, one block a source: mean ± half of the 95 % confidence interval.

    columns: of the terminal.
    """
    width = max((len(_settings(summary)) for summary in found), default=0)
    lines: list[str] = []
    for source, block in itertools.groupby(found, key=lambda summary: summary.source):
        left = [f"  {'filter':12} {'sensors':12} {'settings' if width else '':{width}}"]
        names = [f" {name:>{_width(decimals)}}" for _, name, decimals, _ in _FIGURES]
        cells = [[*names, "  n"]]
        for summary in block:
            left.append(f"  {summary.filter:12} {summary.sensors:12} {_settings(summary):{width}}")
            values = [
                f" {_cell(summary.means[key], scale, decimals):>{_width(decimals)}}"
                for key, _, decimals, scale in _FIGURES
            ]
            cells.append([*values, f" {summary.seeds:2d}"])
        lines += [source, *parts(left, cells, columns), ""]
    legend = "mean ± half of its 95 % confidence interval over n seeds"
    return "\n".join([*lines, textwrap.fill(legend, int(min(columns, 80)))])


def _settings(summary: Summary) -> str:
    return " ".join(f"{key}={value}" for key, value in summary.settings.items())


def _width(decimals: int) -> int:
    return 2 * decimals + 8


def _cell(mean: Mean, scale: float, decimals: int) -> str:
    if not math.isfinite(mean.value):
        return "-"
    half = f"{scale * mean.half_width:.{decimals}f}" if math.isfinite(mean.half_width) else "-"
    return f"{scale * mean.value:.{decimals}f} ± {half}"
