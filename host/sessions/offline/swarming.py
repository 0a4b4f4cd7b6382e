"""A scenario in closed loop, offline: robots drive on their own whole stacks, at full speed."""

from collections.abc import Callable, Iterator

from host.behaviour import catalogue
from host.behaviour.driving import Driving
from host.behaviour.interface import Behaviour
from host.config import RobotConfig
from host.estimator import profiles
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Message, Positions, Scan
from host.simulation.devices.board import BoardKind
from host.simulation.offline import OBSERVER, Simulation
from host.simulation.world.arena import ARENA_STEP_S, Arena, Contact
from host.simulation.world.scenarios import Scenario

# The behaviour of a robot of the scenario.
BehaviourOf = Callable[[int], Behaviour]


class Stack:
    """One robot: devices, localizer and behaviour, as a live run has them."""

    def __init__(
        self,
        simulation: Simulation,
        behaviour: Behaviour,
    ) -> None:
        config = simulation.config
        self.simulation = simulation
        self.localizer = Localizer(config, profiles.make(config.filter.profile, config))
        self.driving = Driving(config, behaviour, simulation.command, simulation.last_return)
        simulation.switch_on()

    def step(self, now: float, messages: list[Message]) -> None:
        """Take in what came up to `now` (s), and drive on.

        Here the newest estimate is known at once. A live run, which takes its time for it, gives
        one that is predicted to the present.
        """
        for message in messages:
            self.driving.take(message)
            if isinstance(message, Scan | Positions | Bearings | Displacement):
                for estimate in self.localizer.handle(message)[-1:]:
                    self.driving.know(estimate)
        self.driving.step(now)


class Swarm:
    """The robots of a scenario that drive on their own stacks (`Scenario.stacks`).

    stacks: by robot; the others follow their scripted paths. Deterministic: the same scenario gives
    the same messages.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: RobotConfig,
        behaviour_of: BehaviourOf | None = None,
        board: BoardKind | None = None,
    ) -> None:
        """behaviour_of: None: what the scenario says. board: None: the fast model."""
        self.scenario = scenario
        self.arena = Arena(scenario)
        of = behaviour_of or (
            lambda robot: catalogue.make(
                scenario.behaviour, config, scenario.seed * scenario.robots + robot
            )
        )
        own = max(scenario.robots - scenario.intruders, 1)
        robots = range(own) if scenario.stacks == "all" else (OBSERVER,)
        self.stacks = {
            robot: Stack(
                Simulation(scenario, config, board, driven=True, robot=robot, arena=self.arena),
                of(robot),
            )
            for robot in robots
        }

    @property
    def observer(self) -> Simulation:
        """The simulated devices of the robot whose messages are recorded."""
        return self.stacks[OBSERVER].simulation

    @property
    def contacts(self) -> list[Contact]:
        """Who drove against what so far."""
        return self.arena.contacts

    def take_away(self, robot: int) -> None:
        """Carry a robot out of the room; not the observer."""
        del self.stacks[robot]
        self.arena.take_away(robot)

    def messages(self) -> Iterator[Message]:
        """What the observer's devices deliver, as `Simulation.messages`; once."""
        for number in range(round(self.scenario.seconds / ARENA_STEP_S) + 1):
            yield from self.step(number)

    def step(self, number: int) -> list[Message]:
        """Go on to this step of the arena, which is one of the control; from 0, in order.

        Returns the observer's messages.
        """
        now = number * ARENA_STEP_S
        talked = {robot: stack.simulation.talk(now) for robot, stack in self.stacks.items()}
        self.arena.advance(now)
        seen: list[Message] = []
        for robot, stack in self.stacks.items():
            messages = stack.simulation.sense(now, talked[robot])
            stack.step(now, messages)
            if robot == OBSERVER:
                seen = messages
        return seen
