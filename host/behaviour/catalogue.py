"""The behaviours by name: what swarmloc brings along, each with one entry."""

from collections.abc import Callable
from dataclasses import dataclass

from host.behaviour.formations import Circle
from host.behaviour.interface import Behaviour
from host.behaviour.survey import Survey
from host.behaviour.walk import RandomWalk
from host.config import RobotConfig
from host.registry import BEHAVIOURS


@dataclass(frozen=True, slots=True)
class BehaviourEntry:
    """How a behaviour is made. make: a new one for a robot, with a seed for what is random."""

    make: Callable[[RobotConfig, int], Behaviour]


BEHAVIOURS.register("circle", BehaviourEntry(lambda robot, seed: Circle()))
BEHAVIOURS.register("survey", BehaviourEntry(lambda robot, seed: Survey(seed)))
BEHAVIOURS.register("walk", BehaviourEntry(lambda robot, seed: RandomWalk(seed)))


def make(name: str, robot: RobotConfig, seed: int = 0) -> Behaviour:
    """A new behaviour by its name. Raises UserError for one that is not registered."""
    entry: BehaviourEntry = BEHAVIOURS.get(name)
    return entry.make(robot, seed)
