"""`swarmloc replay`: a recording through the localizer again."""

import contextlib
from pathlib import Path

import click

from host.cli import options
from host.cli.files import json_option, write_json
from host.cli.terminal.console import State
from host.cli.terminal.live_screen import NO_VIEW, address_given
from host.cli.terminal.player import Player, play
from host.cli.terminal.progress import progress_bar
from host.cli.terminal.summary import summary
from host.recording.log import SUFFIX, Recording
from host.sessions.recordings.replaying import Replayed, replay_recording
from host.sessions.robot import robot_configuration, with_filter
from host.sources.sensors import SENSORS
from host.viewer.playback import Playback
from host.viewer.scene import Scene
from host.viewer.server import Viewer


@click.command(
    short_help="Run a recording through the localizer again.",
    epilog=f"""\b
Examples:
  swarmloc replay today{SUFFIX}
  swarmloc replay today{SUFFIX} --filter perera2021 --speed 1
  swarmloc replay today{SUFFIX} --view 127.0.0.1:8737""",
)
@click.argument("file", type=click.Path(path_type=Path))
@options.robot_or_recordings_option
@options.filter_option
@click.option(
    "--sensors",
    type=click.Choice(SENSORS),
    help="Sensors to use besides the wheels.  [default: the recording's]",
)
@click.option(
    "--speed",
    type=options.Number(0.0, min_open=True),
    help="Show it on the screen at this speed; 1: as it was.",
)
@click.option(
    "--from",
    "start_s",
    type=options.Number(0.0),
    metavar="SECONDS",
    default=0.0,
    help="With --speed or --view: start showing here; what came before is computed at once.",
)
@click.option(
    "--from-bytes",
    is_flag=True,
    help="Decode the recorded bytes of lidar and board again.",
)
@click.option(
    "--view",
    metavar="ADDRESS:PORT",
    callback=address_given,
    help="Show it on a web page at this address, with a time bar, until Ctrl-C.",
)
@json_option
def replay(
    file: Path,
    robot_path: Path | None,
    filter_name: str | None,
    sensors: str | None,
    speed: float | None,
    start_s: float,
    from_bytes: bool,
    view: tuple[str, int] | None,
    json_path: Path | None,
) -> None:
    """Run a recording through the localizer again, as fast as possible.

    With the recording's own configuration, the estimates are compared with the recorded ones: exit
    code 1 if a bit differs. A damaged recording is replayed up to the damage.
    """
    if start_s and speed is None and view is None:
        raise click.UsageError("--from needs --speed or --view: nothing is shown without them")
    recording = Recording(file)
    robot = recording.header.config if robot_path is None else robot_configuration(robot_path)
    robot = with_filter(robot, filter_name or robot.filter.profile)
    sensors = sensors or recording.header.sensors

    def once(player: Player) -> Replayed:
        return replay_recording(
            recording,
            robot,
            sensors,
            [player.take],
            from_bytes,
            player.used,
            view is not None,
            player.naming,
        )

    with contextlib.ExitStack() as stack:
        if speed is None and view in (None, NO_VIEW):
            progress = stack.enter_context(progress_bar())
            show = [lambda *_: progress(100.0 * recording.share, 100.0)]
            done: Replayed | None = replay_recording(recording, robot, sensors, show, from_bytes)
        else:
            playback = Playback.of(recording.messages(), speed or 1.0, start_s)
            state = State(f"{file} (recorded)", robot.filter.profile, sensors)
            viewer = None
            if view not in (None, NO_VIEW):
                scene = Scene(robot, robot.filter.profile, recording.cameras, playback)
                viewer = stack.enter_context(Viewer(scene, *view))
                state.page = viewer.url
            done = play(once, playback, state, viewer)
    if done is None and view is None:
        raise click.Abort
    if done is None:
        return
    write_json(json_path, done.figures)
    click.echo(summary(done.figures))
    done.check()
