"""The behaviours by name: what swarmloc brings along, each with one entry."""

from collections.abc import Callable
from dataclasses import dataclass

from host.behaviour.formations.circle import Circle
from host.behaviour.formations.intruder import Enclose, Keep
from host.behaviour.formations.line import Gather, Line
from host.behaviour.interface import Behaviour
from host.behaviour.survey import Survey
from host.behaviour.walk import RandomWalk
from host.config import RobotConfig
from host.registry import BEHAVIOURS


@dataclass(frozen=True, slots=True)
class BehaviourEntry:
    """How a behaviour is made. make: a new one for a robot, with a seed for what is random."""

    make: Callable[[RobotConfig, int], Behaviour]


FORMATIONS: dict[str, Callable[[], Behaviour]] = {
    "circle": lambda: Circle(speed_mps=0.12),
    "enclose": Enclose,
    "gather": Gather,
    "keep": Keep,
    "line": Line,
    "platoon": Circle,
}


def _alike(make: Callable[[], Behaviour]) -> BehaviourEntry:
    """A behaviour that is the same for every robot and seed."""
    return BehaviourEntry(lambda robot, seed: make())


for _name, _make in FORMATIONS.items():
    BEHAVIOURS.register(_name, _alike(_make))
BEHAVIOURS.register("survey", BehaviourEntry(lambda robot, seed: Survey(seed)))
BEHAVIOURS.register("walk", BehaviourEntry(lambda robot, seed: RandomWalk(seed)))


def make(name: str, robot: RobotConfig, seed: int = 0) -> Behaviour:
    """A new behaviour by its name. Raises UserError for one that is not registered."""
    entry: BehaviourEntry = BEHAVIOURS.get(name)
    return entry.make(robot, seed)
