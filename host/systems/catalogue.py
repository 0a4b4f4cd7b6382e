"""The systems by name: what each needs, and the sources on which it can be scored."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from host.evaluation.metrics import Accumulator
from host.recording.elsewhere.mrclam import load_dataset, read_source
from host.registry import SCENARIOS
from host.simulation.world.settings import with_settings
from host.systems.id_phd.mrclam_identities import mrclam_identities
from host.systems.id_phd.overhead import OverheadScenario
from host.systems.id_phd.overhead_score import overhead_score
from host.systems.kalman_hungarian.simulated import Scores, measures, simulated_scores
from host.systems.particles.simulated import IntruderScenario, tracked
from host.systems.swarm_ukf.mrclam_swarm import mrclam_score
from host.systems.swarm_ukf.simulated import SimulatedSwarm, SwarmScenario, simulated_score

Figures = dict[str, float]
Variants = dict[str, Figures]

DATASET, SWARM, INTRUDER, OVERHEAD = "mrclam", "swarm", "intruder", "overhead"


@dataclass(frozen=True, slots=True)
class System:
    """work: who described it. needs: in words. sources: how it is scored, by the source's kind.

    scored: the scores of its variants on a scenario, where it estimates as a filter does.
    """

    name: str
    work: str
    needs: str
    sources: dict[str, Callable[[str], Variants]]
    scored: Callable[[str], Scores] | None = None


@dataclass(frozen=True, slots=True)
class SystemRow:
    """Figures of one variant of a system on one source; or `why` there are none."""

    source: str
    system: str
    variant: str
    figures: Figures
    why: str = ""
    scored: Accumulator | None = None  # where `--figures` draws it: with the sensors it had
    sensors: str = ""

    def as_json(self) -> dict[str, Any]:
        """As JSON values."""
        common = {"source": self.source, "system": self.system, "variant": self.variant}
        return {**common, **self.figures, **({"why": self.why} if self.why else {})}


def _swarm_on_dataset(source: str) -> Variants:
    folder, _ = read_source(source)  # landmarks have no identity: they are left out
    dataset = load_dataset(folder)
    return {
        "joint": mrclam_score(dataset, "joint").figures(),
        "a filter a robot": mrclam_score(dataset, "exact").figures(),
    }


def _swarm_simulated(source: str) -> Variants:
    scenario = with_settings(SwarmScenario(), source)
    return {
        "joint": simulated_score(SimulatedSwarm(scenario), "joint"),
        "a filter a robot": simulated_score(SimulatedSwarm(scenario), "exact"),
        "direct": SimulatedSwarm(scenario).direct_score(),
    }


def _identities_on_dataset(source: str) -> Variants:
    folder, landmarks = read_source(source)
    dataset = load_dataset(folder)
    return {
        variant: mrclam_identities(dataset, landmarks, variant)
        for variant in ("id_phd", "printed", "barcodes")
    }


def _overhead(source: str) -> Variants:
    scenario = with_settings(OverheadScenario(), source)
    return {
        "id_phd": overhead_score(scenario),
        "printed": overhead_score(scenario, printed=True),
    }


def _intruder(source: str) -> Variants:
    return tracked(with_settings(IntruderScenario(), source))


SYSTEMS = {
    system.name: system
    for system in (
        System(
            "kalman_hungarian",
            "Belaroussi 2024",
            "scans and pictures of a simulated robot (on any source: --filters kalman_hungarian)",
            {},
            scored=simulated_scores,
        ),
        System(
            "swarm_ukf",
            "Miller 2019",
            "odometry and sightings with identities of all robots, at one place",
            {DATASET: _swarm_on_dataset, SWARM: _swarm_simulated},
        ),
        System(
            "id_phd",
            "Stegagno 2013",
            "one robot's sightings without names, and the odometry that the others send it",
            {DATASET: _identities_on_dataset, OVERHEAD: _overhead},
        ),
        System(
            "particles",
            "Lee 2012",
            "distances to one thing from robots whose places are known",
            {INTRUDER: _intruder},
        ),
    )
}


def is_system_source(source: str) -> bool:
    """Whether only systems of this catalogue can be scored on a source."""
    return _kind(source) in (SWARM, INTRUDER, OVERHEAD)


def score_systems(sources: Sequence[str], names: Sequence[str]) -> Iterator[SystemRow]:
    """Rows of each system on each source. Raises UserError for settings that do not exist."""
    for source in sources:
        for name in names:
            system = SYSTEMS[name]
            if system.scored is not None and _kind(source) in SCENARIOS.names():
                for (variant, sensors), each in system.scored(source).items():
                    yield SystemRow(source, name, variant, measures(each), "", each, sensors)
                continue
            score = system.sources.get(_kind(source))
            if score is None:
                yield SystemRow(source, name, "", {}, f"it needs {system.needs}")
                continue
            for variant, figures in score(source).items():
                yield SystemRow(source, name, variant, figures)


def _kind(source: str) -> str:
    return source.partition(":")[0]
