"""What the commands share: options, progress bars, figures as text and JSON."""

import contextlib
import json
import math
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from host.cli import completion
from host.errors import UserError, cannot_write
from host.recording.elsewhere.named_columns import units_of
from host.registry import FILTERS
from host.sessions.recordings.truth_files import TruthFile, truth_file

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


def check_writable(path: Path) -> None:
    """Raise UserError where a file that is to be written cannot be."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise UserError(
            f"cannot write {path}",
            f"there is no folder {path.parent}",
            "make that folder, or choose another file",
        )
    existed = path.exists()
    try:  # a test that asks for permissions alone misses a full disk, /dev/full and /proc
        with path.open("ab") as file:
            if not existed or path.is_char_device():
                file.write(b"\n")
    except OSError as error:
        raise cannot_write(path, error, "choose another file") from error
    if not existed:
        path.unlink()


def _checked(context: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
    if path is not None:  # at once: after the work it would be too late
        check_writable(path)
    return path


json_option = click.option(
    "--json",
    "json_path",
    type=click.Path(path_type=Path, dir_okay=False),
    callback=_checked,
    metavar="FILE",
    help="Also write the results to FILE as JSON.",
)


class Seconds(click.FloatRange):
    """Seconds on the command line: a number from `least` on, and no nan or inf."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number. Raises a usage error."""
        found = float(super().convert(value, param, ctx))
        if not math.isfinite(found):
            self.fail(f"{value} is not a number of seconds.", param, ctx)
        return found


class _Stderr:
    """Standard error, as progress bars need it: what cannot be shown is no failure of the work.

    A terminal that is gone, or that cannot move its cursor (TERM=dumb), shows no bar.
    """

    def write(self, text: str) -> int:
        """Write, where that is possible."""
        with contextlib.suppress(OSError):
            sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, where that is possible."""
        with contextlib.suppress(OSError):
            sys.stderr.flush()

    def isatty(self) -> bool:
        """Whether a bar can be drawn."""
        return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


stderr: Any = _Stderr()


def truth_options(command: AnyCommand) -> AnyCommand:
    """--truth and --truth-units, together: the file of true paths, `truth` (None: without)."""
    file = click.option(
        "--truth",
        callback=_truth,
        metavar="FILE[:BODY]",
        help="True paths for a recording, from a file: a CSV export of Motive, a CSV with the "
        "columns time,x,y,heading, or a ROS bag. BODY: this robot's body in it (of a bag: its "
        "topic or frame).",
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


def columns(unknown: float = math.inf) -> float:
    """How wide the terminal is, or COLUMNS says; without both, `unknown`."""
    known = sys.stdout.isatty() or os.environ.get("COLUMNS", "")
    return shutil.get_terminal_size().columns if known else unknown


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
                    click.progressbar(length=length, label=label, file=stderr)
                )
            if time >= shown + 1.0:
                bar.update(round(10.0 * (time - shown)))
                shown = time

        yield move


@contextlib.contextmanager
def step_bar(label: str, length: int) -> Iterator[Callable[[str], None]]:
    """Gives what counts a step that is done, by its name: a bar on standard error.

    Where that is no terminal, each tenth of the steps has a line.
    """
    done = 0

    def count(name: str) -> None:
        nonlocal done
        done += 1
        if done * 10 // length > (done - 1) * 10 // length:
            click.echo(f"{label} {done} of {length}: {name}", err=True)

    if not stderr.isatty():
        yield count
        return
    with click.progressbar(
        length=length, label=label, item_show_func=lambda name: name or "", file=stderr
    ) as bar:
        yield lambda name: bar.update(1, name)


def write_json(path: Path | None, content: Mapping[str, Any] | Sequence[Any]) -> None:
    """Write figures to a file; None: nowhere. Where that fails, the command does after its work.

    Numbers that are not finite are null. All commands have one envelope: schema, its version, the
    command, and its `rows` (a list) or its `result`. To be called before the screen is written to:
    that may be gone.
    """
    if path is None:
        return
    context = click.get_current_context()
    kind = "result" if isinstance(content, Mapping) else "rows"
    whole = {"schema": "swarmloc.figures", "version": 1, "command": _name(context), kind: content}
    try:
        text = json.dumps(_finite(whole), indent=1, allow_nan=False) + "\n"
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        failure = cannot_write(path, error, "choose another file")

        def fail() -> None:
            raise failure

        context.call_on_close(fail)


def _name(context: click.Context) -> str:
    """The command's name without that of the program, however that was started."""
    if context.parent is None:
        return ""
    return f"{_name(context.parent)} {context.info_name}".strip()


def _finite(content: Any) -> Any:
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def listing(figures: Mapping[str, Any]) -> str:
    """Figures one a line, their names aligned, in 80 columns or as many as there are."""
    most = int(min(columns(), 80)) - 1
    width = max(map(len, figures), default=0)
    return "\n".join(
        textwrap.fill(
            f"  {name:{width}}  {value}",
            most,
            subsequent_indent=" " * min(width + 4, most // 2),
            break_on_hyphens=False,
        )
        for name, value in figures.items()
    )
