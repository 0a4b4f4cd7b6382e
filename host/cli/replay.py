"""`swarmloc replay`: a recording through the localizer again."""

import contextlib
import math
import sys
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import click

from host.cli import options
from host.cli.console import FRAME_S, Console, State
from host.cli.summary import summary
from host.messages import Displacement, Estimate, Health, Message, Truth
from host.pipeline import Now
from host.recording.log import SUFFIX, Recording
from host.sessions.replaying import replay_recording
from host.sessions.robot import robot_configuration, with_filter
from host.sources.sensors import SENSORS


class Player:
    """Shows messages on the screen, `speed` times as fast as they came.

    start_s: what came before, counted from the first message, is not waited for.
    """

    def __init__(self, state: State, speed: float, start_s: float = 0.0) -> None:
        self._console = Console(state, sys.stdout)
        self._speed = speed
        self._start_s = start_s
        self._start = time.monotonic()
        self._first = math.nan
        self._next_frame = self._start
        self._estimate: Estimate | None = None
        self._truths: deque[Truth] = deque(maxlen=8)  # the last ones

    def take(self, message: Message | None, made: Sequence[Estimate]) -> None:
        """Wait until a message is due, then show it and what was made of it."""
        if isinstance(message, Health):
            self._console.take(message)
        elif isinstance(message, Truth):
            self._truths.append(message)
        elif isinstance(message, Displacement):  # they come all the time, and at once
            self._first = message.time if math.isnan(self._first) else self._first
            self._wait_for(message.time - self._first - self._start_s)
        if made:
            self._estimate = made[-1]
        if message is None:
            self._draw()

    def close(self) -> None:
        """Give the terminal back."""
        self._console.close()

    def _draw(self) -> None:
        """The newest estimate, with the truth that is closest to it in time, before or after."""
        if self._estimate is not None:
            time = self._estimate.time
            truth = min(self._truths, key=lambda each: abs(each.time - time), default=None)
            self._console.look(Now(self._estimate, time, truth))
        self._console.draw()

    def _wait_for(self, seconds: float) -> None:
        """Wait until so much of what is shown is over; negative: it has not begun."""
        if seconds < 0.0:
            self._start = time.monotonic()
            return
        due = seconds / self._speed
        while True:
            now = time.monotonic()
            if now >= self._next_frame:
                self._next_frame = now + FRAME_S
                self._draw()
            left = self._start + due - now
            if left <= 0.0:
                return
            time.sleep(min(left, FRAME_S))


@click.command(
    short_help="A recording through the localizer again.",
    epilog=f"""\b
Examples:
  swarmloc replay today{SUFFIX}
  swarmloc replay today{SUFFIX} --filter perera2021 --speed 1""",
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
    type=click.FloatRange(0.0, min_open=True),
    help="Show it on the screen, so many times as fast as it was.",
)
@click.option(
    "--from",
    "start_s",
    type=click.FloatRange(0.0),
    metavar="SECONDS",
    default=0.0,
    help="With --speed: begin to show it there; what came before is run through at once.",
)
@click.option(
    "--from-bytes",
    is_flag=True,
    help="Decode again what lidar and board sent, instead of reading what was made of it then.",
)
@options.json_option
def replay(
    file: Path,
    robot_path: Path | None,
    filter_name: str | None,
    sensors: str | None,
    speed: float | None,
    start_s: float,
    from_bytes: bool,
    json_path: Path | None,
) -> None:
    """Run a recording through the localizer again, as fast as possible.

    A recording that is damaged is replayed up to there.
    With the recording's own configuration the estimates are compared with the recorded ones;
    exit code 1 where a bit differs.
    """
    if start_s and speed is None:
        raise click.UsageError("--from needs --speed: nothing is shown without it")
    recording = Recording(file)
    robot = recording.header.config if robot_path is None else robot_configuration(robot_path)
    robot = with_filter(robot, filter_name or robot.filter.profile)
    sensors = sensors or recording.header.sensors
    watchers = []
    with contextlib.ExitStack() as stack:
        if speed is not None:
            title = f"{file} (recorded)"
            player = Player(State(title, robot.filter.profile, sensors), speed, start_s)
            stack.callback(player.close)
            watchers.append(player.take)
        else:
            progress = stack.enter_context(options.progress_bar())
            watchers.append(lambda *_: progress(100.0 * recording.share, 100.0))
        replayed = replay_recording(recording, robot, sensors, watchers, from_bytes)
    click.echo(summary(replayed.figures))
    options.write_json(json_path, replayed.figures)
    replayed.check()
