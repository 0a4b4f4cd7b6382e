"""The files that commands write: checked before the work; figures as JSON."""

import functools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from host.errors import UserError, cannot_write
from host.sessions.recordings.truth_files import TruthFile

AnyFunction = TypeVar("AnyFunction", bound=Callable[..., Any])


class OutputFile(click.Path):
    """A file to be written, as a type of options: no folder, and no "-" for standard output."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, dir_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path. Raises a usage error."""
        if str(value) in ("", "-"):
            self.fail(f"{str(value)!r} names no file; standard output: /dev/stdout", param, ctx)
        return super().convert(value, param, ctx)


def check_writable(path: Path) -> None:
    """Raise UserError where a file that is to be written cannot be."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise UserError(
            f"cannot write {path}",
            f"there is no folder {path.parent}",
            "make that folder, or choose another file",
        )
    if path.is_fifo():  # to open it would wait for its reader, and to close it end that
        return
    existed = path.exists()
    try:  # a test that asks for permissions alone misses a full disk, /dev/full and /proc
        with path.open("ab") as file:
            if not existed or path.is_char_device():
                file.write(b"\n")
    except OSError as error:
        raise cannot_write(path, error, "choose another file") from error
    if not existed:
        path.resolve().unlink()  # not a link to it


def _checked(context: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
    if path is not None:  # at once: after the work it would be too late
        check_writable(path)
    return path


def json_option(command: AnyFunction) -> AnyFunction:
    """--json FILE. Whatever else the command writes is checked, too: no file serves for two."""

    @functools.wraps(command)
    def checked(**options: Any) -> Any:
        _check_apart(click.get_current_context())
        return command(**options)

    option = click.option(
        "--json",
        "json_path",
        type=OutputFile(),
        callback=_checked,
        metavar="FILE",
        help="Also write the results to FILE as JSON.",
    )
    return option(checked)  # type: ignore[return-value]


def _check_apart(context: click.Context) -> None:
    """Raise a usage error where a file to be written is also read, or written twice."""
    parameters = context.command.params
    named = [
        (parameter, path)
        for parameter in parameters
        for path in _paths(context.params.get(parameter.name or ""))
    ]
    for output, path in named:
        if not isinstance(output.type, OutputFile) or path.is_char_device():
            continue
        for other, same in named:
            if other is not output and os.path.realpath(path) == os.path.realpath(same):
                raise click.UsageError(
                    f"{_shown(output)} and {_shown(other)} are one file ({path}): it would be lost"
                )


def _shown(parameter: click.Parameter) -> str:
    name = parameter.opts[0]
    return name if isinstance(parameter, click.Option) else name.upper()


def _paths(value: Any) -> Iterator[Path]:
    """The files that an option's value may name, also as in bag:FILE,scan=TOPIC."""
    match value:
        case Path():
            yield value
        case TruthFile():
            yield value.path
        case str():
            yield from map(Path, (value, value.partition(":")[2].partition(",")[0]))
        case tuple() | list():
            for part in value:
                yield from _paths(part)


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
