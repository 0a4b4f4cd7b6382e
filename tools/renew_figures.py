"""Renews every table and picture of README.md and docs/ from one file of results.

    make figures                                 # everything; an hour or two on two cores
    python -m tools.renew_figures --only evaluation,mrclam --filters pmb,phd
    python -m tools.renew_figures --only none    # tables and pictures from the results there are

Trials that this very program has done are not done again, so it goes on where it was interrupted;
results of an older program are replaced. Recorded data are read below SWARMLOC_DATA.
"""

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from host.errors import UserError
from host.experiments.records import Records
from host.experiments.sweeping import sweep
from host.experiments.trials import Record, Trial
from tools import draw_comparison, draw_faults
from tools.figure_tables import RESULTS, ROOT, TABLES, records_of, rewritten, trials_of

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))


def main() -> None:
    """Run what is missing, then rewrite tables and pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default=",".join(TABLES), help="tables, or none")
    parser.add_argument("--filters", default="", help="only trials of these filters")
    asked = parser.parse_args()
    names = [] if asked.only == "none" else asked.only.split(",")
    filters = asked.filters.split(",") if asked.filters else []
    trials = [trial for name in names for trial in trials_of(TABLES[name], filters)]
    records = Records(RESULTS)
    run(list(dict.fromkeys(trials)), records)
    newest = only_newest(records.everything())
    records.replace(newest)
    for page in PAGES:
        page.write_text(rewritten(page.read_text(encoding="utf-8"), newest), encoding="utf-8")
    draw(newest)


def run(trials: Sequence[Trial], records: Records) -> None:
    """Run the missing trials where the recorded data are, so that their names hold anywhere."""
    size = len(trials) - len(records.of(trials))
    with (
        contextlib.chdir(os.environ.get("SWARMLOC_DATA", ".")),
        click.progressbar(
            length=size, label="trials", item_show_func=lambda done: done or "", file=sys.stderr
        ) as bar,
    ):
        sweep(trials, records, lambda done: bar.update(1, done), plugins=["tools.ablation"])


def only_newest(records: Sequence[Record]) -> list[Record]:
    """Of each trial the last record, in an order that does not depend on who was done first."""
    newest = {json.dumps(_what(record)): record for record in records}
    return [newest[what] for what in sorted(newest)]


def _what(record: Record) -> list[object]:
    return [record["source"], record["sensors"], record["filter"], record["settings"]]


def draw(records: Sequence[Record]) -> None:
    """Draw the pictures again for which there are records."""
    docs = ROOT / "docs"
    pixels = records_of(TABLES["pixels"], records)
    if pixels:
        _write(docs / "pixels.svg", draw_comparison.picture(draw_comparison.read(pixels)))
    faults = records_of(TABLES["faults"], records)
    if faults:  # the first filter is the one to use
        _write(docs / "faults.svg", draw_faults.picture(faults, faults[0]["filter"]))


def _write(path: Path, text: str) -> None:
    path.write_text(text.rstrip("\n") + "\n", encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except UserError as error:
        raise SystemExit(str(error)) from None
