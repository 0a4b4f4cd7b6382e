"""What a run brought: figures for its summary."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from host.cli.console import errors_m
from host.cli.options import listing
from host.evaluation.truth_scoring import RANGE_M
from host.messages import Estimate, Health, Message, Truth


class Tally:
    """Counts what a run brought, for its summary."""

    def __init__(self) -> None:
        self.estimates = 0
        self.reported = 0
        self.health: dict[str, Health] = {}
        self._estimate: Estimate | None = None
        self._within: list[int] = []
        self._errors: list[float] = []

    def take(self, message: Message) -> None:
        """Count a message; truth follows the estimate it belongs to."""
        if isinstance(message, Estimate):
            self.estimates += 1
            self.reported += len(message.positions)
            self._estimate = message
        elif isinstance(message, Health):
            self.health[message.device] = message
        elif isinstance(message, Truth) and self._estimate is not None:
            distance = np.linalg.norm(message.positions, axis=1)
            self._within.append(int(np.sum(distance <= RANGE_M)))
            errors = errors_m(self._estimate, message)
            self._errors += errors[~np.isnan(errors)].tolist()

    def figures(
        self, wall_s: float, cpu_s: float, update_seconds: Sequence[float]
    ) -> dict[str, Any]:
        """All figures by name; teammates and errors are means over all estimates.

        wall_s, cpu_s: what the run took. update_seconds: what each update of the filter took.
        """
        update_ms = 1000.0 * np.array(update_seconds or [math.nan])
        figures: dict[str, Any] = {
            "seconds": round(wall_s, 1),
            "teammates_reported": _mean(self.reported, self.estimates),
        }
        if self._within:
            figures["teammates_in_range"] = _mean(sum(self._within), len(self._within))
            figures["mean_error_mm"] = _mean(1000.0 * sum(self._errors), len(self._errors))
        devices = {
            name: {"ok": health.ok, "reason": health.reason, "counts": health.counts}
            for name, health in self.health.items()
        }
        return {
            **figures,
            "updates": self.estimates,
            "updates_per_s": round(self.estimates / wall_s, 1),
            "update_ms_median": _rounded(np.median(update_ms)),
            "update_ms_p99": _rounded(np.percentile(update_ms, 99.0)),
            "cpu_share_of_one_core": round(cpu_s / wall_s, 2),
            "devices": devices,
        }


def summary(figures: Mapping[str, Any]) -> str:
    """The figures of a run as text."""
    lines = {
        name: "-" if value is None else value
        for name, value in figures.items()
        if name != "devices"
    }
    for name, device in figures["devices"].items():
        counts = ", ".join(f"{key} {value}" for key, value in device["counts"].items() if value)
        lines[name] = counts or device["reason"]
    return "Summary\n" + listing(lines)


def _mean(total: float, count: int) -> float | None:
    return round(total / count, 3) if count else None


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else round(float(value), 3)
