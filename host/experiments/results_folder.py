"""The folder of one evaluation: figures, numbers, and the configuration that they were made with.

results/2026-11-28_06-40-12/    figures.json, experiment.toml, a folder for each source
results/latest                  a link to the newest finished one
"""

import itertools
import json
import re
from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomlkit

from host.config import RobotConfig
from host.errors import UserError, cannot_write
from host.evaluation.metrics import Row
from host.evaluation.mrclam_scoring import MRCLAM_ROBOT
from host.experiments import belaroussi, paper_figure, perera
from host.sessions.offline.evaluating import Scored, Scores
from host.systems.catalogue import SystemRow

LATEST = "latest"


class ResultsFolder:
    """Takes each observer of a source once it is scored, so that what is written stays.

    path: the folder. draw: whether there are pictures besides the CSV files; without matplotlib
    there are none.
    """

    def __init__(self, parent: Path, now: datetime, experiment: dict[str, Any]) -> None:
        """Make it. experiment: what was asked for, for experiment.toml. Raises UserError."""
        self.draw = _has_matplotlib()
        self.path = _new(parent, f"{now:%Y-%m-%d_%H-%M-%S}")
        about = {"swarmloc": version("swarmloc"), "started": now.isoformat(" ", "seconds")}
        self._write("experiment.toml", tomlkit.dumps(about | experiment))

    def take(self, scored: Scored) -> None:
        """Write the figures of one observer, and the configuration its filters had."""
        folder = _new(self.path, _folder_name(scored))
        self._write(f"{folder.name}/robot.toml", robot_toml(scored.config))
        for figure in (*perera.figures(scored), *belaroussi.figures(scored)):
            paper_figure.write(figure, folder, self.draw)

    def take_systems(self, rows: Sequence[SystemRow]) -> None:
        """Write the error measures of systems that estimate as filters do.

        Variants are "NAME, HOW": a folder for each source and each HOW.
        """
        scores: dict[tuple[str, str], Scores] = defaultdict(dict)
        for row in rows:
            if row.scored is not None:
                name, _, how = row.variant.rpartition(", ")
                scores[row.source, how][name, row.sensors] = row.scored
        for (source, how), each in scores.items():
            scored = Scored(source, "", RobotConfig(), [], each)
            folder = _new(self.path, f"{_folder_name(scored)}_{how}")
            for figure in belaroussi.figures(scored):
                paper_figure.write(figure, folder, self.draw)

    def finish(self, rows: Sequence[Row]) -> None:
        """Write the rows and let `latest` lead here."""
        content = [row.as_json() for row in rows]
        self._write("figures.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
        link, fresh = self.path.parent / LATEST, self.path.parent / f".{LATEST}"
        try:
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.path.name)
            fresh.replace(link)
        except OSError as error:
            raise _unwritable(link, error) from error

    def _write(self, name: str, text: str) -> None:
        try:
            (self.path / name).write_text(text, encoding="utf-8")
        except OSError as error:
            raise _unwritable(self.path / name, error) from error


def robot_toml(config: RobotConfig) -> str:
    """Every setting as a robot.toml, which `load_config` reads as the same configuration."""
    return tomlkit.dumps(config.model_dump(mode="json"))


def _has_matplotlib() -> bool:
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return False
    return True


def _folder_name(scored: Scored) -> str:
    """The source without its folder, in letters that every file system takes."""
    name = re.sub(r"[^\w=.+-]+", "_", scored.source.rpartition("/")[2])
    return f"{name}_robot{scored.observer}" if scored.config is MRCLAM_ROBOT else name


def _new(parent: Path, name: str) -> Path:
    """A new folder; where the name is taken, with a number behind it."""
    for count in itertools.count(1):
        path = parent / (name if count == 1 else f"{name}_{count}")
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            if parent.exists() and not parent.is_dir():
                raise UserError(
                    f"cannot write results to {parent}", "it is a file", "name a folder"
                ) from None
            continue
        except OSError as error:
            raise _unwritable(path, error) from error
        return path
    raise AssertionError  # count does not end


def _unwritable(path: Path, error: OSError) -> UserError:
    return cannot_write(path, error, "choose another folder: --figures DIR")
