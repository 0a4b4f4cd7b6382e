"""`swarmloc`: the commands, and how their failures reach the user."""

import errno
import importlib
import io
import os
import sys
from typing import Any

import click

from host.cli.terminal.signals import signals_end, signals_interrupt
from host.errors import UserError
from host.registry import load_plugin

_OUTPUT_FAILED = (errno.ENOSPC, errno.EIO)  # a full disk; a terminal that is gone
_COMMANDS = {
    "init": "host.cli.init:init",
    "doctor": "host.cli.doctor:doctor",
    "run": "host.cli.run:run",
    "drive": "host.cli.drive:drive",
    "simulate": "host.cli.simulate:simulate",
    "record": "host.cli.record:record",
    "replay": "host.cli.replay:replay",
    "export": "host.cli.export:export_command",
    "map": "host.cli.map:map_command",
    "evaluate": "host.cli.evaluate:evaluate",
    "sweep": "host.cli.sweep:sweep_command",
    "flash": "host.cli.flash:flash_command",
    "calibrate": "host.cli.calibrate.calibrate:calibrate",
    "print": "host.cli.print_sheets:print_group",
}


class Failure(click.ClickException):
    """A failure in words on standard error, exit code 1."""

    def show(self, file: Any = None) -> None:
        """Print it."""
        click.echo(f"swarmloc: {self.message}", err=True, file=file)


def _repair_streams() -> None:
    """Open what the shell has closed, as by >&-; show "?" for what a terminal's code lacks."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
        elif mode == "w" and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


class Commands(click.Group):
    """Shows failures in words, and as a traceback only with --debug."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run, as click's own; a screen or disk that takes no more ends it in words."""
        self._debug = False  # as the option, once it is read
        try:
            return super().main(*args, **extra)
        except OSError as error:
            if error.errno not in _OUTPUT_FAILED or self._debug:
                raise
            where = error.filename or "the output"
            Failure(f"cannot write {where}\n{error.strerror}\nmake room, or write elsewhere").show()
            sys.exit(Failure.exit_code)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was asked for."""
        _repair_streams()
        with signals_interrupt():
            return self._invoke(ctx)

    def _invoke(self, ctx: click.Context) -> Any:
        self._debug = ctx.params["debug"]
        if self._debug:
            return super().invoke(ctx)
        try:
            return super().invoke(ctx)
        except UserError as error:
            raise Failure(str(error)) from error
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.errno in (errno.EPIPE, *_OUTPUT_FAILED):
                raise  # click ends quietly where nobody reads on; of the others see `main`
            # The last line of defence: nothing but words reaches the user.
            raise Failure(
                f"a fault of the program: {type(error).__name__}: {error}\n"
                "run it again as `swarmloc --debug ...` and report what it prints"
            ) from error


class Program(Commands):
    """Imports a command when it is used: all together take half a second."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Their names."""
        return sorted(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name."""
        if cmd_name not in _COMMANDS:
            return None
        module, _, name = _COMMANDS[cmd_name].partition(":")
        with signals_end():
            command: click.Command = getattr(importlib.import_module(module), name)
        return command


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="swarmloc", prog_name="swarmloc")
@click.option(
    "--plugin",
    "plugins",
    multiple=True,
    metavar="FILE.py",
    help="Load your own filter, scenario or lidar from a file or an installed module "
    "(docs/extending.md).",
)
@click.option("--debug", is_flag=True, help="Show the traceback when a command fails.")
def main(plugins: tuple[str, ...], debug: bool) -> None:
    """Relative localization for robot swarms: where each teammate is, by one robot's own sensors.

    \b
    Try it without hardware:
      swarmloc run --simulate arena4
    On a robot:
      swarmloc init robot.toml
      swarmloc doctor --robot robot.toml
    """
    for plugin in plugins:
        load_plugin(plugin)
