"""A trial: one filter with some sensors and settings on one source; and what it scored."""

import functools
import hashlib
import json
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from host.config import FilterSettings, RobotConfig, parse_config
from host.errors import UserError
from host.evaluation import faults
from host.evaluation.curves import gospa_over_time, pair_errors
from host.evaluation.metrics import Instant
from host.evaluation.mrclam_scoring import CAMERA, MRCLAM_ROBOT
from host.experiments.published import beside_published
from host.registry import SCENARIOS, load_plugin
from host.sessions.offline import evaluating
from host.sessions.recordings import runs
from host.simulation.world.scenarios import Scenario

OVER_TIME_BIN_S = 2.5
Settings = tuple[tuple[str, Any], ...]  # of robot.toml: (("filter.gate", 16.0), ...)
Record = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Trial:
    """What is to be scored. robot: the configuration to which `settings` are applied.

    robot None: the recording's own, else the default; for a dataset the one of its scoring.
    """

    source: str
    filter: str
    sensors: str
    settings: Settings = ()
    robot: RobotConfig | None = None

    def base(self) -> RobotConfig:
        """The configuration without the settings."""
        if evaluating.is_dataset(self.source):
            return MRCLAM_ROBOT
        if self.robot is not None:
            return self.robot
        found = runs.find_source(faults.split(self.source)[0])
        return RobotConfig() if isinstance(found, Scenario) else found.header.config

    def config(self) -> RobotConfig:
        """The configuration in effect. Raises UserError for a setting that cannot be."""
        return with_settings(self.base(), self.settings)

    def key(self) -> str:
        """The key of its record: also the whole configuration, and the program."""
        dump = json.dumps(self.config().model_dump(mode="json"), sort_keys=True)
        digest = hashlib.sha256((dump + _program()).encode()).hexdigest()[:12]
        return json.dumps([self.source, self.filter, self.sensors, dict(self.settings), digest])


def grid(
    sources: Iterable[str],
    filters: Sequence[str],
    sensors: Sequence[str],
    settings: Sequence[tuple[str, Sequence[Any]]] = (),
    robot: RobotConfig | None = None,
) -> list[Trial]:
    """Every combination, source by source. A dataset has sensors of its own."""
    names = [name for name, _ in settings]
    combinations = [
        tuple(zip(names, values, strict=True))
        for values in product(*(values for _, values in settings))
    ]
    return [
        Trial(source, name, chosen, combination, robot)
        for source in sources
        for combination in combinations
        for name in filters
        for chosen in ([CAMERA] if evaluating.is_dataset(source) else sensors)
    ]


def score(trial: Trial, plugins: Sequence[str] = ()) -> Record:
    """Run a trial; its record is the row of `evaluate` with settings, key and GOSPA over time.

    plugins: loaded first, for another process. Raises UserError where the source is not there, too
    short, or without the sensors.
    """
    for plugin in plugins:
        load_plugin(plugin)
    record = {"key": trial.key(), "settings": dict(trial.settings)}
    if evaluating.is_dataset(trial.source):
        row = evaluating.dataset_row(trial.source, trial.filter, trial.config())
        return {**record, **row.as_json()}
    run = _run(trial)
    scores = evaluating.scores_of(run, [trial.filter], [trial.sensors])
    found = scores[trial.filter, trial.sensors]
    row = found.row(trial.source, run.observer, trial.filter, trial.sensors)
    return {**record, **row.as_json(), **_beyond_the_row(found.instants, trial.sensors)}


def _beyond_the_row(instants: list[Instant], sensors: str) -> Record:
    """What figures of several trials are drawn from.

    pairs_rmse_m, pairs_p67_m: of pairs without a cut-off (Belaroussi 2024). over_time: mean GOSPA
    (m) of each bin of time, by its middle (s). published: the thesis' numbers beside ours.
    """
    pairs = pair_errors(instants)
    times, means = gospa_over_time(instants, OVER_TIME_BIN_S)
    return {
        "pairs_rmse_m": _or_none(pairs.rmse_m),
        "pairs_p67_m": _or_none(pairs.p67_m),
        "over_time": [[float(t), round(float(m), 4)] for t, m in zip(times, means, strict=True)],
        "published": [
            [line.measure, _or_none(line.ours), _or_none(line.published)]
            for line in beside_published(instants, sensors)
        ],
    }


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else value


def _run(trial: Trial) -> runs.Run:
    """The run for a trial; those that differ only in the filter's settings share a simulation."""
    config = trial.config()
    run = _load(trial.source, config.model_copy(update={"filter": FilterSettings()}))
    return replace(run, config=run.config.model_copy(update={"filter": config.filter}))


@functools.lru_cache(maxsize=2)
def _load(source: str, config: RobotConfig) -> runs.Run:
    return runs.load_run(source, config)


@functools.cache
def _program() -> str:
    """A digest of all that can change a score: the program without its screens and experiments."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        if path.relative_to(package).parts[0] not in ("cli", "experiments"):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def with_settings(config: RobotConfig, settings: Settings) -> RobotConfig:
    """The configuration with some settings changed, checked as robot.toml is. Raises UserError."""
    if not settings:
        return config
    content = config.model_dump(mode="json")
    for key, value in settings:
        *sections, last = key.split(".")
        table = content
        for section in sections:
            table = table.setdefault(section, {})
        table[last] = value
    return parse_config(tomlkit.dumps(content), ", ".join(f"{k}={v}" for k, v in settings))


def parse_setting(text: str) -> tuple[str, list[Any]]:
    """`filter.gate=9.0,16.0` as key and values, each as robot.toml would have it.

    Raises UserError for anything else.
    """
    key, _, given = text.partition("=")
    try:
        values = list(tomllib.loads(f"values = [{given}]")["values"])
        why = "" if values else "it has no value"
    except tomllib.TOMLDecodeError as error:
        values, why = [], str(error)
    if not values:
        raise UserError(
            f"cannot read the setting {text!r}",
            why,
            "write a key of robot.toml and its values, as in filter.gate=9.0,16.0",
        )
    return key.strip(), values


def seeded(sources: Iterable[str], seeds: Sequence[int]) -> list[str]:
    """Each scenario once with every seed; recordings and datasets as they are."""
    found = []
    for source in sources:
        if not seeds or not _is_scenario(source):
            found.append(source)
            continue
        joint = "," if ":" in source else ":"
        found += [f"{source}{joint}seed={seed}" for seed in seeds]
    return found


def without_seed(source: str) -> str:
    """The source as it is for all seeds."""
    name, _, given = source.partition(":")
    if not _is_scenario(source):
        return source
    rest = [part for part in given.split(",") if part.partition("=")[0].strip() != "seed"]
    return f"{name}:{','.join(rest)}" if any(rest) else name


def _is_scenario(source: str) -> bool:
    return source.partition(":")[0] in SCENARIOS.names() and not Path(source).is_file()
