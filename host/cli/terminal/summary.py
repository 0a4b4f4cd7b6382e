"""The figures of a run or a replay as text for a person."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from host.cli.terminal.layout import listing
from host.errors import one_line
from host.evaluation.truth_scoring import RANGE_M, WARM_UP_S

_NO_BREAK = "\N{NO-BREAK SPACE}"  # within a count, until the lines are filled
# Of a device's counts: what it is there for, and what says nothing of how well it did.
_MAIN = ("revolutions", "pictures", "frames", "estimates", "heard")
_USUAL = {*_MAIN, "bytes", "packets", "replies", "points", "messages", "bodies", "connections"}
_USUAL |= {"busy_ms", "comparisons"}
# What went wrong: how it counts, of which whole, in words. What is lost is not in the whole.
_SHARES = {
    "checksum_errors": ("", "packets", "packets damaged"),
    "implausible_packets": ("", "packets", "packets implausible"),
    "points_lost": ("lost", "points", "points lost"),
    "refused": ("lost", "frames", "frames damaged"),
    "frames_delayed": ("", "frames", "frames delayed"),
    "lost": ("lost", "frames", "frames lost"),
    "torn": ("", "pictures", "pictures torn"),
    "repeated": ("", "pictures", "pictures repeated"),
    "dropped": ("", "messages", "messages dropped"),
    "late": ("", "messages", "messages late"),
}
_KINDS = {
    "truth": "true poses",
    "bodies": "motion capture",
    "displacement": "wheels",
    "scan": "lidar",
    "bearings": "cameras",
    "estimate": "estimates",
    "health": "device states",
    "names": "recognized robots",
    "teammateodometry": "link",
}
_LABELS = {"output": "written to", "seconds": "time", "megabytes": "size"}
_UNITS = {"seconds": " s", "megabytes": " MB"}


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
    lines |= {
        name: _device(device, figures["seconds"]) for name, device in figures["devices"].items()
    }
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


def _device(device: Mapping[str, Any], seconds: float) -> str:
    """ "ok: 17 revolutions, 7.0/s; 0.2 % of points lost": what it brought, and what went wrong."""
    reason, counts = one_line(device["reason"]), device["counts"]
    troubles = ", ".join(_troubles(counts))
    if not device["ok"]:
        return f"FAIL: {reason}" + (f" ({troubles})" if troubles else "")
    main = next((name for name in _MAIN if counts.get(name) and "comparisons" not in counts), None)
    text = reason if main is None else _count(main, counts[main])
    if main is not None and seconds > 0.0:
        text += f", {counts[main] / seconds:.1f}/s"
    return f"ok: {text}" + (f"; {troubles}" if troubles else "")


def _troubles(counts: Mapping[str, int]) -> Iterator[str]:
    """What is not as it should be, as a share of the whole where there is one."""
    for name, value in counts.items():
        part, whole, words = _SHARES.get(name, ("", "", ""))
        if name == "connections" and value > 1:
            yield "reconnected " + ("once" if value == 2 else f"{value - 1} times")
        elif value and whole in counts:
            total = counts[whole] + (value if part == "lost" else 0)
            yield f"{_percent(value / max(total, 1))} of {words}".replace(" ", _NO_BREAK)
        elif value and name not in _USUAL:
            yield _count(name, value)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.1 else f"{100.0 * share:.0f} %"


def _count(name: str, value: int) -> str:
    """A count in words: "1 packet" of packets."""
    words = name.replace("_", " ")
    if value == 1:
        words = re.sub(r"(ie)?s\b", lambda plural: "y" if plural[1] else "", words)
    return f"{value} {words}".replace(" ", _NO_BREAK)


def written(figures: Mapping[str, Any]) -> str:
    """What `export` or `simulate` wrote: where, and how much of what."""
    lines = {}
    for name, value in figures.items():
        kind, _, unit = name.rpartition("_")
        if unit == "rows":
            lines[f"{kind}.csv"] = f"{value} rows"
        elif unit == "messages":
            lines[_KINDS.get(kind, kind)] = f"{value} {unit}"
        elif name != "times_real_time":
            lines[_LABELS.get(name, name)] = f"{value}{_UNITS.get(name, '')}"
    if "times_real_time" in figures:
        lines["time"] += f", simulated at {figures['times_real_time']} times real time"
    return listing(lines)
