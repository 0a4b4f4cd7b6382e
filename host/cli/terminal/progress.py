"""Progress bars on standard error."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any

import click


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
