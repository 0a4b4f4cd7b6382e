"""The filters by name: what swarmloc brings along, each with one entry."""

from collections.abc import Callable
from dataclasses import dataclass

from host.config import RobotConfig
from host.errors import UserError
from host.estimator.clairvoyant import Clairvoyant
from host.estimator.interface import Filter
from host.estimator.kalman_hungarian import IMPROVED, KalmanHungarian
from host.estimator.last_reading import LastReading
from host.estimator.motion_modes import MotionModes
from host.estimator.perera2021 import Perera2021Filter
from host.estimator.phd import PhdFilter
from host.estimator.pmb import PmbFilter
from host.registry import FILTERS

# In MR.CLAM (evaluation/mrclam_scoring.py) the references have settings of their own: robots drive
# at 6.5 cm/s, and what the logged odometry is off by makes teammates drift. Chosen on dataset 6 for
# the least GOSPA of the clairvoyant at an ANEES near 1.
_MRCLAM_MOTION = MotionModes((5e-4,), (8.0,), ((0.0,),), (1.0,), speed_mps=0.07, drift=0.006)
_MRCLAM_MOST_VARIANCE = 0.5  # m²: half of the squared cut-off
_MRCLAM_FORGET_S = 5.0  # as long as the scoring expects a robot to be known
_MRCLAM_PROCESS_NOISE = 0.0125  # m²/s, of readings that are kept


@dataclass(frozen=True, slots=True)
class FilterEntry:
    """How a filter is made.

    make: a new one for a robot. needs_identities: whether it reads `identities`, the true names
    of what was measured, which only evaluation knows. make_mrclam: for MR.CLAM datasets, where
    `make` with the camera's configuration would not do.
    """

    make: Callable[[RobotConfig], Filter]
    needs_identities: bool = False
    make_mrclam: Callable[[], Filter] | None = None


FILTERS.register(
    "phd", FilterEntry(lambda robot: PhdFilter(robot.filter, robot.lidar, robot.camera))
)
FILTERS.register(
    "pmb", FilterEntry(lambda robot: PmbFilter(robot.filter, robot.lidar, robot.camera))
)
FILTERS.register("perera2021", FilterEntry(lambda robot: Perera2021Filter(robot.lidar)))
# Belaroussi 2024: how the lidar's readings are matched, and his improved errors (docs/systems.md).
FILTERS.register("kalman_hungarian", FilterEntry(lambda _: KalmanHungarian()))
# His improved errors are so small that velocities are noise: carried over a delay, they do harm.
FILTERS.register(
    "kh_improved", FilterEntry(lambda _: KalmanHungarian(errors=IMPROVED, delays=False))
)
FILTERS.register("kh_partial", FilterEntry(lambda _: KalmanHungarian("partial")))
FILTERS.register("kh_full", FilterEntry(lambda _: KalmanHungarian("full")))
FILTERS.register("kh_complementary", FilterEntry(lambda _: KalmanHungarian("complementary")))
# To compare with: the limit of what a filter can reach, and no filter at all.
FILTERS.register(
    "clairvoyant",
    FilterEntry(
        lambda _: Clairvoyant(),
        needs_identities=True,
        make_mrclam=lambda: Clairvoyant(_MRCLAM_MOTION, _MRCLAM_MOST_VARIANCE, _MRCLAM_FORGET_S),
    ),
)
FILTERS.register(
    "last_reading",
    FilterEntry(
        lambda _: LastReading(),
        make_mrclam=lambda: LastReading(
            keep_s=_MRCLAM_FORGET_S, process_noise=_MRCLAM_PROCESS_NOISE
        ),
    ),
)


def filter_entry(name: str) -> FilterEntry:
    """The entry of a filter. Raises UserError for a name that is not registered."""
    entry: FilterEntry = FILTERS.get(name)
    return entry


def make(name: str, robot: RobotConfig) -> Filter:
    """A new filter for a run or a replay. Raises UserError for one that cannot be had there."""
    entry = filter_entry(name)
    if entry.needs_identities:
        raise UserError(
            f"the filter {name!r} cannot run on a robot",
            "it needs the true identity of every reading, which only evaluation knows",
            f"score it: swarmloc evaluate SOURCE --filters {name}",
        )
    return entry.make(robot)
