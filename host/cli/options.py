"""What the commands share: options, progress bars, figures as text and JSON."""

import contextlib
import json
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from host.errors import UserError
from host.recording.named_columns import units_of
from host.registry import FILTERS
from host.sessions.truth_files import TruthFile, truth_file

_UNITS = "swarmloc.truth_units"
AnyCommand = TypeVar("AnyCommand", bound=Callable[..., Any] | click.Command)


def _robot_option(default: str) -> Callable[[AnyCommand], AnyCommand]:
    return click.option(
        "--robot",
        "robot_path",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help=f"Configuration of the robot, robot.toml.  [default: {default}]",
    )


robot_option = _robot_option("a Cherokey")
robot_or_recordings_option = _robot_option("the recording's, else a Cherokey")
filter_option = click.option(
    "--filter",
    "filter_name",
    callback=lambda context, option, name: name and several(name, FILTERS.names(), "--filter")[0],
    metavar="NAME",
    help=f"Filter to use: {', '.join(FILTERS.names())}.  [default: the configuration's]",
)
json_option = click.option(
    "--json",
    "json_path",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the figures to FILE as JSON too.",
)


def truth_options(command: AnyCommand) -> AnyCommand:
    """--truth and --truth-units, together: the file of true paths, `truth` (None: without)."""
    file = click.option(
        "--truth",
        callback=_truth,
        metavar="FILE[:BODY]",
        help="True paths from another system's file, for a recording: a CSV export of Motive, or a "
        "CSV with the columns time,x,y,heading. BODY: the robot's own body in it.",
    )
    units = click.option(
        "--truth-units",
        default="s,m,rad",
        show_default=True,
        is_eager=True,
        expose_value=False,
        callback=_units,
        metavar="TIME,LENGTH,ANGLE",
        help="Units of a CSV with named columns: s ms us ns, m cm mm, rad deg.",
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


@contextlib.contextmanager
def progress_bar(label: str | None = None) -> Iterator[Callable[[float, float], None]]:
    """Gives what moves a bar on standard error: (time reached, whole duration), both in s.

    The bar appears with the first call.
    """
    with contextlib.ExitStack() as stack:
        bar: Any = None
        shown = 0.0

        def move(time: float, seconds: float) -> None:
            nonlocal bar, shown
            if bar is None:
                length = max(1, round(10.0 * seconds))
                bar = stack.enter_context(
                    click.progressbar(length=length, label=label, file=sys.stderr)
                )
            if time >= shown + 1.0:
                bar.update(round(10.0 * (time - shown)))
                shown = time

        yield move


def write_json(path: Path | None, content: object) -> None:
    """Write figures to a file; None: nowhere. Raises UserError where that fails."""
    if path is None:
        return
    try:
        path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"cannot write {path}", error.strerror or str(error), "choose another file"
        ) from error


def listing(figures: Mapping[str, Any]) -> str:
    """Figures one a line, their names aligned, in 80 columns."""
    width = max(map(len, figures), default=0)
    return "\n".join(
        textwrap.fill(
            f"  {name:{width}}  {value}",
            79,
            subsequent_indent=" " * (width + 4),
            break_on_hyphens=False,
        )
        for name, value in figures.items()
    )
