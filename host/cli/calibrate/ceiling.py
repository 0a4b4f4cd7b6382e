"""`swarmloc calibrate ceiling`: the camera under the ceiling, that is the truth of the others."""

import threading
import time
from pathlib import Path

import click

from host.calibration.ceiling.calibrate import calibrate_delay, calibrate_view
from host.calibration.result import Calibration, joined
from host.cli import options
from host.cli.calibrate.checkerboard import board_option, lens_of
from host.cli.calibrate.fitting import Fitting, result_options
from host.cli.terminal.signals import signals_caught
from host.config import Ceiling
from host.messages import FloatArray
from host.sessions.calibrating.ceiling_pictures import tags_in_file, tags_seen_live
from host.sessions.robot import robot_configuration


@click.command(
    epilog="""\b
Examples:
  swarmloc calibrate ceiling --robot robot.toml
  swarmloc calibrate ceiling --pictures tags.avi --boards boards/ --robot robot.toml
  swarmloc calibrate ceiling drive.mcap --robot robot.toml""",
)
@click.argument("source", required=False)
@click.option(
    "--pictures",
    type=click.Path(path_type=Path, exists=True),
    metavar="PATH",
    help="Pictures of tags: a folder, an MJPEG or an AVI file.  [default: live from the camera]",
)
@click.option(
    "--boards",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="FOLDER",
    help="Folder of this camera's checkerboard pictures, to fit the lens to.",
)
@board_option
@click.option(
    "--seconds",
    type=options.Number(1.0),
    help="Duration of the live pictures, s.  [default: until Ctrl-C]",
)
@result_options("ceiling")
def ceiling(
    source: str | None,
    pictures: Path | None,
    boards: Path | None,
    board: tuple[int, int, float],
    seconds: float | None,
    robot_path: Path | None,
    report_path: Path,
    accept: bool,
    json_path: Path | None,
) -> None:
    """Fit the ceiling camera: its lens and mounting to tags, its delay to a drive.

    Move a tag through the whole view, level and at its usual height. The pictures are taken live,
    or from --pictures. SOURCE is a recorded drive under this camera; the delay is fitted to it.
    """
    fitting = Fitting(robot_path, report_path, accept, json_path)
    configured = robot_configuration(robot_path).mocap.ceiling
    parts: list[Calibration] = []
    if pictures is not None or boards is not None or source is None:
        known = configured
        if boards is not None:
            eye = lens_of("ceiling camera", boards, board, configured.eye).camera
            known = configured.model_copy(update={"eye": eye})
        tags = _live(known, seconds) if pictures is None else tags_in_file(pictures, known)
        parts.append(calibrate_view(tags, known, boards is not None))
    if source is not None:
        parts.append(calibrate_delay(fitting.gather(source, lambda _: [], mounted=False)[1]))
    name = ", ".join(str(each) for each in (pictures, source) if each) or "the ceiling camera"
    fitting.conclude(joined(parts), name)


def _live(ceiling: Ceiling, seconds: float | None) -> FloatArray:
    """Tags that the camera sees from now on, for `seconds` or until Ctrl-C."""
    stop, found = threading.Event(), []
    failures: list[BaseException] = []

    def look() -> None:
        try:
            found.append(tags_seen_live(ceiling, stop, _show))
        except Exception as error:
            failures.append(error)

    click.echo("move a tag through all of the view; press Ctrl-C to end and fit", err=True)
    thread = threading.Thread(target=look)
    begin = time.monotonic()
    with signals_caught() as signalled:
        thread.start()
        while thread.is_alive() and not signalled():
            if seconds is not None and time.monotonic() - begin > seconds:
                break
            thread.join(0.1)
        stop.set()
        thread.join()
    if failures:
        raise failures[0]
    return found[0]


def _show(tags: int, state: str) -> None:
    click.echo(f"{tags} tags so far; {state.splitlines()[0] if state else ''}", err=True)
