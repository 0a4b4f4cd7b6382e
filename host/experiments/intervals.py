"""Figures of several seeds: their mean and its 95 % confidence interval."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from host.experiments.trials import Record, without_seed

CONFIDENCE = 0.95


class Mean(NamedTuple):
    """A mean and half the width of its confidence interval; nan where there are too few values."""

    value: float
    half_width: float


@dataclass(frozen=True, slots=True)
class Summary:
    """What the seeds of one source have in common, and the mean of each figure."""

    source: str
    filter: str
    sensors: str
    settings: dict[str, Any]
    seeds: int
    means: dict[str, Mean]

    def as_json(self) -> dict[str, Any]:
        """As JSON values; each figure with its half width as KEY_ci95, null where there is none."""
        figures: dict[str, float | None] = {}
        for name, (value, half_width) in self.means.items():
            figures[name] = value if math.isfinite(value) else None
            figures[f"{name}_ci95"] = half_width if math.isfinite(half_width) else None
        common = {"source": self.source, "filter": self.filter, "sensors": self.sensors}
        return {**common, "settings": self.settings, "seeds": self.seeds, **figures}


def mean(values: Sequence[float | None]) -> Mean:
    """Mean with the interval by Student's t, m ± t(0.975, n - 1) s / sqrt(n).

    None, a figure that does not exist, is left out.
    """
    known = np.array([value for value in values if value is not None], dtype=float)
    n = len(known)
    if n < 2:
        return Mean(float(known[0]) if n else math.nan, math.nan)
    spread = float(np.std(known, ddof=1)) / math.sqrt(n)
    quantile = float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE))
    return Mean(float(np.mean(known)), quantile * spread)


def summaries(records: Sequence[Record]) -> list[Summary]:
    """One for all seeds of a source, filter, sensors and settings, in the order of the first."""
    groups: dict[tuple[str, ...], list[Record]] = defaultdict(list)
    for record in records:
        settings = ",".join(f"{key}={value}" for key, value in record["settings"].items())
        group = without_seed(record["source"]), record["filter"], record["sensors"], settings
        groups[group].append(record)
    found = []
    for (source, name, sensors, _), group_records in groups.items():
        first = group_records[0]
        figures = [k for k, v in first.items() if v is None or isinstance(v, float)]
        means = {key: mean([record[key] for record in group_records]) for key in figures}
        settings_of = dict(first["settings"])
        found.append(Summary(source, name, sensors, settings_of, len(group_records), means))
    return found
