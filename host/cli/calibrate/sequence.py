"""`swarmloc calibrate all`: one fit after the other, then wheels, lidar and cameras together."""

import datetime
from pathlib import Path
from typing import Any

import click

from host.calibration import robot_file
from host.calibration.gathered import Gathered
from host.calibration.joint.calibrate import SENSORS, SensorName
from host.calibration.joint.calibrate import calibrate as fit_jointly
from host.calibration.result import Calibration
from host.cli.calibrate.fitting import Fitting
from host.errors import UserError
from host.sessions.calibrating.calibrate import CalibrationKind, calibrate_gathered, lacking


class Sequence:
    """The fits to one drive, each begun with what those before it have written.

    results: the figures of each, for --json.
    """

    def __init__(self, source: str, report_path: Path, common: dict[str, Any]) -> None:
        self._source, self._report_path, self._common = source, report_path, common
        self._passed: list[SensorName] = []
        self._refused: dict[CalibrationKind, UserError] = {}
        self._fits: dict[CalibrationKind, Calibration] = {}
        self._outcomes: dict[str, str] = {}  # by kind, or what else was written
        self.results: list[dict[str, Any]] = []

    def run(self) -> None:
        """All that can be fitted. Raises UserError for the first that is refused, at the end."""
        self._fit_all()
        robot = self._common["robot_path"]
        click.echo(f"calibration of {robot} with {self._source}")
        for kind in (*SENSORS, "joint", "detection"):
            self._outcomes.setdefault(kind, "not tried: it needs others that passed")
        for kind, outcome in self._outcomes.items():  # not filled: names of files stay whole
            click.echo(f"  {kind:9}  {outcome}")
        for error in self._refused.values():
            raise error
        click.echo(f"next: swarmloc run --robot {robot}")

    def _fit_all(self) -> None:
        for sensor in SENSORS:
            self._try(sensor)
            if "wheels" in self._refused:
                break  # all others stand on how the tracked body lies
        found = self._together() or self._find_turrets()
        again = [sensor for sensor in SENSORS[1:] if sensor in self._refused]
        if found and again:
            click.echo(f"{', '.join(again)}: again, with turrets where they were found\n")
            for sensor in again:
                self._try(sensor)
            self._together()
        if not self._refused.keys() & set(SENSORS):
            self._try("detection")

    def _together(self) -> bool:
        """The fit of all that passed, where that is more than wheels: whether it passed."""
        if set(self._passed) <= {"wheels"}:
            return False
        left = [sensor for sensor in SENSORS if sensor not in self._passed]
        if left:
            click.echo(f"together: {', '.join(self._passed)}, without {', '.join(left)}")
        self._try("joint")
        return "joint" not in self._refused

    def _find_turrets(self) -> bool:
        """Write where turrets are, by a lidar's fit that was refused: this may be why it was.

        Gives whether they were found.
        """
        if self._passed != ["wheels"] or "lidar" not in self._fits:
            return False
        fitting = Fitting(**self._common, report_path=self._report_path, json_path=None)
        name, gathered = fitting.gather(self._source, lambda _: [])
        try:
            found = fit_jointly(gathered, ["wheels", "lidar"], self._fits["lidar"].new_settings())
        except UserError:
            return False  # the lidar's own refusal says more
        if found.failures or fitting.robot_path is None:
            return False
        turrets = {"mocap.turrets": found.settings["mocap.turrets"]}
        today = datetime.date.today().isoformat()
        note = f"turrets calibrated {today} from {name}: {found.residuals}"
        robot_file.update(fitting.robot_path, turrets, note)
        self._outcomes["turrets"] = "found and written"
        return True

    def _try(self, kind: CalibrationKind) -> None:
        """One fit; one that is refused is kept in mind."""
        self._refused.pop(kind, None)
        report = self._report_path.with_stem(f"{self._report_path.stem}-{kind}")
        fitting = Fitting(**self._common, report_path=report, json_path=None)
        name, gathered = fitting.gather(self._source, lambda _: [], mounted=kind != "wheels")
        if missing := lacking(kind, gathered):
            click.echo(f"{kind}: left out, {self._source} has no {missing}")
            self._outcomes[kind] = f"left out: no {missing}"
            return
        self._outcomes.pop(kind, None)
        try:
            self._fits[kind] = fit = self._fit(kind, gathered)
            verdict = "refused" if fit.failures else "passed"
            self._outcomes[kind] = f"{verdict}, nothing written; report: {report}"
            self.results.append(fitting.conclude(fit, name))
        except UserError as error:
            self._refused[kind] = error
            self._outcomes.setdefault(kind, f"not fitted: {error.what}")
            click.echo(f"{kind}: {error.what}", err=True)
        else:
            verdict = "accepted although checks fail" if fit.failures else "passed"
            verdict += " and written" if fit.new_settings() else ", nothing to write"
            self._outcomes[kind] = f"{verdict}; report: {report}"
            if kind in SENSORS:
                self._passed.append(kind)
        click.echo()

    def _fit(self, kind: CalibrationKind, gathered: Gathered) -> Calibration:
        if kind == "joint":
            return fit_jointly(gathered, [s for s in SENSORS if s in self._passed])
        return calibrate_gathered(kind, gathered)
