"""Belaroussi's variants on a scenario, by his error measures (section 6.2.1)."""

from host.config import RobotConfig
from host.evaluation import curves, faults
from host.evaluation.metrics import Accumulator
from host.messages import Bearings, Displacement, Scan, Truth
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario
from host.systems.kalman_hungarian.sensors import Event
from host.systems.kalman_hungarian.variants import scored

Scores = dict[tuple[str, str], Accumulator]  # by variant and sensors


def simulated_scores(source: str) -> Scores:
    """Every variant, late as published and compensated, on a scenario with or without faults."""
    name, wrong = faults.split(source)
    scenario = parse_scenario(name)
    simulation = Simulation(scenario, RobotConfig())
    messages: list[Event] = []
    truths: list[Truth] = []
    for message in simulation.messages():
        if isinstance(message, Scan | Bearings | Displacement):
            messages.append(message)
        elif isinstance(message, Truth):
            truths.append(message)
        if isinstance(message, Scan):
            truths.append(simulation.truth(message.time))
    truths.sort(key=lambda truth: truth.time)
    broken = [each for each in wrong.applied(messages, scenario.seed) if isinstance(each, Event)]
    found: Scores = {}
    for compensated, word in ((False, "late"), (True, "compensated")):
        scores = scored(simulation.config, broken, truths, compensated)
        found |= {(f"{name}, {word}", sensors): each for (name, sensors), each in scores.items()}
    return found


def measures(scored_: Accumulator) -> dict[str, float]:
    """RMSE and 67th percentile of all pairs, without a cut-off; missed and false per scan."""
    pairs = curves.pair_errors(scored_.instants)
    row = scored_.row("", "", "", "")
    found = {"missed": row.missed, "false": row.false}
    if not len(pairs.errors):
        return found
    return {"rmse_m": pairs.rmse_m, "p67_m": pairs.p67_m, **found}
