"""Any messages through the localizer: without devices, threads, recording or screen."""

from collections.abc import Iterable, Iterator

from host.config import RobotConfig
from host.estimator import profiles
from host.estimator.interface import Filter
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Estimate, Message, Positions, Scan


def localize(
    messages: Iterable[Message], robot: RobotConfig | None = None, filter_: Filter | None = None
) -> Iterator[Estimate]:
    """Where the teammates are, after each scan, set of positions or set of bearings.

    messages: in the order in which they came; they are put in time order. What measures nothing
    (Truth, Bodies, Health, Estimate) is skipped. robot: None for the default. filter_: None for
    a new one of the configuration's profile.
    """
    robot = robot or RobotConfig()
    localizer = Localizer(robot, filter_ or profiles.make(robot.filter.profile, robot))
    for message in messages:
        if isinstance(message, Scan | Positions | Bearings | Displacement):
            yield from localizer.handle(message)
    yield from localizer.finish()
