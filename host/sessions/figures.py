"""The figures of a run or a replay, by name."""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from host.evaluation.truth_scoring import RANGE_M, errors_m
from host.messages import Bearings, Estimate, Health, Measurement, Message, Names, Truth


class Tally:
    """Counts what a run brought, for its summary."""

    def __init__(self) -> None:
        self.estimates = 0
        self.reported = 0
        self.health: dict[str, Health] = {}
        self._estimate: Estimate | None = None
        self._truths = self._within = 0
        self._errors, self._error_sum_m = 0, 0.0
        self._names: Names | None = None
        self._named = 0
        self._recognized: set[int] = set()

    def take(self, message: Message) -> None:
        """Count a message; truth follows the estimate it belongs to."""
        if isinstance(message, Estimate):
            self.estimates += 1
            self.reported += len(message.positions)
            self._estimate = message
            if self._names is not None:
                self._named += int(np.sum(np.isin(message.labels, self._names.labels)))
        elif isinstance(message, Names):
            self._names = message
            self._recognized |= set(message.identities.tolist())
        elif isinstance(message, Health):
            self.health[message.device] = message
        elif isinstance(message, Truth) and self._estimate is not None:
            self._truths += 1
            self._within += int(np.sum(np.linalg.norm(message.positions, axis=1) <= RANGE_M))
            errors = errors_m(self._estimate, message)
            self._errors += int(np.sum(~np.isnan(errors)))
            self._error_sum_m += float(np.nansum(errors))

    def figures(self) -> dict[str, Any]:
        """Means over all estimates, by name."""
        figures: dict[str, Any] = {
            "updates": self.estimates,
            "teammates_reported": _mean(self.reported, self.estimates),
        }
        if self._truths:
            figures["teammates_in_range"] = _mean(self._within, self._truths)
            figures["mean_error_mm"] = _mean(1000.0 * self._error_sum_m, self._errors)
        if self._names is not None:
            figures["recognized"] = sorted(self._recognized)
            figures["named_share"] = _mean(self._named, self.reported)
        return figures

    def devices(self) -> dict[str, dict[str, Any]]:
        """The last health of each device, in the order of their names."""
        return {
            name: {"ok": health.ok, "reason": health.reason, "counts": health.counts}
            for name, health in sorted(self.health.items())
        }


class Delays:
    """From a measurement to the estimate made of it: what a run's summary says of it.

    A scan counts from the end of its revolution, bearings from the exposure of their picture.
    clock: host time, s.
    """

    _KEPT = 100_000  # the last ones, of hours: a run may go on for days

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seconds: dict[str, deque[float]] = {}

    def note(self, measurement: Measurement) -> None:
        """The estimate made of it is there now."""
        name = "camera" if isinstance(measurement, Bearings) else "lidar"
        kept = self._seconds.setdefault(name, deque(maxlen=self._KEPT))
        kept.append(self._clock() - measurement.time)

    def figures(self) -> dict[str, dict[str, float | None]]:
        """By sensor, in ms: median and p99."""
        return {
            name: {
                "median": rounded(1000.0 * np.median(seconds)),
                "p99": rounded(1000.0 * np.percentile(seconds, 99.0)),
            }
            for name, seconds in self._seconds.items()
        }


def timing(update_seconds: Sequence[float]) -> dict[str, float | None]:
    """What an update of the filter took, in ms."""
    update_ms = 1000.0 * np.array(update_seconds or [math.nan])
    return {
        "update_ms_median": rounded(np.median(update_ms)),
        "update_ms_p99": rounded(np.percentile(update_ms, 99.0)),
    }


def _mean(total: float, count: int) -> float | None:
    return rounded(total / count) if count else None


def rounded(value: Any) -> float | None:
    """A figure to three places; None where there is none."""
    return None if value is None or math.isnan(value) else round(float(value), 3)
