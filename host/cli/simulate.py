"""`swarmloc simulate`: a scenario to a recording, at full speed."""

import sys
import time
from collections import Counter
from pathlib import Path

import click

from host.cli import options
from host.recording.log import SUFFIX, Recorder, RecordingHeader
from host.sessions.runs import simulated
from host.simulation.world import scenarios
from host.sources.sensors import LIDAR_AND_CAMERA


@click.command(
    short_help="A scenario to a recording, at full speed.",
    epilog=f"""\b
Example:
  swarmloc simulate arena4:seconds=60,seed=1 --output arena{SUFFIX}
  swarmloc replay arena{SUFFIX}""",
)
@click.argument("scenario")
@click.option(
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    metavar="FILE",
    help=f"Recording to write (FILE ends in {SUFFIX}).",
)
@options.robot_option
@options.json_option
def simulate(scenario: str, output: Path, robot_path: Path | None, json_path: Path | None) -> None:
    """Record what a robot would measure in SCENARIO, with the truth, at full speed.

    SCENARIO is arena4 or swarm20, with settings as in arena4:seconds=60,seed=1,robots=6.
    """
    parsed, robot = scenarios.parse(scenario), options.robot(robot_path)
    counts: Counter[str] = Counter()
    begin, done = time.monotonic(), 0.0
    # Before the file: what cannot be simulated leaves none.
    simulation, messages = simulated(parsed, robot)
    header = RecordingHeader(simulation.config, LIDAR_AND_CAMERA, scenario)
    with (
        Recorder(output, header) as recorder,
        click.progressbar(length=round(10 * parsed.seconds), file=sys.stderr) as bar,
    ):
        for message in messages:
            recorder.write(message)
            counts[type(message).__name__.lower()] += 1
            if message.time >= done + 1.0:
                bar.update(round(10 * (message.time - done)))
                done = message.time
    wall = time.monotonic() - begin
    figures = {
        "recording": str(output),
        "seconds": parsed.seconds,
        "times_real_time": round(parsed.seconds / wall, 1),
        "megabytes": round(output.stat().st_size / 1e6, 1),
        **{f"{kind}_messages": count for kind, count in counts.items()},
    }
    click.echo(options.listing(figures))
    options.write_json(json_path, figures)
