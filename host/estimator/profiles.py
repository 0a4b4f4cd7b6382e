"""The filters by name, each made for one robot's configuration."""

from collections.abc import Callable, Mapping

from host.config import RobotConfig
from host.errors import UserError
from host.estimator.clairvoyant import Clairvoyant
from host.estimator.interface import Filter
from host.estimator.last_reading import LastReading
from host.estimator.perera2021 import Perera2021Filter
from host.estimator.phd import PhdFilter

PROFILES: Mapping[str, Callable[[RobotConfig], Filter]] = {
    "phd": lambda robot: PhdFilter(robot.filter, robot.lidar, robot.camera),
    "perera2021": lambda robot: Perera2021Filter(robot.lidar),
}
# Only to compare with: the one is told who is who, the other filters nothing.
REFERENCES: Mapping[str, Callable[[RobotConfig], Filter]] = {
    "clairvoyant": lambda _: Clairvoyant(),
    "last_reading": lambda _: LastReading(),
}


def make(name: str, robot: RobotConfig) -> Filter:
    """A new filter. Raises UserError for a name that is not known."""
    known = {**PROFILES, **REFERENCES}
    if name not in known:
        raise UserError(
            f"no filter is called {name!r}",
            f"known: {', '.join(known)}",
            "choose one of them with --filter, or as profile in [filter] of robot.toml",
        )
    return known[name](robot)
