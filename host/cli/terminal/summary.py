"""The figures of a run or a replay as text for a person."""

import re
from collections.abc import Mapping
from typing import Any

from host.cli.options import listing
from host.errors import one_line
from host.evaluation.truth_scoring import RANGE_M, WARM_UP_S

_NO_BREAK = "\N{NO-BREAK SPACE}"  # within a count, until the lines are filled


def summary(figures: Mapping[str, Any]) -> str:
    """The figures of a run, or of a recording's replay, as text for a person."""
    lines = {"time": _time(figures)}
    if figures["updates"]:
        lines["teammates"] = _teammates(figures)
        if "recognized" in figures:
            lines["names"] = _names(figures)
        if "mean_error_mm" in figures:
            lines["error"] = _error(figures["mean_error_mm"], "mean")
        if "gospa_m" in figures:
            lines |= _scores(figures)
    lines["updates"] = _updates(figures)
    if figures.get("latency_ms"):
        lines["latency"] = _latency(figures["latency_ms"])
    if "cpu_share_of_one_core" in figures:
        lines["load"] = f"{figures['cpu_share_of_one_core']:.2f} of one core"
    if "simulated_board" in figures:
        lines["simulated"] = f"board: {figures['simulated_board']}"
    if "recorded_estimates" in figures:
        lines["estimates"] = figures["recorded_estimates"]
    if "recorded_names" in figures:
        lines["recorded names"] = figures["recorded_names"]
    if "recording" in figures:
        lines["recording"] = figures["recording"]
    lines |= {name: _device(device) for name, device in figures["devices"].items()}
    return "Summary\n" + listing(lines).replace(_NO_BREAK, " ")


def _time(figures: Mapping[str, Any]) -> str:
    text = f"{figures['seconds']:.1f} s"
    if "times_real_time" in figures:
        text += f", replayed at {figures['times_real_time']:.1f} times real time"
    return text


def _teammates(figures: Mapping[str, Any]) -> str:
    text = f"{figures['teammates_reported']:.1f} reported on average"
    if "teammates_in_range" in figures:
        within = figures["teammates_in_range"]
        text += f"; true, within {RANGE_M:.1f} m: {within:.1f}"
    return text


def _names(figures: Mapping[str, Any]) -> str:
    if not figures["recognized"]:
        return "nobody recognized by the odometry that came over the link"
    robots = ", ".join(map(str, figures["recognized"]))
    return f"robot {robots} recognized; {100.0 * figures['named_share']:.0f} % of reports named"


def _error(error_mm: float | None, kind: str) -> str:
    if error_mm is None:
        return "unknown: no estimate was near a teammate"
    return f"{error_mm:.0f} mm {kind}, over estimates matched to a teammate"


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


def _latency(delays_ms: Mapping[str, Mapping[str, float]]) -> str:
    """From the end of a revolution, or the exposure of a picture, to the estimate made of it."""
    return "; ".join(
        f"{name} {delay['median']:.0f} ms median, {delay['p99']:.0f} ms p99"
        for name, delay in delays_ms.items()
    )


def _device(device: Mapping[str, Any]) -> str:
    counts = ", ".join(_count(name, value) for name, value in device["counts"].items() if value)
    if device["ok"]:
        return counts or one_line(device["reason"])
    return f"FAIL: {one_line(device['reason'])}" + (f" ({counts})" if counts else "")


def _count(name: str, value: int) -> str:
    """A count in words: "1 packet" of packets, "3 ms busy" of busy_ms."""
    words = name.replace("_", " ")
    if words.endswith(" ms"):
        words = f"ms {words.removesuffix(' ms')}"
    elif value == 1:
        words = re.sub(r"(ie)?s\b", lambda plural: "y" if plural[1] else "", words)
    return f"{value} {words}".replace(" ", _NO_BREAK)
