"""Cross-checks over simulated runs: false alarms, and how soon each fault is noticed.

    python tools/cross_checks.py arena4:seconds=1800 swarm20:seconds=1800
    python tools/cross_checks.py --standing arena4:posts=12,seconds=1800
    python tools/cross_checks.py --faults arena4:seconds=180,seed=1

The simulation's own messages, offline; a fault alters them from 20 s to 140 s. --standing: the
observing robot stands for 30 s of each minute while the others drive on.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from host.config import RobotConfig
from host.cross_checks.checks import CrossChecks
from host.geometry import wrap
from host.messages import Bearings, Displacement, FloatArray, Health, Message, Scan
from host.simulation.offline import OBSERVER, Simulation
from host.simulation.world.scenarios import parse_scenario

CONFIG = RobotConfig()
BEGIN_S, END_S = 20.0, 140.0
COVERED = (math.radians(90.0), math.radians(40.0))  # middle and half width of what is covered

Alter = Callable[[Message], Message]


def wheels_in_the_air() -> Alter:
    """The wheels rotate, and every scan is the first one with fresh noise."""
    held: list[Scan] = []
    random = np.random.default_rng(0)

    def alter(message: Message) -> Message:
        if not isinstance(message, Scan):
            return message
        held.append(message)
        first = held[0]
        later = message.time - first.time
        noise = 0.003 * random.standard_normal(len(first.ranges))
        ranges = np.where(first.ranges > 0.0, np.maximum(first.ranges + noise, 0.0), 0.0)
        return replace(first, time=message.time, times=first.times + later, ranges=ranges)

    return alter


def no_encoder() -> Alter:
    """Both encoders are dead: the robot moves, and no tick is counted."""
    return _wheels(lambda left, right: (0.0, 0.0))


def left_encoder_dead() -> Alter:
    """The left encoder counts nothing."""
    return _wheels(lambda left, right: (0.0, right))


def right_encoder_reversed() -> Alter:
    """The right encoder counts backwards."""
    return _wheels(lambda left, right: (left, -right))


def encoders_exchanged() -> Alter:
    """Each encoder is read as the other one's."""
    return _wheels(lambda left, right: (right, left))


def cameras_exchanged() -> Alter:
    """Front and rear camera are exchanged."""
    return _bearings(lambda bearings: bearings + math.pi)


def camera_moved() -> Alter:
    """Both cameras were turned by 40 deg against robot.toml."""
    return _bearings(lambda bearings: bearings + math.radians(40.0))


def camera_blind() -> Alter:
    """No strip is seen within 80 deg around the left."""
    return _bearings(lambda bearings: bearings[~_covered(bearings)])


def lidar_covered() -> Alter:
    """Nothing comes back within 80 deg around the left."""

    def alter(message: Message) -> Message:
        if not isinstance(message, Scan):
            return message
        return replace(message, ranges=np.where(_covered(message.angles), 0.0, message.ranges))

    return alter


def _covered(angles: FloatArray) -> FloatArray:
    return np.asarray(np.abs(wrap(angles - COVERED[0])) < COVERED[1])


def _wheels(counted: Callable[[float, float], tuple[float, float]]) -> Alter:
    half_track = 0.5 * CONFIG.wheels.track_m

    def alter(message: Message) -> Message:
        if not isinstance(message, Displacement):
            return message
        sideways = half_track * message.dpsi
        left, right = counted(message.dx - sideways, message.dx + sideways)
        return replace(
            message, dx=0.5 * (left + right), dy=0.0, dpsi=(right - left) / (2.0 * half_track)
        )

    return alter


def _bearings(seen: Callable[[FloatArray], FloatArray]) -> Alter:
    def alter(message: Message) -> Message:
        if not isinstance(message, Bearings):
            return message
        bearings = np.asarray(wrap(seen(message.bearings)))
        variances = message.variances[: len(bearings)]  # all alike
        return replace(message, bearings=bearings, variances=variances, identities=None)

    return alter


FAULTS: dict[str, Callable[[], Alter]] = {
    make.__name__: make
    for make in (
        wheels_in_the_air,
        no_encoder,
        left_encoder_dead,
        right_encoder_reversed,
        encoders_exchanged,
        cameras_exchanged,
        camera_moved,
        camera_blind,
        lidar_covered,
    )
}


def altered(
    messages: Iterable[Message], fault: str, begin: float = BEGIN_S, end: float = END_S
) -> Iterator[Message]:
    """The messages, with a fault from `begin` to `end` (s)."""
    alter = FAULTS[fault]()
    for message in messages:
        yield alter(message) if begin <= message.time < end else message


def simulated(text: str, standing: bool = False) -> Iterator[Message]:
    """Messages of a scenario, as `arena4:seconds=60`."""
    simulation = Simulation(parse_scenario(text), CONFIG)
    if standing:
        _stand(simulation)
    for message in simulation.messages():
        yield message
        if isinstance(message, Scan):
            simulation.forget(message.time - 3.0)


def _stand(simulation: Simulation) -> None:
    """Let the observer stand in the first half of each minute; no scenario has that."""
    arena = simulation.arena
    begin, step = arena._start_rotation, arena._step
    observer = np.arange(arena.count) == OBSERVER
    speed = simulation.scenario.speed_mps

    def held() -> FloatArray:
        return np.asarray(observer & (arena.now % 60.0 < 30.0))

    def step_held() -> None:
        arena._speed = np.where(held(), 0.0, speed)  # type: ignore[assignment]
        step()

    arena._step = step_held  # type: ignore[method-assign]
    arena._start_rotation = lambda which, signs: begin(  # type: ignore[method-assign]
        np.asarray(which & ~held()), signs
    )


def judged(messages: Iterable[Message]) -> list[Health]:
    """Every Health that the cross-checks report."""
    checks = CrossChecks(CONFIG)
    return [health for health in map(checks.take, messages) if health is not None]


def alarms(reports: list[Health]) -> list[Health]:
    """Those reports with which a fault begins or gets other words."""
    states = [(True, ""), *((health.ok, health.reason) for health in reports)]
    return [
        health
        for health, before in zip(reports, states, strict=False)
        if not health.ok and (health.ok, health.reason) != before
    ]


def _show(name: str, reports: list[Health], since: float) -> None:
    found = alarms(reports)
    last = reports[-1]
    print(
        f"{name}: {last.time / 60.0:.1f} min, {last.counts['comparisons']} comparisons of scans, "
        f"{last.counts['contradictions']} contradict, {len(found)} alarms, "
        f"{sum(not health.ok for health in reports)} s not ok",
        flush=True,
    )
    for health in found[:4]:
        print(f"    after {health.time - since:.0f} s: {health.reason.splitlines()[0]}", flush=True)


def main() -> None:
    """Read the command line and print one block a run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenarios", nargs="+")
    parser.add_argument("--faults", action="store_true", help="each fault, one after the other")
    parser.add_argument("--standing", action="store_true", help="the robot stands half the time")
    options = parser.parse_args()
    for text in options.scenarios:
        for fault in FAULTS if options.faults else [""]:
            messages = simulated(text, options.standing)
            if fault:
                messages = altered(messages, fault)
            _show(f"{text} {fault}".strip(), judged(messages), BEGIN_S if fault else 0.0)


if __name__ == "__main__":
    main()
