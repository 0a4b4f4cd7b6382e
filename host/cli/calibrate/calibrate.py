"""`swarmloc calibrate`: numbers of robot.toml, fitted to what motion capture saw of a drive.

Each fit is imported by its own command: together they would add a fifth of a second to the start
of every other one.
"""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from host.cli import options
from host.cli.calibrate import gathering
from host.cli.calibrate.ceiling import ceiling
from host.cli.calibrate.checkerboard import board_option, boards_option, lenses
from host.cli.calibrate.colour import colour
from host.cli.calibrate.fitting import Fitting, all_of, fit_options, result_options
from host.cli.files import write_json
from host.config import Mocap, Wheels
from host.errors import UserError
from host.recording.elsewhere import optiodom
from host.sessions.recordings.truth_files import TruthFile

if TYPE_CHECKING:
    from host.calibration.wheels.model import Drive

_OPTIODOM = "optiodom:"


@click.group(
    short_help="Fit robot.toml to a recorded drive, with a verdict.",
    context_settings={"help_option_names": ["-h", "--help"]},
)
def calibrate() -> None:
    """Fit the geometry, delays and noise in robot.toml to a drive under motion capture.

    \b
    Step by step in docs/calibration.md; here with a simulated robot:
      swarmloc simulate misbuilt4 --output drive.mcap
      swarmloc calibrate wheels drive.mcap --robot robot.toml
      swarmloc calibrate lidar drive.mcap --robot robot.toml
      swarmloc calibrate camera drive.mcap --robot robot.toml
      swarmloc calibrate detection drive.mcap --robot robot.toml
    or all four in one command, and wheels, lidar and cameras once more together:
      swarmloc calibrate all drive.mcap --robot robot.toml
    """


calibrate.add_command(ceiling)
calibrate.add_command(colour)


@calibrate.command(
    epilog="""\b
Examples:
  swarmloc calibrate wheels --robot robot.toml --record drive.mcap
  swarmloc calibrate wheels drive.mcap --robot robot.toml
  swarmloc calibrate wheels drive.mcap --truth take.csv:Robot1 --robot robot.toml
  swarmloc calibrate wheels optiodom:runs/free --test optiodom:runs/square""",
)
@click.argument("sources", nargs=-1, metavar="[SOURCE]...")
@click.option(
    "--test",
    "tests",
    multiple=True,
    metavar="SOURCE",
    help="Score the fit on runs that it was not fitted to.",
)
@fit_options("wheels")
def wheels(sources: tuple[str, ...], tests: tuple[str, ...], **common: Any) -> None:
    """Fit wheel radii, track, and the odometry's delay and noise.

    SOURCE is a recording, a scenario or optiodom:FOLDER. Without it, drive the robot now.
    """
    from host.calibration.wheels.calibrate import calibrate as fit_wheels
    from host.calibration.wheels.drives import drives_of, wheels_advice
    from host.calibration.wheels.unseen import apply_fit, score_unseen

    fitting = Fitting(**common)
    name = ", ".join(sources)
    if sources:
        fitting.check_source()
        if fitting.truth is not None and len(sources) > 1:
            raise click.UsageError("--truth is of one recording: name one SOURCE")
        drives, nominal, mocap = _drives(sources[0], fitting.robot_path, fitting.truth)
        for source in sources[1:]:
            more, *others = _drives(source, fitting.robot_path)
            if others != [nominal, mocap]:
                raise UserError(
                    f"{sources[0]} and {source} are not of one robot",
                    "their wheels or tracked bodies are configured differently",
                    "fit each by itself, or give the robot's configuration with --robot",
                )
            drives += more
    else:
        name, gathered = fitting.gather(None, wheels_advice, mounted=False)
        drives = drives_of(gathered)
        nominal, mocap = gathered.config.wheels, gathered.config.mocap
    unseen = {source: _drives(source, fitting.robot_path)[0] for source in tests}
    calibration = fit_wheels(drives, nominal, mocap)
    if any(source.startswith(_OPTIODOM) for source in sources):  # the radii are in its counts
        counts = {"wheels.counts_per_turn": nominal.counts_per_turn}
        calibration = dataclasses.replace(calibration, settings=counts | calibration.settings)
    fitted = apply_fit(calibration, nominal, mocap)
    before = nominal, mocap
    scores = [score_unseen(source, read, before, fitted) for source, read in unseen.items()]
    for score in scores:
        click.echo(
            f"{score['source']}: {1000 * score['nominal_end_error_m']:.1f} mm at the end with the "
            f"nominal geometry, {1000 * score['fitted_end_error_m']:.1f} mm with the fitted"
        )
    fitting.conclude(calibration, name, tests=scores)


def _drives(
    source: str, robot_path: Path | None, truth: TruthFile | None = None
) -> tuple["list[Drive]", Wheels, Mocap]:
    """The drives of a source, the nominal wheels and how the tracked body is thought to lie."""
    from host.calibration.wheels.drives import drive_of_run, drives_of

    if source.startswith(_OPTIODOM):
        if truth is not None:
            raise UserError(f"{source} needs no --truth", "its runs hold it", "leave --truth out")
        runs = optiodom.read_runs(Path(source.removeprefix(_OPTIODOM)))
        return [drive_of_run(run) for run in runs], runs[0].wheels, Mocap()
    gathered = gathering.from_source(source, robot_path, truth)
    return drives_of(gathered), gathered.config.wheels, gathered.config.mocap


@calibrate.command(
    epilog="""\b
Examples:
  swarmloc calibrate lidar --robot robot.toml --record drive.mcap
  swarmloc calibrate lidar drive.mcap --robot robot.toml""",
)
@click.argument("source", required=False)
@fit_options("lidar")
def lidar(source: str | None, **common: Any) -> None:
    """Fit the lidar's mounting and delay.

    SOURCE is a recording or a scenario. Without it, drive the robot now.
    """
    from host.calibration.lidar.calibrate import calibrate as fit_lidar
    from host.calibration.lidar.calibrate import lidar_advice

    fitting = Fitting(**common)
    name, gathered = fitting.gather(source, lidar_advice)
    fitting.conclude(fit_lidar(gathered), name)


@calibrate.command(
    epilog="""\b
Examples:
  swarmloc calibrate camera --robot robot.toml --record drive.mcap
  swarmloc calibrate camera drive.mcap --robot robot.toml
  swarmloc calibrate camera drive.mcap --quick
  swarmloc calibrate camera drive.mcap --boards front=pictures/ --board 9x6:0.025""",
)
@click.argument("source", required=False)
@boards_option
@board_option
@click.option(
    "--quick",
    is_flag=True,
    help="Fit only start values of headings, positions and delay, by aligning the strips' "
    "positions with the teammates' (Belaroussi 2024). Lens and tilt are kept.",
)
@fit_options("camera")
def camera(
    source: str | None,
    boards: dict[str, Path],
    board: tuple[int, int, float],
    quick: bool,
    **common: Any,
) -> None:
    """Fit the cameras' lenses, mounting and delay.

    SOURCE is a recording or a scenario. Without it, drive the robot now.
    """
    from host.calibration.camera.calibrate import calibrate as fit_camera
    from host.calibration.camera.calibrate import camera_advice
    from host.calibration.camera.quick import calibrate as align_camera

    if quick and boards:
        raise click.UsageError("--quick leaves the lens as it is: leave --boards out")
    fitting = Fitting(**common)
    name, gathered = fitting.gather(source, camera_advice, lidar_serves=True)
    if quick:
        fitting.conclude(align_camera(gathered), name)
        return
    known = lenses(boards, board, gathered.config.camera)
    fitting.conclude(fit_camera(gathered, known), name)


@calibrate.command(
    epilog="""\b
Examples:
  swarmloc calibrate detection --robot robot.toml --record drive.mcap
  swarmloc calibrate detection drive.mcap --robot robot.toml""",
)
@click.argument("source", required=False)
@fit_options("detection")
def detection(source: str | None, **common: Any) -> None:
    """Fit the detection probabilities and false alarm rates of lidar and cameras.

    SOURCE is a recording or a scenario. Without it, drive the robot now. Calibrate wheels, lidar
    and cameras first.
    """
    from host.calibration.detection.calibrate import calibrate as fit_detection
    from host.calibration.detection.verdict import detection_advice

    fitting = Fitting(**common)
    name, gathered = fitting.gather(source, detection_advice)
    fitting.conclude(fit_detection(gathered), name)


@calibrate.command(
    "all",
    epilog="""\b
Example:
  swarmloc calibrate all drive.mcap --robot robot.toml""",
)
@click.argument("source")
@all_of(result_options("all"), options.truth_options)
def everything(source: str, report_path: Path, json_path: Path | None, **common: Any) -> None:
    """Fit wheels, lidar and cameras to one drive, then these together, then detection.

    Each fit uses the results of those before it, with their covariance. The joint fit refines all
    that passed, and finds teammates' turrets that are not above the pivots of their tracked bodies.
    A sensor that was refused is then tried again. Sensors that the drive has no data of are
    skipped. Each fit writes its own report: calibration-all-wheels.html, ...
    """
    from host.cli.calibrate.sequence import Sequence

    if common["robot_path"] is None:
        raise click.UsageError("name the robot.toml that each fit hands on to the next: --robot")
    sequence = Sequence(source, report_path, common)
    try:
        sequence.run()
    finally:
        write_json(json_path, sequence.results)
