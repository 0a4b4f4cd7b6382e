"""`swarmloc simulate`: a scenario to a recording, at full speed."""

from pathlib import Path

import click

from host.cli import completion, options
from host.cli.files import OutputFile, json_option, write_json
from host.cli.terminal.progress import progress_bar
from host.cli.terminal.summary import written
from host.recording.log import SUFFIX
from host.sessions.recordings.simulating import simulate_to_recording
from host.sessions.robot import robot_configuration
from host.sources.sensors import LIDAR_AND_CAMERA, SENSORS


@click.command(
    short_help="Record a scenario, faster than real time.",
    epilog=f"""\b
Example:
  swarmloc simulate arena4:seconds=60,seed=1 --output arena{SUFFIX}
  swarmloc replay arena{SUFFIX}""",
)
@click.argument("scenario", shell_complete=completion.scenarios)
@click.option(
    "--output",
    type=OutputFile(),
    required=True,
    metavar="FILE",
    help=f"Recording to write ({SUFFIX}).",
)
@click.option(
    "--sensors",
    type=click.Choice(SENSORS),
    default=LIDAR_AND_CAMERA,
    show_default=True,
    help="Sensors of the robot besides the wheels.",
)
@options.robot_option
@json_option
def simulate(
    scenario: str, output: Path, sensors: str, robot_path: Path | None, json_path: Path | None
) -> None:
    """Record what a robot would measure in SCENARIO, with the truth, faster than real time.

    SCENARIO is arena4, swarm20, furnished6, misbuilt4, ... with settings as in
    arena4:seconds=60,seed=1,robots=6 (docs/scenarios.md).
    """
    with progress_bar() as progress:
        robot = robot_configuration(robot_path)
        figures = simulate_to_recording(scenario, output, robot, progress, sensors)
    write_json(json_path, figures)
    click.echo(written(figures))
