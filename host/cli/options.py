"""The options that commands share."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from host.cli import completion
from host.cli.files import OutputFile
from host.recording.elsewhere.named_columns import units_of
from host.registry import FILTERS
from host.sessions.recordings.truth_files import TruthFile, truth_file
from host.sources.sensors import SENSORS

_UNITS = "swarmloc.truth_units"
AnyCommand = TypeVar("AnyCommand", bound=Callable[..., Any] | click.Command)


def _robot_option(default: str) -> Callable[[AnyCommand], AnyCommand]:
    return click.option(
        "--robot",
        "robot_path",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help=f"The robot's configuration, robot.toml.  [default: {default}]",
    )


robot_option = _robot_option("built-in settings")


def simulate_option(what: str, scenario: str = "arena4") -> Callable[[AnyCommand], AnyCommand]:
    """`--simulate [SCENARIO]`. what: its help; scenario: where it is given without one."""
    return click.option(
        "--simulate",
        "scenario",
        shell_complete=completion.scenarios,
        metavar="[SCENARIO]",
        is_flag=False,
        flag_value=scenario,
        help=f"{what}  [without SCENARIO: {scenario}]",
    )


robot_or_recordings_option = _robot_option("the recording's, else built-in settings")
filter_option = click.option(
    "--filter",
    "filter_name",
    shell_complete=completion.filters,
    callback=lambda context, option, name: name and several(name, FILTERS.names(), "--filter")[0],
    metavar="NAME",
    help=f"Filter to use: {', '.join(FILTERS.names())}.  [default: robot.toml's]",
)


class Number(click.FloatRange):
    """A number within bounds: no nan, and no inf."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number. Raises a usage error."""
        found = float(super().convert(value, param, ctx))
        if not math.isfinite(found):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return found


record_option = click.option(
    "--record",
    type=OutputFile(),
    metavar="FILE",
    help="Record measurements and estimates into FILE (.mcap).",
)


def filters_option(default: str) -> Callable[[AnyCommand], AnyCommand]:
    """--filters: a list of names."""
    return click.option(
        "--filters",
        shell_complete=completion.filters,
        callback=lambda context, option, names: several(names, FILTERS.names(), "--filters"),
        default=default,
        show_default=True,
        metavar="NAMES",
        help=f"Filters to score: {', '.join(FILTERS.names())}.",
    )


sensors_option = click.option(
    "--sensors",
    default="lidar+camera,lidar",
    callback=lambda context, option, names: several(names, SENSORS, "--sensors"),
    show_default=True,
    metavar="NAMES",
    help=f"Sensors to use, each choice by itself: {', '.join(SENSORS)}; data sets have their own.",
)


def truth_options(command: AnyCommand) -> AnyCommand:
    """--truth and --truth-units, together: the file of true paths, `truth` (None: without)."""
    file = click.option(
        "--truth",
        callback=_truth,
        metavar="FILE[:BODY]",
        help="True paths for a recording, from a file: an export of Motive, Vicon (CSV) or QTM "
        "(TSV), a CSV with the columns time,x,y,heading, or a ROS bag. BODY: this robot's body in "
        "it (of a bag: its topic or frame).",
    )
    units = click.option(
        "--truth-units",
        default="s,m,rad",
        show_default=True,
        is_eager=True,
        expose_value=False,
        callback=_units,
        metavar="TIME,LENGTH,ANGLE",
        help="Units of a CSV with named columns: s, ms, us or ns; m, cm or mm; rad or deg.",
    )
    return file(units(command))


def _units(context: click.Context, option: click.Parameter, text: str) -> None:
    try:
        context.meta[_UNITS] = units_of(text)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error


def _truth(context: click.Context, option: click.Parameter, text: str | None) -> TruthFile | None:
    def report(words: str) -> None:
        click.echo(words, err=True)

    return None if text is None else truth_file(text, context.meta[_UNITS], report)


def several(text: str, known: Sequence[str], option: str) -> list[str]:
    """The parts of a comma-separated option. Raises a usage error for one that is not known."""
    parts = [part.strip() for part in text.split(",")]
    for part in parts:
        if part not in known:
            raise click.BadParameter(
                f"{part!r} is not one of {', '.join(known)}.", param_hint=option
            )
    return list(dict.fromkeys(parts))
