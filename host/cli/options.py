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
from host.registry import FILTERS

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
