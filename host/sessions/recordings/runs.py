"""Runs to replay and to score: recordings, and scenarios simulated at full speed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from host.calibration.gathered import Tracks
from host.calibration.reinterpretation import Reinterpretation
from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.evaluation.faults import NONE, Faults, split
from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.monitored import MonitoredFilter
from host.evaluation.truth_scoring import score_by_track
from host.localizer import Localizer
from host.messages import (
    Bearings,
    Bodies,
    Displacement,
    Estimate,
    Measurement,
    Message,
    Positions,
    Scan,
    Truth,
)
from host.recording.elsewhere.bags import PREFIX, Bag
from host.recording.log import SUFFIXES, Recording
from host.sessions.offline.swarming import Swarm
from host.sessions.recordings.truth_files import TruthFile, truth_of_scenario, with_truth
from host.simulation.offline import OBSERVER, Simulation
from host.simulation.world import scenarios
from host.simulation.world.scenarios import Scenario
from host.sources.sensors import CAMERA_ONLY, LIDAR_AND_CAMERA, LIDAR_ONLY, SENSORS, uses

Recorded = Recording | Bag
# Called as data come in, with the time reached and the whole duration, in s.
Progress = Callable[[float, float], None]


def unseen(time: float, seconds: float) -> None:
    """Default for progress: ignore it."""


@dataclass(frozen=True, slots=True)
class Run:
    """One robot's messages, in order, and the true positions of its teammates.

    name: the source as the user wrote it. scenario: where it was simulated just now. faults:
    what was wrong with its sensors.
    """

    name: str
    observer: str
    config: RobotConfig
    messages: list[Measurement | Displacement]
    truths: list[Truth]
    scenario: Scenario | None = None
    faults: Faults = NONE

    @property
    def sensors(self) -> list[str]:
        """The sensors, as --sensors names them, for which there are readings."""
        kinds = {type(message) for message in self.messages}
        lidar, camera = bool(kinds & {Scan, Positions}), Bearings in kinds
        there = {LIDAR_ONLY: lidar, LIDAR_AND_CAMERA: lidar and camera, CAMERA_ONLY: camera}
        return [chosen for chosen in SENSORS if there[chosen]]

    def score(self, filter_name: str, sensors: str) -> Accumulator:
        """Run a filter on the messages and score its estimates after scans, or else pictures."""
        scored = Accumulator()
        track = TruthTrack(self.truths)
        estimates: list[Estimate] = []
        entry = profiles.filter_entry(filter_name)
        monitored = MonitoredFilter(
            entry.make(self.config),
            scored.update_seconds,
            estimates,
            track if entry.needs_identities else None,
            kept_after=Bearings if sensors == CAMERA_ONLY else Positions,
        )
        localizer = Localizer(self.config, monitored)
        for message in self.messages:
            if uses(message, sensors):
                localizer.handle(message)
        localizer.finish()
        score_by_track(estimates, track, scored)
        return scored


def find_source(source: str) -> Recorded | Scenario:
    """The recording or the scenario that a source names. Raises UserError where it is neither."""
    path = Path(source)
    if source.startswith(PREFIX) or path.suffix in SUFFIXES or path.is_file():
        return open_recording(source)
    return scenarios.parse_scenario(source)


def open_recording(source: str | Path) -> Recorded:
    """A recording, or a ROS bag as bag:FILE,scan=TOPIC,... Raises UserError."""
    bag = isinstance(source, str) and source.startswith(PREFIX)
    return Bag(str(source)) if bag else Recording(source)


def load_run(source: str, robot: RobotConfig | None, truth: TruthFile | None = None) -> Run:
    """Read a recording or simulate a scenario; a recording is read as if taken with `robot`.

    truth: in place of the recording's own. The source may set faults of its sensors
    (`host.evaluation.faults`). Raises UserError where there is neither, and for a recording without
    truth.
    """
    sound, faults = split(source)
    simulated = isinstance(find_source(sound), Scenario)
    if simulated and truth is not None:
        raise truth_of_scenario(source)
    run = simulate_scenario(sound, robot) if simulated else load_recording(sound, robot, truth)
    if not run.truths:
        raise UserError(
            f"{source} cannot be scored",
            "it holds no truth: nobody measured where the teammates really were",
            "name a file of another system that did: --truth FILE:BODY; or score a simulated run",
        )
    if faults == NONE:
        return run
    seed = run.scenario.seed if run.scenario else 0
    messages = faults.applied(run.messages, seed)
    return replace(run, name=source, messages=messages, faults=faults)


def load_recording(
    path: str | Path, robot: RobotConfig | None = None, truth: TruthFile | None = None
) -> Run:
    """What a recording holds; without motion capture or simulation there are no truths in it.

    robot: read it as if it were taken with this configuration; None: with its own. Raises
    UserError for a file that is not there or cannot be read.
    """
    recording = open_recording(path)
    config = robot or recording.header.config
    stream = read_as(recording, config)
    if truth is not None:
        stream = iter(with_truth(stream, truth, config.mocap)[0])
    messages, truths = _sort_out(stream, config)
    return Run(str(path), config.name, config, messages, truths)


def simulate_scenario(scenario: str, robot: RobotConfig | None = None) -> Run:
    """What a robot would measure in a scenario, and the truth at every scan besides.

    scenario: as "arena4:seconds=60,seed=1". robot: None for the default. Raises UserError for a
    scenario that does not exist or cannot be simulated.
    """
    parsed = scenarios.parse_scenario(scenario)
    simulation, all_messages = simulated(parsed, robot or RobotConfig())
    messages, truths = _sort_out(all_messages, simulation.config)
    return Run(scenario, str(OBSERVER), simulation.config, messages, truths, parsed)


def read_as(recording: Recorded, config: RobotConfig) -> Iterator[Message]:
    """The messages of a recording as `config` would have had them."""
    seen = Reinterpretation(recording.header.config, config)
    return map(seen.of, recording.messages())


def simulated(scenario: Scenario, config: RobotConfig) -> tuple[Simulation, Iterator[Message]]:
    """A scenario, and all messages of it with truth at every scan besides.

    Between samples a tenth of a second apart, truth is 2 cm wrong while the observer rotates.
    Raises UserError at once where the scenario has no room for its robots.
    """
    if scenario.stacks != "none":
        swarm = Swarm(scenario, config)
        return swarm.observer, _with_truth(swarm.observer, swarm.messages())
    simulation = Simulation(scenario, config)
    return simulation, _with_truth(simulation, simulation.messages())


def _with_truth(simulation: Simulation, messages: Iterator[Message]) -> Iterator[Message]:
    for message in messages:
        yield message
        if isinstance(message, Scan):
            yield simulation.truth(message.time)


def _sort_out(
    messages: Iterator[Message], config: RobotConfig
) -> tuple[list[Measurement | Displacement], list[Truth]]:
    kept: list[Measurement | Displacement] = []
    truths: list[Truth] = []
    bodies: list[Bodies] = []
    for message in messages:
        if isinstance(message, Truth):
            truths.append(message)
        elif isinstance(message, Bodies):
            bodies.append(message)
        elif isinstance(message, Scan | Positions | Bearings | Displacement):
            kept.append(message)
    if bodies and not truths:
        times = [message.time for message in kept if isinstance(message, Scan)]
        truths = Tracks(bodies, config.mocap).truths(np.array(times))
    return kept, sorted(truths, key=lambda truth: truth.time)
