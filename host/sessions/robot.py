"""The robot's configuration as a command gets it: from a file, or the default; with a filter."""

from pathlib import Path

from host import config
from host.config import RobotConfig


def robot_configuration(path: Path | None, filter_name: str | None = None) -> RobotConfig:
    """The configuration in `path`, or the default one; with another filter where one is named.

    Raises UserError for a file that cannot be read or used.
    """
    loaded = RobotConfig() if path is None else config.load_config(path)
    return loaded if filter_name is None else with_filter(loaded, filter_name)


def with_filter(robot: RobotConfig, filter_name: str) -> RobotConfig:
    """The configuration with another filter profile."""
    chosen = robot.filter.model_copy(update={"profile": filter_name})
    return robot.model_copy(update={"filter": chosen})
