"""`swarmloc`: the commands, and how their failures reach the user."""

import errno
import os
import sys
from typing import Any

import click

from host.cli.calibrate.calibrate import calibrate
from host.cli.doctor import doctor
from host.cli.drive import drive
from host.cli.evaluate import evaluate
from host.cli.export import export_command
from host.cli.flash import flash_command
from host.cli.init import init
from host.cli.map import map_command
from host.cli.print_sheets import print_group
from host.cli.record import record
from host.cli.replay import replay
from host.cli.run import run
from host.cli.simulate import simulate
from host.cli.sweep import sweep_command
from host.cli.terminal.signals import signals_interrupt
from host.errors import UserError
from host.registry import load_plugin


class Failure(click.ClickException):
    """A failure in words on standard error, exit code 1."""

    def show(self, file: Any = None) -> None:
        """Print it."""
        click.echo(f"swarmloc: {self.message}", err=True, file=file)


class Commands(click.Group):
    """Shows failures in words, and as a traceback only with --debug."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was asked for."""
        for name in ("stdout", "stderr"):  # closed by the shell, as by >&-
            if getattr(sys, name) is None:
                setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        with signals_interrupt():
            return self._invoke(ctx)

    def _invoke(self, ctx: click.Context) -> Any:
        if ctx.params["debug"]:
            return super().invoke(ctx)
        try:
            return super().invoke(ctx)
        except UserError as error:
            raise Failure(str(error)) from error
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            if isinstance(error, BrokenPipeError):
                raise  # click ends quietly where nobody reads on
            if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EIO):
                where = error.filename or "the output"
                raise Failure(
                    f"cannot write {where}\n{error.strerror}\nmake room, or write elsewhere"
                ) from error
            # The last line of defence: nothing but words reaches the user.
            raise Failure(
                f"a fault of the program: {type(error).__name__}: {error}\n"
                "run it again as `swarmloc --debug ...` and report what it prints"
            ) from error


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
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


for command in (
    init,
    doctor,
    run,
    drive,
    simulate,
    record,
    replay,
    export_command,
    map_command,
    evaluate,
    sweep_command,
    flash_command,
    calibrate,
    print_group,
):
    main.add_command(command)
