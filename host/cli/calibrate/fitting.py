"""What the calibrations share on the command line: options, data in, verdict and fit out."""

import dataclasses
import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from host.calibration import chain, robot_file
from host.calibration.gathered import Gathered
from host.calibration.report import html as report
from host.calibration.report import text as figures
from host.calibration.result import Calibration
from host.cli import options
from host.cli.calibrate import gathering
from host.cli.files import OutputFile, check_writable, json_option, write_json
from host.cli.terminal.layout import columns
from host.errors import UserError
from host.recording.log import SUFFIX
from host.sessions.calibrating.gathering import Advice
from host.sessions.recordings.truth_files import TruthFile

_UNMOUNTED = (
    "[mocap] says that the tracked body is exactly at the robot's origin; unless you know "
    "that, calibrate wheels first: it fits the body's pose on the robot"
)

FC = TypeVar("FC", bound=Callable[..., Any] | click.Command)


def result_options(kind: str) -> Callable[[FC], FC]:
    """Where every fit begins, and where it goes: robot.toml, report and figures."""
    return all_of(
        click.option(
            "--robot",
            "robot_path",
            type=click.Path(path_type=Path, dir_okay=False),
            metavar="FILE",
            help="robot.toml to start from and to write the fit to.  [default: the recording's or "
            "built-in settings; nothing is written]",
        ),
        click.option(
            "--report",
            "report_path",
            type=OutputFile(),
            default=Path(f"calibration-{kind}.html"),
            show_default=True,
            metavar="FILE",
            help="HTML report to write.",
        ),
        click.option("--accept", is_flag=True, help="Write the fit even if a check fails."),
        json_option,
    )


def fit_options(kind: str) -> Callable[[FC], FC]:
    """The options of every fit to a drive."""
    return all_of(
        result_options(kind),
        options.simulate_option("Without SOURCE: use simulated devices.", "misbuilt4"),
        click.option(
            "--seconds",
            type=options.Number(1.0),
            help="Without SOURCE: stop after this time, s.  [default: at Ctrl-C]",
        ),
        click.option(
            "--record",
            type=OutputFile(),
            metavar="FILE",
            help="Without SOURCE: file to record the drive in.  [default: drive-DATE-TIME.mcap]",
        ),
        click.option(
            "--drive",
            "drives",
            is_flag=True,
            help="Without SOURCE: the robot drives itself until there is enough data.",
        ),
        options.truth_options,
    )


def all_of(*choices: Callable[[FC], FC]) -> Callable[[FC], FC]:
    """Several options as one, in their order."""

    def decorate(command: FC) -> FC:
        for choice in reversed(choices):
            command = choice(command)
        return command

    return decorate


class Fitting:
    """One calibration on the command line: where its data are, and where its fit goes."""

    def __init__(
        self,
        robot_path: Path | None,
        report_path: Path,
        accept: bool,
        json_path: Path | None,
        scenario: str | None = None,
        seconds: float | None = None,
        record: Path | None = None,
        truth: TruthFile | None = None,
        drives: bool = False,
    ) -> None:
        self.robot_path = robot_path
        self.truth = truth
        self._live = (scenario, seconds, record)
        self._drives = drives
        self._report_path = report_path
        self._accept = accept
        self._json_path = json_path
        self._warnings: tuple[str, ...] = ()
        # At once: after a drive it would be too late.
        if robot_path is not None:
            robot_file.check_writable(robot_path)
        check_writable(report_path)

    def gather(
        self,
        source: str | None,
        advice: Advice,
        *,
        mounted: bool = True,
        lidar_serves: bool = False,
    ) -> tuple[str, Gathered]:
        """The data and their name: of a source, or of the devices where there is none.

        mounted: whether the fit stands on how the tracked body lies on the robot; then there is a
        warning where nobody has found that yet. lidar_serves: where there is no motion capture.
        """
        if source is None:
            if self.truth is not None:
                raise click.UsageError("--truth is for a recording: name it as SOURCE")
            scenario, seconds, record = self._live
            # A drive is work, and a fit may be refused: it is always recorded.
            record = record or drive_name()
            name, gathered = gathering.live(
                self.robot_path,
                scenario,
                seconds,
                record,
                advice,
                not lidar_serves,
                drives=self._drives,
            )
            click.echo(f"recorded in {record}", err=True)
        else:
            self.check_source()
            name, gathered = source, gathering.from_source(source, self.robot_path, self.truth)
        mocap = gathered.config.mocap
        if mounted and gathered.bodies and not (mocap.x_m or mocap.y_m or mocap.heading_rad):
            self._warnings = (_UNMOUNTED,)
        click.echo("fitting ...", err=True)
        return name, gathered

    def check_source(self) -> None:
        """Raise a usage error for options that a source leaves no use for."""
        if self._drives or any(option is not None for option in self._live):
            raise click.UsageError(
                "--simulate, --seconds, --record and --drive are for a drive, not SOURCE"
            )

    def conclude(self, calibration: Calibration, source: str, **more: Any) -> dict[str, Any]:
        """Show the verdict, write report and figures, and robot.toml where the fit is good.

        Gives the figures. Raises UserError where it is not, unless it was accepted beforehand.
        """
        warnings = (*calibration.warnings, *self._warnings)
        calibration = dataclasses.replace(calibration, warnings=warnings)
        date = datetime.date.today().isoformat()
        robot = "a Cherokey" if self.robot_path is None else str(self.robot_path)
        content = {**figures.as_json(calibration, source, date), **more}
        write_json(self._json_path, content)
        report.write_html(self._report_path, calibration, source, date, robot)
        click.echo(figures.as_text(calibration, columns()))
        click.echo(f"report: {self._report_path}")
        if calibration.failures and not self._accept:
            raise UserError(
                f"the {calibration.kind} calibration is refused; nothing is written",
                calibration.failures[0],
                "fix the failed checks, or pass --accept",
            )
        if self.robot_path is None:
            click.echo("nothing is written: name your robot.toml with --robot")
            return content
        if not calibration.new_settings():
            return content
        note = f"{calibration.kind} calibrated {date} from {source}: {calibration.residuals}"
        robot_file.update(self.robot_path, calibration.new_settings(), note)
        known = chain.load(self.robot_path)
        known.take(calibration)
        chain.save(self.robot_path, known)
        click.echo(f"written to {self.robot_path}")
        return content


def drive_name() -> Path:
    """Where a drive is recorded that nobody named."""
    return Path(f"drive-{datetime.datetime.now():%Y%m%d-%H%M%S}{SUFFIX}")
