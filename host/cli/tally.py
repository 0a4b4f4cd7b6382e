"""What a run brought: figures for its summary."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from host.cli.options import listing
from host.errors import one_line
from host.evaluation.truth_scoring import RANGE_M, WARM_UP_S, errors_m
from host.messages import Estimate, Health, Message, Truth

_NO_BREAK = "\N{NO-BREAK SPACE}"  # within a count, until the lines are filled


class Tally:
    """Counts what a run brought, for its summary."""

    def __init__(self) -> None:
        self.estimates = 0
        self.reported = 0
        self.health: dict[str, Health] = {}
        self._estimate: Estimate | None = None
        self._truths = self._within = 0
        self._errors, self._error_sum_m = 0, 0.0

    def take(self, message: Message) -> None:
        """Count a message; truth follows the estimate it belongs to."""
        if isinstance(message, Estimate):
            self.estimates += 1
            self.reported += len(message.positions)
            self._estimate = message
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
        return figures

    def devices(self) -> dict[str, dict[str, Any]]:
        """The last health of each device."""
        return {
            name: {"ok": health.ok, "reason": health.reason, "counts": health.counts}
            for name, health in self.health.items()
        }


def timing(update_seconds: Sequence[float]) -> dict[str, float | None]:
    """What an update of the filter took, in ms."""
    update_ms = 1000.0 * np.array(update_seconds or [math.nan])
    return {
        "update_ms_median": rounded(np.median(update_ms)),
        "update_ms_p99": rounded(np.percentile(update_ms, 99.0)),
    }


def summary(figures: Mapping[str, Any]) -> str:
    """The figures of a run, or of a recording's replay, as text for a person."""
    lines = {"time": _time(figures)}
    if figures["updates"]:
        lines["teammates"] = _teammates(figures)
        if "mean_error_mm" in figures:
            lines["error"] = _error(figures["mean_error_mm"], "mean")
        if "gospa_m" in figures:
            lines |= _scores(figures)
    lines["updates"] = _updates(figures)
    if "cpu_share_of_one_core" in figures:
        lines["load"] = f"{figures['cpu_share_of_one_core']:.2f} of one core"
    if "simulated_board" in figures:
        lines["simulated"] = f"board: {figures['simulated_board']}"
    if "recorded_estimates" in figures:
        lines["estimates"] = figures["recorded_estimates"]
    if "recording" in figures:
        lines["recording"] = figures["recording"]
    lines |= {name: _device(device) for name, device in figures["devices"].items()}
    return "Summary\n" + listing(lines).replace(_NO_BREAK, " ")


def _time(figures: Mapping[str, Any]) -> str:
    text = f"{figures['seconds']:.1f} s"
    if "times_real_time" in figures:
        text += f", replayed {figures['times_real_time']:.1f} times as fast"
    return text


def _teammates(figures: Mapping[str, Any]) -> str:
    text = f"{figures['teammates_reported']:.1f} reported on average"
    if "teammates_in_range" in figures:
        within = figures["teammates_in_range"]
        text += f", {within:.1f} truly within {RANGE_M:.1f} m (simulation)"
    return text


def _error(error_mm: float | None, kind: str) -> str:
    if error_mm is None:
        return "unknown: no report was near a teammate"
    return f"{error_mm:.0f} mm {kind}, of reports that belong to a teammate"


def _scores(figures: Mapping[str, Any]) -> dict[str, str]:
    if figures["gospa_m"] is None:
        return {"score": f"none: no truth at a scan after the first {WARM_UP_S:.0f} s"}
    rmse_m, localisation_mm = figures["rmse_m"], 1000.0 * figures["localisation_m"]
    score = f"GOSPA {figures['gospa_m']:.3f} m (localisation {localisation_mm:.0f} mm), "
    score += f"{figures['missed']:.2f} missed, {figures['false']:.2f} false a scan"
    return {"error": _error(None if rmse_m is None else 1000.0 * rmse_m, "RMSE"), "score": score}


def _updates(figures: Mapping[str, Any]) -> str:
    if not figures["updates"]:
        return "none: nothing was measured"
    text = f"{figures['updates']}"
    if "updates_per_s" in figures:
        text += f" ({figures['updates_per_s']:.1f}/s)"
    median, p99 = figures["update_ms_median"], figures["update_ms_p99"]
    return text if median is None else f"{text}, {median:.2f} ms median, {p99:.1f} ms p99"


def _device(device: Mapping[str, Any]) -> str:
    counts = ", ".join(_count(name, value) for name, value in device["counts"].items() if value)
    if device["ok"]:
        return counts or one_line(device["reason"])
    return f"DOWN: {one_line(device['reason'])}" + (f" ({counts})" if counts else "")


def _count(name: str, value: int) -> str:
    """A count in words: "1 packet" of packets, "3 ms busy" of busy_ms."""
    words = name.replace("_", " ")
    if words.endswith(" ms"):
        words = f"ms {words.removesuffix(' ms')}"
    elif value == 1:
        words = re.sub(r"(ie)?s\b", lambda plural: "y" if plural[1] else "", words)
    return f"{value} {words}".replace(" ", _NO_BREAK)


def _mean(total: float, count: int) -> float | None:
    return rounded(total / count) if count else None


def rounded(value: Any) -> float | None:
    """A figure to three places; None where there is none."""
    return None if value is None or math.isnan(value) else round(float(value), 3)
