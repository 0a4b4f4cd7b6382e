"""The published tables: which trials each is made of, and how it reads.

A table stands in README.md or docs/ between two lines, and is rewritten by tools/renew_figures.py:

    <!-- table: evaluation -->
    <!-- end of table -->
"""

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from host.experiments import trials
from host.experiments.intervals import Mean, Summary, mean, summaries
from host.experiments.trials import Record, Trial
from host.registry import FILTERS
from host.sources.sensors import LIDAR_AND_CAMERA, LIDAR_ONLY
from tools.ablation import WITHOUT

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results.jsonl"
SEEDS = tuple(range(11, 21))
LIMIT, BASELINE = "clairvoyant", "perera2021"
COMPARED = ("pmb", "phd", BASELINE, LIMIT)
SENSORS = (LIDAR_AND_CAMERA, LIDAR_ONLY)
DATASET = "mrclam:mrclam6"  # a folder below SWARMLOC_DATA
FAULTS = {
    "none": "",
    "camera: 5 false robots a picture": ",camera_false=5",
    "lidar: 20 % garbage": ",lidar_garbage=0.2",
    "both": ",camera_false=5,lidar_garbage=0.2",
    "camera dead from 20 to 40 s": ",camera_dead=20-40",
}
LAYOUTS = {  # of the ablation; no other table has these sources
    "arena4:seconds=45": "arena4",
    "swarm20:seconds=45": "swarm20",
    "furnished6:seconds=45": "furnished6",
    "arena4:seconds=45,pair_m=0.2": "pair",
    "arena4:seconds=45,lidar_garbage=0.2": "20 % garbage",
}
_TABLE = re.compile(r"(<!-- table: (\w+) -->\n)(.*?)(<!-- end of table -->)", re.DOTALL)

Lines = list[str]


class Table(NamedTuple):
    """sources: without seeds. lines: of the table in Markdown, from its records' summaries."""

    sources: Sequence[str]
    filters: Sequence[str]
    sensors: Sequence[str]
    lines: Callable[[Sequence[Record]], Lines]
    seeds: Sequence[int] = SEEDS


def trials_of(table: Table, filters: Sequence[str] = ()) -> list[Trial]:
    """The trials of a table; only of those of its filters that are registered, and asked for."""
    known = [n for n in table.filters if n in FILTERS.names() and (not filters or n in filters)]
    return trials.grid(trials.seeded(table.sources, table.seeds), known, table.sensors)


def records_of(table: Table, records: Iterable[Record]) -> list[Record]:
    """Its records, whatever program they are of."""
    sources = set(trials.seeded(table.sources, table.seeds))
    order = list(table.filters)
    found = [
        record
        for record in records
        if record["source"] in sources and record["filter"] in order and not record["settings"]
    ]
    return sorted(found, key=lambda record: order.index(record["filter"]))


def rewritten(text: str, records: Sequence[Record]) -> str:
    """A page with its tables as the records have them; one without records stays as it is.

    Raises KeyError for an unknown table.
    """

    def fresh(found: re.Match[str]) -> str:
        table = TABLES[found[2]]
        its_records = records_of(table, records)
        if not its_records:
            return found[0]
        lines = table.lines(its_records)
        return found[1] + "".join(f"{line}\n" for line in lines) + found[4]

    return _TABLE.sub(fresh, text)


def _markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Lines:
    lines = [header, ["---"] * len(header), *rows]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def _evaluation(records: Sequence[Record]) -> Lines:
    header = ["scenario", "sensors", "filter", "GOSPA m", "missed", "false", "> 30 cm"]
    header += ["label changes", "RMSE m", "of the clairvoyant's"]
    return _markdown(header, _scored(records))


def _scored(records: Sequence[Record]) -> Iterator[list[str]]:
    """Rows of every source and choice of sensors, filters below each other, the best one bold."""
    groups: dict[tuple[str, str], list[Summary]] = defaultdict(list)
    for summary in summaries(records):
        groups[summary.source, summary.sensors].append(summary)
    for source, sensors in sorted(groups, key=lambda key: (key[0], SENSORS.index(key[1]))):
        group = groups[source, sensors]
        gospa = {each.filter: each.means["gospa_m"].value for each in group}
        best = min((name for name in gospa if name != LIMIT), key=lambda name: gospa[name])
        for each in group:
            means = each.means
            text = _interval(means["gospa_m"], 3)
            yield [
                source.partition(":")[0],
                sensors,
                each.filter,
                f"**{text}**" if each.filter == best else text,
                f"{means['missed'].value:.2f}",
                f"{means['false'].value:.2f}",
                f"{100 * means['time_over_30cm'].value:.1f} %",
                f"{means['label_changes'].value:.1f}",
                f"{means['rmse_m'].value:.3f}",
                f"{gospa[each.filter] / gospa.get(LIMIT, math.nan):.2f}",
            ]


def _summary(records: Sequence[Record]) -> Lines:
    """GOSPA alone: a row a filter, a column for each source and choice of sensors."""
    found = {(each.source, each.sensors, each.filter): each.means for each in summaries(records)}
    columns = sorted({key[:2] for key in found}, key=lambda key: (key[0], SENSORS.index(key[1])))
    rows = [
        [name, *(_interval(found[*column, name]["gospa_m"], 3) for column in columns)]
        for name in dict.fromkeys(record["filter"] for record in records)
    ]
    header = [f"{source.partition(':')[0]}, {sensors}" for source, sensors in columns]
    return _markdown(["filter", *header], rows)


def _interval(figure: Mean, digits: int) -> str:
    value = f"{figure.value:z.{digits}f}"
    return value if math.isnan(figure.half_width) else f"{value} ± {figure.half_width:.{digits}f}"


def _mrclam(records: Sequence[Record]) -> Lines:
    names = list(dict.fromkeys(record["filter"] for record in records))
    gospa = {(record["source"], record["filter"]): record["gospa_m"] for record in records}
    rows = []
    for setting, words in (("drop", "dropped"), ("clutter", "as clutter")):
        cells = [gospa[f"{DATASET},landmarks={setting}", name] for name in names]
        rows.append([f"landmarks {words}", *(f"{cell:.3f}" for cell in cells)])
    header = ["GOSPA, m (cut-off 1 m)", *(name.replace("_", " ") for name in names)]
    return _markdown(header, rows)


def _faults(records: Sequence[Record]) -> Lines:
    header = ["fault", "filter", "GOSPA m", "missed", "false", "RMSE m, no cut-off", "p67 m"]
    found = {(each.source, each.filter): each for each in summaries(records)}
    names = list(dict.fromkeys(record["filter"] for record in records))
    rows = []
    for fault, setting in FAULTS.items():
        for name in names:
            means = found[_faulty(setting), name].means
            cells = [_interval(means["gospa_m"], 3), f"{means['missed'].value:.2f}"]
            cells += [f"{means['false'].value:.2f}", f"{means['pairs_rmse_m'].value:.3f}"]
            rows.append([fault, name, *cells, f"{means['pairs_p67_m'].value:.3f}"])
    picture = "![GOSPA over time, mean over the seeds, a curve for each fault](faults.svg)"
    return [*_markdown(header, rows), "", picture]


def _faulty(setting: str) -> str:
    return f"arena4:seconds=60{setting}"


def _published(records: Sequence[Record]) -> Lines:
    """Of the thesis' table what it says most by: the worst teammate, and how many are lost."""
    rows = _thesis(records)
    return rows[:2] + [row for row in rows[2:] if "robot 1 of" in row or "25 %" in row]


def _thesis(records: Sequence[Record]) -> Lines:
    """Published numbers beside ours: the mean over the seeds."""
    ours: dict[tuple[str, str, str], list[float | None]] = defaultdict(list)
    published: dict[tuple[str, str], float | None] = {}
    names = list(dict.fromkeys(record["filter"] for record in records))
    for record in sorted(records, key=lambda record: record["source"]):
        for measure, value, theirs in record["published"]:
            published[measure, record["sensors"]] = theirs
            ours[measure, record["sensors"], record["filter"]].append(value)
    rows = []
    for (measure, sensors), theirs in published.items():
        digits = 3 if "share" in measure else 1
        cells = [_interval(mean(ours[measure, sensors, name]), digits) for name in names]
        rows.append([measure, sensors, "" if theirs is None else f"{theirs:.{digits}f}", *cells])
    return _markdown(["measure", "sensors", "published", *names], rows)


def _ablation(records: Sequence[Record]) -> Lines:
    """How much more GOSPA costs without each model, %: the mean over the seeds, each by itself."""
    gospa: dict[tuple[str, str], dict[str, dict[str, float]]] = defaultdict(
        lambda: defaultdict(dict)
    )
    for record in records:
        column = trials.without_seed(record["source"]), record["sensors"]
        gospa[column][record["filter"]][record["source"]] = record["gospa_m"]
    columns = [(layout, layout_sensors) for layout in LAYOUTS for layout_sensors in SENSORS]
    rows = []
    for words, (name, _) in WITHOUT.items():
        cells = []
        for column in columns:
            whole, without = gospa[column]["pmb"], gospa[column][name]
            more = [100.0 * (without[source] / whole[source] - 1.0) for source in without]
            cells.append(_interval(mean(more), 0))
        rows.append([words, *cells])
    header = [f"{LAYOUTS[layout]}, {kind}" for layout, kind in columns]
    return _markdown(["without", *header], rows)


_EVALUATED = Table(("arena4:seconds=120", "swarm20:seconds=120"), COMPARED, SENSORS, _evaluation)
_THESIS = Table(
    ("swarm20:seconds=300", "arena4:seconds=300"),
    (BASELINE, "phd", "pmb"),
    SENSORS,
    _thesis,
    SEEDS[:3],
)
TABLES = {
    "evaluation": _EVALUATED,
    "summary": _EVALUATED._replace(lines=_summary),
    "mrclam": Table(
        (f"{DATASET},landmarks=drop", f"{DATASET},landmarks=clutter"),
        ("pmb", "phd", BASELINE, "last_reading", LIMIT),
        (),
        _mrclam,
        (),
    ),
    "pixels": Table(("arena4:seconds=120,rendered=1",), COMPARED, SENSORS, _evaluation, SEEDS[:5]),
    "faults": Table(
        tuple(map(_faulty, FAULTS.values())),
        ("pmb", "phd"),
        (LIDAR_AND_CAMERA,),
        _faults,
        SEEDS[:5],
    ),
    "thesis": _THESIS,
    "published": _THESIS._replace(lines=_published),
    "ablation": Table(
        tuple(LAYOUTS),
        ("pmb", *(name for name, _ in WITHOUT.values())),
        SENSORS,
        _ablation,
        SEEDS[:5],
    ),
}
