"""`swarmloc evaluate`: filters against truth, as rows of figures."""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import click

from host.cli import options
from host.cli.table import table
from host.errors import UserError
from host.estimator import profiles
from host.evaluation import mrclam_scoring
from host.evaluation.metrics import Accumulator, Row
from host.evaluation.truth_scoring import WARM_UP_S
from host.recording import mrclam
from host.recording.mrclam import Landmarks
from host.sessions import runs
from host.simulation.offline import OBSERVER
from host.simulation.world.scenarios import Scenario
from host.sources.sensors import SENSORS

FILTERS = ("perera2021", "phd", "clairvoyant", "last_reading")
_DATASET = "mrclam:"
_LANDMARKS = ("drop", "clutter")

Scores = dict[tuple[str, str], Accumulator]  # by filter and sensors
Step = Callable[[str], None]


@click.command(
    short_help="Filters against truth, in figures.",
    epilog="""\b
Examples:
  swarmloc evaluate arena4:seed=1 arena4:seed=2 --filters phd,clairvoyant
  swarmloc evaluate today.swarmloc --json figures.json
  swarmloc evaluate mrclam:MRCLAM_Dataset6,landmarks=drop""",
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "--filters",
    default="perera2021,phd,clairvoyant",
    show_default=True,
    help=f"Which filters, of {', '.join(FILTERS)}.",
)
@click.option(
    "--sensors",
    default="lidar+camera,lidar",
    show_default=True,
    help="Which sensors; a dataset has its own.",
)
@options.robot_or_recordings_option
@options.json_option
def evaluate(
    sources: Sequence[str],
    filters: str,
    sensors: str,
    robot_path: Path | None,
    json_path: Path | None,
) -> None:
    """Score filters on each SOURCE: a recording, a scenario or a dataset.

    A scenario is written as arena4:seconds=120,seed=1; several seeds of one are also pooled. A
    dataset is mrclam:FOLDER,landmarks=drop or clutter. Each teammate within 2 m is to be
    reported at every scan; errors are cut off at 0.5 m (1 m in the dataset).
    """
    names = options.several(filters, FILTERS, "--filters")
    wanted = options.several(sensors, SENSORS, "--sensors")
    robot = None if robot_path is None else options.robot(robot_path)
    for source in sources:  # what is mistyped fails before anything is computed
        _check(source)
    rows: list[Row] = []
    scored: list[tuple[Scenario, Scores]] = []
    size = sum(
        len(names) * (1 if source.startswith(_DATASET) else len(wanted)) for source in sources
    )
    with click.progressbar(
        length=size, label="evaluating", item_show_func=lambda done: done or "", file=sys.stderr
    ) as bar:

        def step(done: str) -> None:
            bar.update(1, done)

        for source in sources:
            if source.startswith(_DATASET):
                rows += _dataset_rows(source, names, step)
                continue
            run = runs.load(source, robot)
            scores = _scores(run, names, wanted, step)
            rows += _rows(source, run.observer, scores)
            if run.scenario is not None:
                scored.append((run.scenario, scores))
    rows += _pooled(scored)
    click.echo(table(rows))
    options.write_json(json_path, [row.as_json() for row in rows])


def _check(source: str) -> None:
    """Raise UserError for a source that is not there or is known to be too short."""
    if source.startswith(_DATASET):
        _dataset(source)
        return
    found = runs.find(source)
    if isinstance(found, Scenario) and found.seconds <= WARM_UP_S:
        raise _too_short(source)


def _too_short(source: str) -> UserError:
    return UserError(
        f"{source} cannot be scored",
        f"it is shorter than the {WARM_UP_S:.0f} s of warm-up, or has no truth at scans after it",
        "use a longer one: seconds=30 for a scenario",
    )


def _scores(run: runs.Run, names: Sequence[str], sensors: Sequence[str], step: Step) -> Scores:
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


def _pooled(scored: Sequence[tuple[Scenario, Scores]]) -> Iterator[Row]:
    """Rows of all seeds of one scenario together, where there are several."""
    groups: dict[Scenario, list[Scores]] = defaultdict(list)
    for scenario, scores in scored:
        groups[replace(scenario, seed=0)].append(scores)
    for scenario, group in groups.items():
        if len(group) > 1:
            whole = {key: Accumulator.pooled(scores[key] for scores in group) for key in group[0]}
            yield from _rows(f"{scenario.name} x{len(group)}", str(OBSERVER), whole)


def _dataset_rows(source: str, names: Sequence[str], step: Step) -> list[Row]:
    folder, landmarks = _dataset(source)
    dataset = mrclam.load(folder)
    rows: list[Row] = []
    for name in names:
        rows += mrclam_scoring.evaluate(dataset, {name: _maker(name)}, landmarks, source)
        step(f"{source} {name}")
    return rows


def _maker(name: str) -> mrclam_scoring.NewFilter:
    if name in mrclam_scoring.REFERENCES:
        return mrclam_scoring.REFERENCES[name]
    return lambda: profiles.make(name, mrclam_scoring.ROBOT)


def _dataset(source: str) -> tuple[Path, Landmarks]:
    """Folder and landmarks of mrclam:FOLDER,landmarks=drop. Raises UserError."""
    text = source.removeprefix(_DATASET)
    folder, _, setting = text.rpartition(",")
    if not folder or Path(text).is_dir():  # a folder's name may hold a comma
        folder, setting = text, "landmarks=drop"
    key, _, value = (part.strip() for part in setting.partition("="))
    if key != "landmarks" or value not in _LANDMARKS:
        raise UserError(
            f"dataset {source!r} has no setting {setting!r}",
            "landmarks=drop leaves readings of landmarks out, landmarks=clutter keeps them",
            f"write {_DATASET}{folder},landmarks=drop",
        )
    if not Path(folder).is_dir():
        mrclam.load(Path(folder))  # which says in words what is missing
    return Path(folder), cast(Landmarks, value)
