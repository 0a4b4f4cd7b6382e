"""Filters against truth: sources of any kind, scored with several filters and sensors."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from host.config import RobotConfig
from host.errors import UserError
from host.evaluation import faults, mrclam_scoring
from host.evaluation.faults import Faults
from host.evaluation.metrics import Accumulator, Row
from host.evaluation.mrclam_scoring import CAMERA, MRCLAM_ROBOT, NewFilter
from host.evaluation.truth_scoring import WARM_UP_S
from host.messages import Displacement
from host.recording.elsewhere import mrclam
from host.sessions.recordings import runs
from host.sessions.recordings.truth_files import TruthFile
from host.simulation.offline import OBSERVER
from host.simulation.world.scenarios import Scenario

Scores = dict[tuple[str, str], Accumulator]  # by filter and sensors
Step = Callable[[str], None]


class Scored(NamedTuple):
    """One observer of a source: its configuration, its odometry, and the scores of each filter."""

    source: str
    observer: str
    config: RobotConfig
    motion: list[Displacement]
    scores: Scores


Keep = Callable[[Scored], None]


def is_dataset(source: str) -> bool:
    """Whether a source is an MR.CLAM dataset."""
    return source.startswith(mrclam.SOURCE)


def check_source(source: str) -> None:
    """Raise UserError for a source that is not there or is known to be too short."""
    if is_dataset(source):
        mrclam.read_source(source)
        return
    found = runs.find_source(faults.split(source)[0])
    if isinstance(found, Scenario) and found.seconds <= WARM_UP_S:
        raise _too_short(source)


def step_count(sources: Sequence[str], filters: Sequence[str], sensors: Sequence[str]) -> int:
    """How often `score_sources` reports a step. A dataset has its own sensors."""
    each = [1 if is_dataset(source) else len(sensors) for source in sources]
    return len(filters) * sum(each)


def _no_step(done: str) -> None:
    pass


def _keep_nothing(scored: Scored) -> None:
    pass


def score_sources(
    sources: Sequence[str],
    filters: Sequence[str],
    sensors: Sequence[str],
    robot: RobotConfig | None = None,
    step: Step = _no_step,
    keep: Keep = _keep_nothing,
    truth: TruthFile | None = None,
) -> list[Row]:
    """Rows of each filter with each choice of sensors on each source, in this order.

    source: a recording, a scenario (arena4:seconds=120,seed=1) or mrclam:FOLDER,landmarks=drop;
    of the first two the sensors may fail, as in arena4:camera_false=5 (`host.evaluation.faults`).
    Several seeds of one scenario are pooled besides, in rows at the end. robot: None for the
    recordings' own and else the default. step: called with what has just been scored. keep:
    called with each observer once it is scored by all filters. truth: of recordings, in place of
    their own. Raises UserError where a source is not there, has no truth or is too short.
    """
    rows: list[Row] = []
    scored: list[tuple[Scenario, Faults, Scores]] = []
    for source in sources:
        if is_dataset(source):
            rows += _dataset_rows(source, filters, step, keep)
            continue
        run = runs.load_run(source, robot, truth)
        scores = scores_of(run, filters, sensors, step)
        rows += _rows(source, run.observer, scores)
        motion = [message for message in run.messages if isinstance(message, Displacement)]
        keep(Scored(source, run.observer, run.config, motion, scores))
        if run.scenario is not None:
            scored.append((run.scenario, run.faults, scores))
    return [*rows, *_pooled(scored)]


def _too_short(source: str) -> UserError:
    return UserError(
        f"{source} cannot be scored",
        f"it is shorter than the {WARM_UP_S:.0f} s of warm-up, or has no truth at scans after it",
        "use a longer one: seconds=30 for a scenario",
    )


def scores_of(
    run: runs.Run, names: Sequence[str], sensors: Sequence[str], step: Step = _no_step
) -> Scores:
    """Each filter with each choice of sensors that the run has. Raises UserError for none."""
    missing = set(sensors) - set(run.sensors)
    if missing == set(sensors):
        raise UserError(
            f"{run.name} has no readings of {' or '.join(sorted(missing))}",
            f"it holds those of {', '.join(run.sensors) or 'no sensor'}",
            "choose others with --sensors",
        )
    scores: Scores = {}
    for name in names:
        for chosen in sensors:
            if chosen in run.sensors:
                scores[name, chosen] = run.score(name, chosen)
                if not scores[name, chosen].seconds:
                    raise _too_short(run.name)
            step(f"{run.name} {name} {chosen}")
    return scores


def _rows(source: str, observer: str, scores: Scores) -> Iterator[Row]:
    for (name, sensors), scored in scores.items():
        yield scored.row(source, observer, name, sensors)


def _pooled(scored: Sequence[tuple[Scenario, Faults, Scores]]) -> Iterator[Row]:
    """Rows of all seeds of one scenario together, where there are several."""
    groups: dict[tuple[Scenario, Faults], list[Scores]] = defaultdict(list)
    for scenario, wrong, scores in scored:
        groups[replace(scenario, seed=0), wrong].append(scores)
    for (scenario, wrong), group in groups.items():
        if len(group) > 1:
            whole = {key: Accumulator.pooled(scores[key] for scores in group) for key in group[0]}
            name = f"{scenario.name}{'' if wrong == faults.NONE else ' faulty'} x{len(group)}"
            yield from _rows(name, str(OBSERVER), whole)


def dataset_row(source: str, name: str, robot: RobotConfig) -> Row:
    """The row of a filter on a dataset, its observers pooled; `robot`: how the filter is set."""
    folder, landmarks = mrclam.read_source(source)
    maker = mrclam_scoring.mrclam_maker(name, robot)
    scores = mrclam_scoring.mrclam_scores(mrclam.load_dataset(folder), maker, landmarks)
    return mrclam_scoring.mrclam_rows(scores, name, source)[-1]


def _dataset_rows(source: str, names: Sequence[str], step: Step, keep: Keep) -> list[Row]:
    folder, landmarks = mrclam.read_source(source)
    dataset = mrclam.load_dataset(folder)
    rows: list[Row] = []
    by_robot: dict[int, Scores] = {robot: {} for robot in dataset.robots}
    makers: dict[str, NewFilter] = {name: mrclam_scoring.mrclam_maker(name) for name in names}
    for name, maker in makers.items():
        found = mrclam_scoring.mrclam_scores(dataset, maker, landmarks)
        rows += mrclam_scoring.mrclam_rows(found, name, source)
        for robot, scored in found.items():
            by_robot[robot][name, CAMERA] = scored
        step(f"{source} {name}")
    for robot, scores in by_robot.items():
        messages = dataset.messages(robot, landmarks)
        motion = [message for message in messages if isinstance(message, Displacement)]
        keep(Scored(source, str(robot), MRCLAM_ROBOT, motion, scores))
    return rows
