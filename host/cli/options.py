"""What the commands share: options, the robot's configuration, figures as text and JSON."""

import json
import textwrap
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from host import config
from host.config import RobotConfig
from host.errors import UserError
from host.estimator.profiles import PROFILES

FC = TypeVar("FC", bound=Callable[..., Any] | click.Command)


def _robot_option(default: str) -> Callable[[FC], FC]:
    return click.option(
        "--robot",
        "robot_path",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help=f"Configuration of the robot, robot.toml.  [default: {default}]",
    )


robot_option = _robot_option("a Cherokey")
robot_or_recordings_option = _robot_option("the recording's, else a Cherokey")
filter_option = click.option(
    "--filter",
    "filter_name",
    type=click.Choice(list(PROFILES)),
    help="Filter to use.  [default: the configuration's]",
)
json_option = click.option(
    "--json",
    "json_path",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the figures to FILE as JSON too.",
)


def robot(path: Path | None, filter_name: str | None = None) -> RobotConfig:
    """The configuration in `path`, or the default one; with another filter where one is named."""
    loaded = RobotConfig() if path is None else config.load(path)
    return loaded if filter_name is None else with_filter(loaded, filter_name)


def with_filter(robot: RobotConfig, filter_name: str) -> RobotConfig:
    """The configuration with another filter profile."""
    chosen = robot.filter.model_copy(update={"profile": filter_name})
    return robot.model_copy(update={"filter": chosen})


def several(text: str, known: Sequence[str], option: str) -> list[str]:
    """The parts of a comma-separated option. Raises a usage error for one that is not known."""
    parts = [part.strip() for part in text.split(",")]
    for part in parts:
        if part not in known:
            raise click.BadParameter(
                f"{part!r} is not one of {', '.join(known)}.", param_hint=option
            )
    return list(dict.fromkeys(parts))


def write_json(path: Path | None, content: object) -> None:
    """Write figures to a file; None: nowhere. Raises UserError where that fails."""
    if path is None:
        return
    try:
        path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"cannot write {path}", error.strerror or str(error), "choose another file"
        ) from error


def listing(figures: Mapping[str, Any]) -> str:
    """Figures one a line, their names aligned, in 80 columns."""
    width = max(map(len, figures), default=0)
    return "\n".join(
        textwrap.fill(
            f"  {name:{width}}  {value}",
            79,
            subsequent_indent=" " * (width + 4),
            break_on_hyphens=False,
        )
        for name, value in figures.items()
    )
